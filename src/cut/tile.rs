//! The surface of a leaf diamond, as rays go over it.

use super::course::{Course, Exit, Walk};
use crate::codec::Matrix;

/// Cells along the sides of blocks on each step of a pyramid, to those of the step below: 2^2.
pub(super) const STEP: u32 = 2;

/// World heights, (N + 1)^2, row by row; NaN where a vertex is not valid.
enum Heights {
    /// Where none loses by it.
    Single(Box<[f32]>),
    Double(Box<[f64]>),
}

/// A leaf: N x N cells, all with the same diagonal.
pub(super) struct Tile {
    heights: Heights,
    has_main_diagonal: bool,
    cells_log2: u32,
    /// Least and greatest height over blocks of 2^2, 2^4 ... cells a side, finest first, row by row, and at the end over all.
    ranges: Box<[[f32; 2]]>,
}

/// What became of a ray over a tile.
pub(super) enum Crossing {
    /// It met the surface at this distance.
    Met(f64),
    /// It came to its end.
    Ended,
    /// It goes on in the cell beside it that the walk has come to, over a line that is a multiple of 2 to this power.
    Left(u32),
}

impl Tile {
    /// `world` gives the height of a unit.
    pub(super) fn new(
        vertices: &Matrix,
        cells_log2: u32,
        has_main_diagonal: bool,
        world: impl Fn(i32) -> f64,
    ) -> Tile {
        let exact: Box<[f64]> = vertices
            .values
            .iter()
            .enumerate()
            .map(|(index, &unit)| {
                if vertices.is_valid(index) {
                    world(unit)
                } else {
                    f64::NAN
                }
            })
            .collect();
        let is_single = exact
            .iter()
            .all(|&height| height.is_nan() || f64::from(height as f32) == height);
        Tile {
            ranges: ranges(&exact, cells_log2),
            heights: if is_single {
                Heights::Single(exact.iter().map(|&height| height as f32).collect())
            } else {
                Heights::Double(exact)
            },
            has_main_diagonal,
            cells_log2,
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let heights = match &self.heights {
            Heights::Single(heights) => size_of_val(&**heights),
            Heights::Double(heights) => size_of_val(&**heights),
        };
        (heights + size_of_val(&*self.ranges)) as u64
    }

    /// Least and greatest height; none are above or below.
    pub(super) fn range(&self) -> [f32; 2] {
        self.ranges[self.ranges.len() - 1]
    }

    /// Follows a ray that is over the tile until it meets it or leaves it.
    pub(super) fn cross(&self, course: &mut Course, walk: &mut Walk) -> Crossing {
        match &self.heights {
            Heights::Single(heights) => self.follow(heights, course, walk),
            Heights::Double(heights) => self.follow(heights, course, walk),
        }
    }

    fn follow<H: Copy + Into<f64>>(
        &self,
        heights: &[H],
        course: &mut Course,
        walk: &mut Walk,
    ) -> Crossing {
        let coarsest = (self.cells_log2 - 1) / STEP * STEP;
        let mut step = coarsest;
        loop {
            let exit = walk.exit(step);
            if step == 0 {
                if let Some(distance) = self.meet(heights, course, walk, &exit) {
                    return Crossing::Met(distance);
                }
            } else if walk.passes(course, &exit, self.block(step, walk.cell)) {
                course.above = f64::NAN;
            } else {
                step -= STEP;
                continue;
            }
            if exit.is_end {
                return Crossing::Ended;
            }
            let aligned = walk.advance(course, &exit, step);
            if aligned >= self.cells_log2 {
                return Crossing::Left(aligned);
            }
            if aligned >= step + STEP && step < coarsest {
                step += STEP;
            }
        }
    }

    /// Range of the block of 2^step cells a side around a cell.
    fn block(&self, step: u32, cell: [i32; 2]) -> [f32; 2] {
        let n = self.cells_log2;
        let [x, y] = cell.map(|along| ((along as u32 & ((1 << n) - 1)) >> step) as usize);
        let mut start = 0;
        for finer in (STEP..step).step_by(STEP as usize) {
            start += 1usize << (2 * (n - finer));
        }
        self.ranges[start + (y << (n - step)) + x]
    }

    /// Looks at both triangles of a cell: where the ray meets them.
    fn meet<H: Copy + Into<f64>>(
        &self,
        heights: &[H],
        course: &mut Course,
        walk: &Walk,
        exit: &Exit,
    ) -> Option<f64> {
        let n = self.cells_log2;
        let [x, y] = walk
            .cell
            .map(|along| (along as u32 & ((1 << n) - 1)) as usize);
        let first = y * ((1 << n) + 1) + x;
        let rows = [
            &heights[first..first + 2],
            &heights[first + (1 << n) + 1..first + (1 << n) + 3],
        ];
        let corners = rows.map(|row| [row[0].into(), row[1].into()]);
        let cell = Cell {
            corners,
            has_main_diagonal: self.has_main_diagonal,
        };
        let ends = [walk.t, exit.t];
        let places = ends.map(|t| course.within(walk.cell, t));
        let sides = places.map(|place| cell.side(place));
        if sides[0] * sides[1] < 0.0 {
            let share = sides[0] / (sides[0] - sides[1]);
            let between = ends[0] + share * (ends[1] - ends[0]);
            let place =
                [0, 1].map(|axis| places[0][axis] + share * (places[1][axis] - places[0][axis]));
            return cell
                .meet(
                    course,
                    sides[0] > 0.0,
                    [ends[0], between],
                    [places[0], place],
                )
                .or_else(|| {
                    cell.meet(
                        course,
                        sides[1] > 0.0,
                        [between, ends[1]],
                        [place, places[1]],
                    )
                });
        }
        let side = sides[0] + sides[1];
        // Along the diagonal, which belongs to both, one that is drawn.
        let is_first = side > 0.0 || side == 0.0 && !cell.height(true, places[0]).is_nan();
        cell.meet(course, is_first, ends, places)
    }
}

/// Two triangles.
struct Cell {
    /// `[row][column]`.
    corners: [[f64; 2]; 2],
    has_main_diagonal: bool,
}

impl Cell {
    /// Positive over the first triangle, that of the corner of the first row which the diagonal leaves out or, if it has both,
    /// of the first corner; negative over the second.
    fn side(&self, [a, b]: [f64; 2]) -> f64 {
        if self.has_main_diagonal {
            a - b
        } else {
            1.0 - a - b
        }
    }

