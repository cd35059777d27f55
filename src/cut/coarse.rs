//! The ground where finer detail is missing: halves of diamonds that cannot be refined.

use crate::codec::Matrix;
use crate::lattice::{Apex, Diamond, Lattice, Placement};
use std::cmp::Ordering;
use std::ops::Range;

/// Corners of a triangle of a unit cell, as offsets from its first vertex, with the barycentric weights of
/// a place in it.
pub(super) type Triangle = [([i64; 2], f64); 3];

/// The triangle over (a, b) of a unit cell. `main` cells are split from (0, 0) to (1, 1), others from (1, 0) to
/// (0, 1); `first` is the triangle that has (1, 0) and (0, 0).
pub(super) fn triangle(main: bool, first: bool, a: f64, b: f64) -> Triangle {
    match (main, first) {
        (true, true) => [([0, 0], 1.0 - a), ([1, 0], a - b), ([1, 1], b)],
        (true, false) => [([0, 0], 1.0 - b), ([0, 1], b - a), ([1, 1], a)],
        (false, true) => [([0, 0], 1.0 - a - b), ([1, 0], a), ([0, 1], b)],
        (false, false) => [([1, 1], a + b - 1.0), ([0, 1], 1.0 - a), ([1, 0], 1.0 - b)],
    }
}

/// Whether a place of a unit cell is in the first of its triangles; on their common edge it counts as.
pub(super) fn is_in_first(main: bool, a: f64, b: f64) -> bool {
    if main { a >= b } else { a + b <= 1.0 }
}

/// Indices in a vertex matrix with weights that add up to 1.
pub(super) type Corners = [(usize, f64); 3];

/// One half of a diamond as a surface of its own triangles.
pub(super) struct CoarseHalf<'a> {
    lattice: &'a Lattice,
    is_leaf: bool,
    placement: Placement,
    apex: Apex,
    /// Of the whole diamond; only this half's need mean anything.
    vertices: &'a Matrix,
}

