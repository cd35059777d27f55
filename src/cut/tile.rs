//! The surface of a leaf diamond, as rays go over it.

use super::course::{Course, Exit, Walk};
use crate::codec::Matrix;

/// A block has 2^2 cells a side, and a square 2^4 or all that there are.
const BLOCK: u32 = 2;
const SQUARE: u32 = 4;
/// Vertices along a block's side.
const SIDE: usize = (1 << BLOCK) + 1;

/// A way to keep heights.
trait Stored: Copy {
    /// The world height, given that of 0 and of 1; NaN for a vertex that is not valid.
    fn height(self, scale: [f64; 2]) -> f64;
}

impl Stored for u16 {
    #[inline]
    fn height(self, [zero, one]: [f64; 2]) -> f64 {
        if self == u16::MAX {
            return f64::NAN;
        }
        zero + f64::from(self) * one
    }
}

impl Stored for f32 {
    #[inline]
    fn height(self, _: [f64; 2]) -> f64 {
        f64::from(self)
    }
}

impl Stored for f64 {
    #[inline]
    fn height(self, _: [f64; 2]) -> f64 {
        self
    }
}

/// Heights of 4 x 4 cells, `[row][column]`, with the first of the blocks beside it: in one line of memory where they are short.
#[repr(align(64))]
struct Block<H>([[H; SIDE]; SIDE]);

/// Row by row. Heights are as exact as doubles.
enum Blocks {
    Short(Box<[Block<u16>]>),
    Single(Box<[Block<f32>]>),
    Double(Box<[Block<f64>]>),
}

/// A leaf: N x N cells, all with the same diagonal.
pub(super) struct Tile {
    blocks: Blocks,
    /// World height of a short 0, and a short 1 above it.
    scale: [f64; 2],
    has_main_diagonal: bool,
    cells_log2: u32,
    /// Least and greatest height of each square, and then of each block, row by row.
    ranges: Box<[[f32; 2]]>,
    /// Of all.
    range: [f32; 2],
}

/// What became of a ray over a tile.
pub(super) enum Crossing {
    /// It met the surface at this distance.
    Met(f64),
    /// It came to its end.
    Ended,
    /// It goes on over a line between columns, else rows.
    Left { over_column: bool },
}

