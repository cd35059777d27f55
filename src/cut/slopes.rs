//! Slopes of the surface at vertices (`docs/design.md`, Normals): world dz/dx and dz/dy.

use crate::lattice::{Apex, Placement};

/// dz/dx and dz/dy in world units.
pub(super) type Slope = [f32; 2];

/// Turns height differences across the two diagonals of the doubled index grid into slopes.
pub(super) struct Diagonals {
    /// Slope of a unit difference from (-1, -1) to (1, 1).
    main: [f64; 2],
    /// Slope of a unit difference from (-1, 1) to (1, -1).
    anti: [f64; 2],
}

impl Diagonals {
    /// For matrices placed so, with world steps of a column and a row and of a height unit.
    pub fn new(placement: &Placement, step: [f64; 2], unit: f64) -> Diagonals {
        let (ax, ay) = (placement.ax, placement.ay);
        // The diagonals are perpendicular, so that the gradient is the sum of its parts along them.
        let part = |sign: i64| {
            let diagonal = [(ax[0] + sign * ay[0]) as f64, (ax[1] + sign * ay[1]) as f64];
            let square = diagonal[0] * diagonal[0] + diagonal[1] * diagonal[1];
            [
                diagonal[0] / square * unit / step[0],
                diagonal[1] / square * unit / step[1],
            ]
        };
        Diagonals {
            main: part(1),
            anti: part(-1),
        }
    }

    #[inline(always)]
    fn slope(&self, main: f64, anti: f64) -> Slope {
        [
            (main * self.main[0] + anti * self.anti[0]) as f32,
            (main * self.main[1] + anti * self.anti[1]) as f32,
        ]
    }
}

/// Vertex and centre heights of a diamond that is being refined.
pub(super) struct Heights<'a> {
    pub cells: usize,
    pub vertices: &'a [i32],
    pub centres: &'a [i32],
}

impl Heights<'_> {
    /// Writes the slopes of all inner vertices into `vertex_slopes` ((N+1)^2), whose boundary stays as
    /// it is, and those of all centres into `centre_slopes` (N^2).
    pub fn inner_slopes(
        &self,
        diagonals: &Diagonals,
        vertex_slopes: &mut [Slope],
        centre_slopes: &mut [Slope],
    ) {
        let (cells, side) = (self.cells, self.cells + 1);
        let difference = |a: i32, b: i32| f64::from(a) - f64::from(b);
        for (j, row) in centre_slopes.chunks_exact_mut(cells).enumerate() {
            let near = &self.vertices[j * side..][..side];
            let far = &self.vertices[(j + 1) * side..][..side];
            for (i, slope) in row.iter_mut().enumerate() {
                let (main, anti) = (
                    difference(far[i + 1], near[i]),
                    difference(near[i + 1], far[i]),
                );
                *slope = diagonals.slope(main, anti);
            }
        }
        for j in 1..cells {
            let near = &self.centres[(j - 1) * cells..][..cells];
            let far = &self.centres[j * cells..][..cells];
            let row = &mut vertex_slopes[j * side + 1..][..cells - 1];
            for (i, slope) in row.iter_mut().enumerate() {
                let (main, anti) = (
                    difference(far[i + 1], near[i]),
                    difference(near[i + 1], far[i]),
                );
                *slope = diagonals.slope(main, anti);
            }
        }
    }

    /// Corrects the slopes on the hypotenuse of a half diamond, beyond which there is nothing: central
    /// along it, one-sided across it into the `present` half.
    pub fn hypotenuse_slopes(
        &self,
        diagonals: &Diagonals,
        present: Apex,
        vertex_slopes: &mut [Slope],
        centre_slopes: &mut [Slope],
    ) {
        let (cells, side) = (self.cells, self.cells + 1);
        let at = |u: usize, v: usize| f64::from(self.doubled(u, v));
        for u in 1..2 * cells {
            let on_main = matches!(present, Apex::Right | Apex::Bottom);
            let v = if on_main { u } else { 2 * cells - u };
            let inward = match present {
                Apex::Right => at(u + 1, v - 1) - at(u, v),
                Apex::Bottom => at(u, v) - at(u - 1, v + 1),
                Apex::Far => at(u + 1, v + 1) - at(u, v),
                Apex::Origin => at(u, v) - at(u - 1, v - 1),
            };
            let (main, anti) = if on_main {
                (at(u + 1, v + 1) - at(u - 1, v - 1), 2.0 * inward)
            } else {
                (2.0 * inward, at(u + 1, v - 1) - at(u - 1, v + 1))
            };
            let slope = diagonals.slope(main, anti);
            if u.is_multiple_of(2) {
                vertex_slopes[v / 2 * side + u / 2] = slope;
            } else {
                centre_slopes[v / 2 * cells + u / 2] = slope;
            }
        }
    }

    /// Height at (u, v) of the doubled index grid, both even or both odd.
    fn doubled(&self, u: usize, v: usize) -> i32 {
        if u.is_multiple_of(2) {
            self.vertices[v / 2 * (self.cells + 1) + u / 2]
        } else {
            self.centres[v / 2 * self.cells + u / 2]
        }
    }
}

/// Slopes of the root's vertices before anything is refined: central differences along rows and
/// columns, one-sided on the boundary. `step` is the world distance from vertex to vertex.
pub(super) fn root_slopes(
    cells: usize,
    vertices: &[i32],
    step: [f64; 2],
    unit: f64,
) -> Box<[Slope]> {
    let side = cells + 1;
    let slope = |before: usize, after: usize, steps: usize, step: f64| {
        let rise = f64::from(vertices[after]) - f64::from(vertices[before]);
        (rise * unit / (steps as f64 * step)) as f32
    };
    let slopes = (0..side * side).map(|index| {
        let (i, j) = (index % side, index / side);
        let (left, right) = (i.saturating_sub(1), (i + 1).min(cells));
        let (up, down) = (j.saturating_sub(1), (j + 1).min(cells));
        [
            slope(j * side + left, j * side + right, right - left, step[0]),
            slope(up * side + i, down * side + i, down - up, step[1]),
        ]
    });
    slopes.collect()
}