impl<'a> CoarseHalf<'a> {
    /// Half `half` of `diamond`.
    pub(super) fn new(
        lattice: &'a Lattice,
        diamond: Diamond,
        half: usize,
        vertices: &'a Matrix,
    ) -> CoarseHalf<'a> {
        CoarseHalf {
            lattice,
            is_leaf: diamond.level() == lattice.levels(),
            placement: lattice.placement(diamond),
            apex: lattice.apexes(diamond)[half],
            vertices,
        }
    }

    /// Whether matrix indices lie in the closed half.
    pub(super) fn contains(&self, [i, j]: [f64; 2]) -> bool {
        let end = self.lattice.cells() as f64;
        match self.apex {
            Apex::Right => i >= j,
            Apex::Bottom => i <= j,
            Apex::Origin => i + j <= end,
            Apex::Far => i + j >= end,
        }
    }

    /// The corners of a drawn triangle that has fractional matrix indices of the closed half, those beside it by
    /// rounding included; `None` where none is drawn. On a common edge all triangles have one height.
    pub(super) fn corners(&self, at: [f64; 2]) -> Option<Corners> {
        let last = self.lattice.cells() - 1;
        let [i, j] = self.clamped(at);
        let around = |along: f64| {
            let cell = (along.floor() as usize).min(last);
            let before = (along == cell as f64 && cell > 0).then(|| cell - 1);
            std::iter::once(cell).chain(before)
        };
        let cells = around(j).flat_map(|cj| around(i).map(move |ci| (ci, cj)));
        let triangles = cells.flat_map(|cell| [(cell, true), (cell, false)]);
        triangles
            .filter(|&(cell, first)| self.has_triangle(cell, first))
            .find_map(|(cell, first)| self.drawn_corners(cell, first, [i, j]))
    }

    /// All drawn triangles with a cell among these columns and rows of cells, as indices in the vertex matrix.
    pub(super) fn triangles(
        &self,
        [columns, rows]: [Range<usize>; 2],
    ) -> impl Iterator<Item = [usize; 3]> {
        let (main, side) = (self.has_main_hypotenuse(), self.lattice.cells() + 1);
        let is_open = self.is_leaf && self.vertices.valid.is_none();
        let cells = rows.flat_map(move |cj| columns.clone().map(move |ci| (ci, cj)));
        cells
            .flat_map(|cell| [(cell, true), (cell, false)])
            .filter(|&(cell, first)| self.has_triangle(cell, first))
            .map(move |((ci, cj), first)| {
                let corners = triangle(main, first, 0.0, 0.0);
                corners.map(|([di, dj], _)| (cj + dj as usize) * side + ci + di as usize)
            })
            .filter(move |&indices| is_open || self.is_drawn(indices))
    }

    fn is_drawn(&self, indices: [usize; 3]) -> bool {
        let side = self.lattice.cells() + 1;
        let places = indices.map(|index| self.placement.vertex(index % side, index / side));
        let valid = indices.map(|index| self.vertices.is_valid(index));
        self.lattice.draws(self.is_leaf, places, valid)
    }

    fn has_main_hypotenuse(&self) -> bool {
        matches!(self.apex, Apex::Right | Apex::Bottom)
    }

    /// Whether the first or second triangle of a cell is of this half.
    fn has_triangle(&self, (ci, cj): (usize, usize), first: bool) -> bool {
        let side = match self.has_main_hypotenuse() {
            true => ci.cmp(&cj),
            false => self.lattice.cells().cmp(&(ci + cj + 1)),
        };
        let has_first_side = matches!(self.apex, Apex::Right | Apex::Origin);
        match side {
            Ordering::Equal => first == has_first_side,
            Ordering::Greater => has_first_side,
            Ordering::Less => !has_first_side,
        }
    }

    /// The corners of a triangle of a cell, if it is drawn and has the place.
    fn drawn_corners(
        &self,
        (ci, cj): (usize, usize),
        first: bool,
        [i, j]: [f64; 2],
    ) -> Option<Corners> {
        let (a, b) = (i - ci as f64, j - cj as f64);
        let main = self.has_main_hypotenuse();
        let is_on_edge = if main { a == b } else { a + b == 1.0 };
        if !is_on_edge && first != is_in_first(main, a, b) {
            return None;
        }
        let side = self.lattice.cells() + 1;
        let corners = triangle(main, first, a, b).map(|([di, dj], weight)| {
            let (i, j) = (ci + di as usize, cj + dj as usize);
            (j * side + i, weight)
        });
        let is_drawn = self.is_drawn(corners.map(|(index, _)| index));
        is_drawn.then_some(corners)
    }

    /// The nearest place of the closed half.
    fn clamped(&self, at: [f64; 2]) -> [f64; 2] {
        let end = self.lattice.cells() as f64;
        let [i, j] = at.map(|along| along.clamp(0.0, end));
        if self.contains([i, j]) {
            return [i, j];
        }
        match self.apex {
            Apex::Right | Apex::Bottom => [(i + j) / 2.0; 2],
            Apex::Origin | Apex::Far => {
                let i = (i + end - j) / 2.0;
                [i, end - i]
            }
        }
    }
}

/// Fractional matrix indices of a place in samples.
pub(super) fn matrix_indices(placement: &Placement, at: [f64; 2]) -> [f64; 2] {
    let (dx, dy) = (
        at[0] - placement.origin[0] as f64,
        at[1] - placement.origin[1] as f64,
    );
    let step = placement.ax[0] as f64;
    if placement.ax[1] == 0 {
        [dx / step, dy / step]
    } else {
        [(dx - dy) / (2.0 * step), (dx + dy) / (2.0 * step)]
    }
}

/// Corners of a half in samples: the right angle, the end of p and the end of q.
pub(super) fn half_triangle(lattice: &Lattice, diamond: Diamond, half: usize) -> [[f64; 2]; 3] {
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let apex = lattice.apexes(diamond)[half];
    [(0, 0), (cells, 0), (0, cells)].map(|(p, q)| {
        let (i, j) = apex.vertex(cells, p, q);
        placement.vertex(i, j).map(|along| along as f64)
    })
}

/// Height over a place of the plane through three corners.
pub(super) fn on_plane(corners: &[([f64; 2], f64); 3], [i, j]: [f64; 2]) -> f64 {
    let [(a, height), (b, second), (c, third)] = *corners;
    let [u, v] = [b, c].map(|corner| [corner[0] - a[0], corner[1] - a[1]]);
    let (x, y) = (i - a[0], j - a[1]);
    let area = u[0] * v[1] - u[1] * v[0];
    let (beta, gamma) = ((x * v[1] - y * v[0]) / area, (u[0] * y - u[1] * x) / area);
    height + beta * (second - height) + gamma * (third - height)
}
