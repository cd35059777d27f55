//! The triangles of a diamond as a surface over the axes u and v of its matrix.

/// The two halves of a diamond as a piecewise linear surface: cells are `extent` wide, and vertex (i, j) is at
/// `u = extent * i`, `v = extent * j`.
pub(super) struct Surface<'a> {
    pub(super) vertices: &'a [i32],
    pub(super) cells: usize,
    /// log2 of the extent of a cell.
    pub(super) shift: u32,
    /// Cells are split from (0, 0) to (1, 1), else from (1, 0) to (0, 1).
    pub(super) main: bool,
    /// All numbers fit 32 bits.
    is_narrow: bool,
    #[cfg(target_arch = "x86_64")]
    pub(super) room: super::triangles_avx2::Room,
}

/// The surface at constant v in one cell, times the extent: up to `turn` it starts from the left edge, from there
/// on it leads to the right edge.
struct Profile {
    left: i64,
    right: i64,
    /// What it grows by with u, on either side.
    slopes: [i64; 2],
}

impl Profile {
    #[inline(always)]
    fn at(&self, a: i64, turn: i64, extent: i64) -> i64 {
        if a <= turn {
            self.left + a * self.slopes[0]
        } else {
            self.right - (extent - a) * self.slopes[1]
        }
    }
}