impl Tile {
    /// World heights are about `height_to_world[0] + height_to_world[1] * unit`; `world` gives the exact one.
    pub(super) fn new(
        vertices: &Matrix,
        cells_log2: u32,
        has_main_diagonal: bool,
        height_to_world: [f64; 2],
        world: impl Fn(i32) -> f64,
    ) -> Tile {
        let valid = || (0..vertices.values.len()).filter(|&index| vertices.is_valid(index));
        let lowest = valid()
            .map(|index| vertices.values[index])
            .min()
            .unwrap_or(0);
        let mut exact = vec![f64::NAN; vertices.values.len()];
        valid().for_each(|index| exact[index] = world(vertices.values[index]));
        let scale = [
            height_to_world[0] + height_to_world[1] * f64::from(lowest),
            height_to_world[1],
        ];
        let short = |index: usize| {
            let count = i64::from(vertices.values[index]) - i64::from(lowest);
            u16::try_from(count).ok().filter(|&short| short < u16::MAX)
        };
        let is_short = valid().all(|index| {
            let height = short(index).map_or(f64::NAN, |short| short.height(scale));
            (height - exact[index]).abs() <= 4.0 * f64::EPSILON * exact[index].abs()
        });
        let is_single = || valid().all(|index| f64::from(exact[index] as f32) == exact[index]);
        let of_blocks = block_ranges(&exact, cells_log2);
        let mut ranges = square_ranges(&of_blocks, cells_log2);
        let range = ranges.iter().copied().fold(NOTHING, hull);
        ranges.extend(of_blocks);
        let blocks = if is_short {
            let stored = |index| match vertices.is_valid(index) {
                true => short(index).unwrap_or(u16::MAX),
                false => u16::MAX,
            };
            Blocks::Short(blocks(cells_log2, stored))
        } else if is_single() {
            Blocks::Single(blocks(cells_log2, |index| exact[index] as f32))
        } else {
            Blocks::Double(blocks(cells_log2, |index| exact[index]))
        };
        Tile {
            blocks,
            scale,
            has_main_diagonal,
            cells_log2,
            ranges: ranges.into_boxed_slice(),
            range,
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let blocks = match &self.blocks {
            Blocks::Short(blocks) => size_of_val(&**blocks),
            Blocks::Single(blocks) => size_of_val(&**blocks),
            Blocks::Double(blocks) => size_of_val(&**blocks),
        };
        (blocks + size_of_val(&*self.ranges) + size_of::<Tile>()) as u64
    }

    /// Least and greatest height.
    pub(super) fn range(&self) -> [f32; 2] {
        self.range
    }

    /// Follows a ray that is over the tile until it meets it or leaves it.
    pub(super) fn cross(&self, course: &mut Course, walk: &mut Walk) -> Crossing {
        match &self.blocks {
            Blocks::Short(blocks) => self.follow_squares(blocks, course, walk),
            Blocks::Single(blocks) => self.follow_squares(blocks, course, walk),
            Blocks::Double(blocks) => self.follow_squares(blocks, course, walk),
        }
    }

    fn follow_squares<H: Stored>(
        &self,
        blocks: &[Block<H>],
        course: &mut Course,
        walk: &mut Walk,
    ) -> Crossing {
        let step = SQUARE.min(self.cells_log2);
        let tile = walk.cell.map(|along| along >> self.cells_log2);
        let mut steps = walk.steps(step);
        loop {
            let exit = steps.exit(course, walk);
            let mut over_column = exit.over_column;
            let range = self.ranges[self.index(step, steps.square)];
            if !walk.passes(&exit, range) {
                walk.enter(course, steps.square, step);
                match self.follow_blocks(blocks, course, walk) {
                    Crossing::Left { over_column: over } => over_column = over,
                    ended => return ended,
                }
            } else if pass(course, walk, &exit) {
                return Crossing::Ended;
            }
            steps.advance(over_column);
            if !steps.is_in(tile, self.cells_log2 - step) {
                return Crossing::Left { over_column };
            }
        }
    }

    /// The same over a square.
    fn follow_blocks<H: Stored>(
        &self,
        blocks: &[Block<H>],
        course: &mut Course,
        walk: &mut Walk,
    ) -> Crossing {
        let around = SQUARE.min(self.cells_log2);
        let square = walk.cell.map(|along| along >> around);
        let ranges = &self.ranges[1 << (2 * (self.cells_log2 - around))..];
        let mut steps = walk.steps(BLOCK);
        loop {
            let exit = steps.exit(course, walk);
            let mut over_column = exit.over_column;
            let index = self.index(BLOCK, steps.square);
            if !walk.passes(&exit, ranges[index]) {
                walk.enter(course, steps.square, BLOCK);
                match self.follow_cells(&blocks[index], course, walk) {
                    Crossing::Left { over_column: over } => over_column = over,
                    ended => return ended,
                }
            } else if pass(course, walk, &exit) {
                return Crossing::Ended;
            }
            steps.advance(over_column);
            if !steps.is_in(square, around - BLOCK) {
                return Crossing::Left { over_column };
            }
        }
    }

    /// The same over a block.
    fn follow_cells<H: Stored>(
        &self,
        Block(heights): &Block<H>,
        course: &mut Course,
        walk: &mut Walk,
    ) -> Crossing {
        let block = walk.cell.map(|along| along >> BLOCK);
        let mut steps = walk.steps(0);
        let mut from = course.grid(walk.t);
        loop {
            let exit = steps.exit(course, walk);
            let to = course.grid(exit.t);
            let [x, y] = steps.square.map(|along| along as usize % (SIDE - 1));
            let rows = [&heights[y], &heights[y + 1]];
            let cell = Cell {
                corners: rows
                    .map(|row| [row[x], row[x + 1]].map(|height| height.height(self.scale))),
                has_main_diagonal: self.has_main_diagonal,
            };
            let first = steps.square.map(f64::from);
            let places = [from, to].map(|place| [place[0] - first[0], place[1] - first[1]]);
            let ends = [(walk.t, walk.z), (exit.t, exit.z)];
            if let Some(distance) = cell.cross(course, ends, places) {
                return Crossing::Met(distance);
            }
            if exit.is_end {
                return Crossing::Ended;
            }
            walk.go_on(&exit);
            from = to;
            steps.advance(exit.over_column);
            if !steps.is_in(block, BLOCK) {
                return Crossing::Left {
                    over_column: exit.over_column,
                };
            }
        }
    }

    /// The number of a square of 2^step cells a side in the tile.
    fn index(&self, step: u32, square: [i32; 2]) -> usize {
        let bits = self.cells_log2 - step;
        let [x, y] = square.map(|along| along as usize & ((1 << bits) - 1));
        (y << bits) + x
    }
}

/// Goes on above or below all that is in a square; whether the ray ends in it.
#[inline]
pub(super) fn pass(course: &mut Course, walk: &mut Walk, exit: &Exit) -> bool {
    course.above = f64::NAN;
    walk.go_on(exit);
    exit.is_end
}

/// Two triangles.
struct Cell {
    /// `[row][column]`.
    corners: [[f64; 2]; 2],
    has_main_diagonal: bool,
}

impl Cell {
    /// Positive over the first triangle, that with the second corner of the first row or, if the diagonal has it, with the first; negative
    /// over the other.
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