    /// Of a triangle's plane; NaN if the triangle is not drawn.
    fn height(&self, is_first: bool, [a, b]: [f64; 2]) -> f64 {
        let [[first, second], [third, fourth]] = self.corners;
        match (self.has_main_diagonal, is_first) {
            (true, true) => first + a * (second - first) + b * (fourth - second),
            (true, false) => first + a * (fourth - third) + b * (third - first),
            (false, true) => first + a * (second - first) + b * (third - first),
            (false, false) => fourth + (1.0 - a) * (third - fourth) + (1.0 - b) * (second - fourth),
        }
    }

    fn meet(
        &self,
        course: &mut Course,
        is_first: bool,
        interval: [f64; 2],
        [from, to]: [[f64; 2]; 2],
    ) -> Option<f64> {
        let first = course.height(interval[0]) - self.height(is_first, from);
        let last = course.height(interval[1]) - self.height(is_first, to);
        course.meet(interval, [first, last])
    }
}

/// See [`Tile::ranges`].
fn ranges(heights: &[f64], cells_log2: u32) -> Box<[[f32; 2]]> {
    let side = (1 << cells_log2) + 1;
    let hull = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
    let empty = [f64::INFINITY, f64::NEG_INFINITY];
    let mut all = Vec::new();
    let block = 1 << STEP;
    let mut count = (1usize << cells_log2) >> STEP;
    let mut finest = Vec::with_capacity(count * count);
    for y in 0..count {
        for x in 0..count {
            let rows = (y * block..=(y + 1) * block)
                .map(|row| &heights[row * side + x * block..][..=block]);
            // NaN is neither less nor greater than anything.
            finest.push(
                rows.flatten()
                    .fold(empty, |range, &height| hull(range, [height, height])),
            );
        }
    }
    loop {
        all.extend(finest.iter().map(|&range| outwards(range)));
        if count == 1 {
            break;
        }
        let coarser = (count >> STEP).max(1);
        let each = count / coarser;
        let mut next = vec![empty; coarser * coarser];
        for (index, &range) in finest.iter().enumerate() {
            let slot = &mut next[index / count / each * coarser + index % count / each];
            *slot = hull(*slot, range);
        }
        (finest, count) = (next, coarser);
    }
    all.into_boxed_slice()
}

/// The narrowest range of singles around one of doubles.
pub(super) fn outwards([low, high]: [f64; 2]) -> [f32; 2] {
    let (below, above) = (low as f32, high as f32);
    [
        if f64::from(below) > low {
            below.next_down()
        } else {
            below
        },
        if f64::from(above) < high {
            above.next_up()
        } else {
            above
        },
    ]
}