impl<'a> Surface<'a> {
    /// The surface over (N+1)^2 vertices; `main` says that cells are split from (0, 0) to (1, 1).
    pub(super) fn new(vertices: &'a [i32], cells: usize, extent: i64, main: bool) -> Surface<'a> {
        Surface {
            vertices,
            cells,
            shift: extent.trailing_zeros(),
            main,
            is_narrow: false,
            #[cfg(target_arch = "x86_64")]
            room: super::triangles_avx2::Room::new(),
        }
    }

    /// Says that all heights will be in a range.
    pub(super) fn fit(&mut self, range: [i32; 2]) {
        let [low, high] = crate::transform::adaptive::extremes(self.vertices);
        let span = i64::from(high.max(range[1])) - i64::from(low.min(range[0]));
        // Either line of a profile stays within three spans, wherever it is followed to in its cell.
        self.is_narrow = span << self.shift < 1 << 29;
    }

    /// The largest `extent * |height - surface|` of samples at constant v that begin at (u, v), where u grows by
    /// `step`, 1 or 2, from each to the next; exact.
    pub(super) fn greatest_difference(&mut self, at: [i64; 2], step: i64, heights: &[i32]) -> i64 {
        #[cfg(target_arch = "x86_64")]
        if self.is_narrow
            && let Some(largest) =
                super::triangles_avx2::greatest_difference(self, at, step, heights)
        {
            return i64::from(largest);
        }
        self.portable_difference(at, step, heights)
    }

    /// The row of cells that v lies in, and where in it: at the end, in the last row.
    pub(super) fn row(&self, v: i64) -> (usize, i64) {
        let j = (v >> self.shift).min(self.cells as i64 - 1);
        (j as usize, v - (j << self.shift))
    }

    /// Where in a cell of a row the two lines of its profile meet.
    pub(super) fn turn(&self, b: i64) -> i64 {
        if self.main { b } else { (1 << self.shift) - b }
    }

    pub(super) fn portable_difference(&self, [u, v]: [i64; 2], step: i64, heights: &[i32]) -> i64 {
        let extent = 1i64 << self.shift;
        let (j, b) = self.row(v);
        let turn = self.turn(b);
        let (mut u, mut rest, mut largest) = (u, heights, 0);
        while !rest.is_empty() {
            let i = (u >> self.shift).min(self.cells as i64 - 1);
            let (first, last) = (
                u - (i << self.shift),
                extent - i64::from(i + 1 < self.cells as i64),
            );
            let count = ((last - first) / step + 1) as usize;
            let (own, others) = rest.split_at(count.min(rest.len()));
            let profile = self.profile(i as usize, j, b);
            for (k, &height) in own.iter().enumerate() {
                let surface = profile.at(first + k as i64 * step, turn, extent);
                largest = largest.max(((i64::from(height) << self.shift) - surface).abs());
            }
            u += own.len() as i64 * step;
            rest = others;
        }
        largest
    }

    /// The surface at (u, v), times the extent.
    pub(super) fn at(&self, [u, v]: [i64; 2]) -> i64 {
        let (j, b) = self.row(v);
        let i = (u >> self.shift).min(self.cells as i64 - 1);
        let a = u - (i << self.shift);
        self.profile(i as usize, j, b)
            .at(a, self.turn(b), 1 << self.shift)
    }

    fn profile(&self, i: usize, j: usize, b: i64) -> Profile {
        let extent = 1i64 << self.shift;
        let index = j * (self.cells + 1) + i;
        let at = |index: usize| i64::from(self.vertices[index]);
        let [v00, v10] = [at(index), at(index + 1)];
        let [v01, v11] = [at(index + self.cells + 1), at(index + self.cells + 2)];
        let (above, below) = (v10 - v00, v11 - v01);
        Profile {
            left: (extent - b) * v00 + b * v01,
            right: (extent - b) * v10 + b * v11,
            slopes: if self.main {
                [below, above]
            } else {
                [above, below]
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The surface by the weights of the three vertices around (u, v), times the extent.
    fn by_weights(surface: &Surface, u: i64, v: i64) -> i64 {
        let extent = 1i64 << surface.shift;
        let last = surface.cells as i64 - 1;
        let (i, j) = (
            (u >> surface.shift).min(last),
            (v >> surface.shift).min(last),
        );
        let (a, b) = (u - (i << surface.shift), v - (j << surface.shift));
        let at = |i: i64, j: i64| {
            i64::from(surface.vertices[j as usize * (surface.cells + 1) + i as usize])
        };
        let [v00, v10, v01, v11] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
        if surface.main && a >= b {
            (extent - a) * v00 + (a - b) * v10 + b * v11
        } else if surface.main {
            (extent - b) * v00 + (b - a) * v01 + a * v11
        } else if a + b <= extent {
            (extent - a - b) * v00 + a * v10 + b * v01
        } else {
            (a + b - extent) * v11 + (extent - a) * v01 + (extent - b) * v10
        }
    }

    proptest! {
        #[test]
        fn differences_are_those_from_the_triangle_around_each_sample(
            cells_log2 in 2u32..8,
            shift in 0u32..7,
            main in any::<bool>(),
            turned in any::<bool>(),
            bits in 1u32..31,
            seed in any::<u64>(),
            places in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), 1usize..400), 1..20),
        ) {
            let (cells, step) = (1usize << cells_log2, 1 + i64::from(turned && shift > 0));
            let mut state = seed | 1;
            let mut next = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 33) as u32 as i32) >> (31 - bits)
            };
            let vertices: Vec<i32> = (0..(cells + 1) * (cells + 1)).map(|_| next()).collect();
            let mut surface = Surface::new(&vertices, cells, 1 << shift, main);
            surface.fit([0, 1 << bits.min(30)]);
            let side = cells << shift;
            for (u, v, count) in places {
                let (mut u, v) = (u.index(side + 1) as i64, v.index(side + 1) as i64);
                if step == 2 && (u + v) % 2 == 1 {
                    u += if u > 0 { -1 } else { 1 };
                }
                let count = count.min(((side as i64 - u) / step + 1) as usize);
                let heights: Vec<i32> = (0..count).map(|_| next()).collect();
                let difference = |(k, &height): (usize, &i32)| {
                    ((i64::from(height) << shift) - by_weights(&surface, u + step * k as i64, v)).abs()
                };
                let expected = heights.iter().enumerate().map(difference).max();
                for (k, &height) in heights.iter().enumerate() {
                    let at = [u + step * k as i64, v];
                    let distance = ((i64::from(height) << shift) - surface.at(at)).abs();
                    prop_assert_eq!(distance, difference((k, &height)));
                }
                prop_assert_eq!(Some(surface.portable_difference([u, v], step, &heights)), expected);
                prop_assert_eq!(Some(surface.greatest_difference([u, v], step, &heights)), expected);
            }
        }
    }
}