    /// Where a ray meets a triangle between two of its places over the cell, given its distance and height there.
    #[inline]
    fn cross(
        &self,
        course: &mut Course,
        [from, to]: [(f64, f64); 2],
        places: [[f64; 2]; 2],
    ) -> Option<f64> {
        let sides = places.map(|place| self.side(place));
        if sides[0] * sides[1] < 0.0 {
            let share = sides[0] / (sides[0] - sides[1]);
            let t = from.0 + share * (to.0 - from.0);
            let between = (t, course.height(t));
            let place =
                [0, 1].map(|axis| places[0][axis] + share * (places[1][axis] - places[0][axis]));
            let met = self.meet(course, sides[0] > 0.0, [from, between], [places[0], place]);
            if met.is_some() {
                return met;
            }
            return self.meet(course, sides[1] > 0.0, [between, to], [place, places[1]]);
        }
        let side = sides[0] + sides[1];
        // Along the diagonal, which belongs to both, one that is drawn.
        let is_first = side > 0.0 || side == 0.0 && !self.height(true, places[0]).is_nan();
        self.meet(course, is_first, [from, to], places)
    }

    #[inline]
    fn meet(
        &self,
        course: &mut Course,
        is_first: bool,
        ends: [(f64, f64); 2],
        places: [[f64; 2]; 2],
    ) -> Option<f64> {
        let first = ends[0].1 - self.height(is_first, places[0]);
        let last = ends[1].1 - self.height(is_first, places[1]);
        course.meet([ends[0].0, ends[1].0], [first, last])
    }
}

fn blocks<H: Stored>(cells_log2: u32, stored: impl Fn(usize) -> H) -> Box<[Block<H>]> {
    let (cells, count) = (1 << cells_log2, 1usize << (cells_log2 - BLOCK));
    let block = |index: usize| {
        let first = (index / count * (cells + 1) + index % count) * (SIDE - 1);
        let row = |j: usize| std::array::from_fn(|i| stored(first + j * (cells + 1) + i));
        Block(std::array::from_fn(row))
    };
    (0..count * count).map(block).collect()
}

/// That of no heights.
const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

fn hull(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

fn block_ranges(heights: &[f64], cells_log2: u32) -> Vec<[f32; 2]> {
    let (side, count) = ((1 << cells_log2) + 1, 1usize << (cells_log2 - BLOCK));
    let block = |index: usize| {
        let first = (index / count * side + index % count) * (SIDE - 1);
        let rows = (0..SIDE).map(|row| &heights[first + row * side..][..SIDE]);
        // NaN is neither less nor greater than anything.
        let ends = rows.flatten().fold(
            [f64::INFINITY, f64::NEG_INFINITY],
            |[low, high], &height| [low.min(height), high.max(height)],
        );
        outwards(ends)
    };
    (0..count * count).map(block).collect()
}

fn square_ranges(blocks: &[[f32; 2]], cells_log2: u32) -> Vec<[f32; 2]> {
    let count = 1usize << (cells_log2 - BLOCK);
    let squares = count.div_ceil(1 << (SQUARE - BLOCK));
    let each = count / squares;
    let mut ranges = vec![NOTHING; squares * squares];
    for (index, &range) in blocks.iter().enumerate() {
        let around = &mut ranges[index / count / each * squares + index % count / each];
        *around = hull(*around, range);
    }
    ranges
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
