//! The ground where finer detail is missing: halves of diamonds that cannot be refined.

use crate::codec::Matrix;
use crate::lattice::{Apex, Diamond, Lattice, Placement};

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
    placement: Placement,
    apex: Apex,
    /// Of the whole diamond; only this half's need mean anything.
    vertices: &'a Matrix,
}

impl<'a> CoarseHalf<'a> {
    /// Half `half` of `diamond`, which is not one of the leaf level.
    pub(super) fn new(
        lattice: &'a Lattice,
        diamond: Diamond,
        half: usize,
        vertices: &'a Matrix,
    ) -> CoarseHalf<'a> {
        CoarseHalf {
            lattice,
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

    /// The corners of the triangle around fractional matrix indices of the closed half, those beside it by
    /// rounding included; `None` where none is drawn.
    pub(super) fn corners(&self, at: [f64; 2]) -> Option<Corners> {
        let cells = self.lattice.cells();
        let [i, j] = self.clamped(at);
        let cell = |along: f64| (along.floor() as usize).min(cells - 1);
        let (mut ci, mut cj) = (cell(i), cell(j));
        // Of the cells around a vertex of the hypotenuse, one of this half.
        if self.apex == Apex::Origin && ci + cj >= cells {
            if ci > 0 { ci -= 1 } else { cj -= 1 }
        }
        let (a, b) = (i - ci as f64, j - cj as f64);
        let main = matches!(self.apex, Apex::Right | Apex::Bottom);
        let on_hypotenuse = if main { ci == cj } else { ci + cj + 1 == cells };
        let first = match on_hypotenuse {
            true => matches!(self.apex, Apex::Right | Apex::Origin),
            false => is_in_first(main, a, b),
        };
        let corners = triangle(main, first, a, b).map(|([di, dj], weight)| {
            let (i, j) = (ci + di as usize, cj + dj as usize);
            (j * (cells + 1) + i, weight)
        });
        let places = corners.map(|(index, _)| {
            let (i, j) = (index % (cells + 1), index / (cells + 1));
            self.placement.vertex(i, j)
        });
        let valid = corners.map(|(index, _)| self.vertices.is_valid(index));
        self.lattice.draws(false, places, valid).then_some(corners)
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
