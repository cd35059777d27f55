//! Four rays at once through one BlockMap, over what lies below them.
//!
//! A ray crosses the lines of one axis, the major one, more often than those of the other. In a column between two of them it is in one
//! or two squares: a *search* looks at these, column by column, for the first that is as high as the ray's lower end. All that a column
//! asks is known from its number, so that no column waits for the one before. A *stroll* then goes texel by texel through that column, from
//! where the ray reaches the height of its squares.
//!
//! All numbers are floats: those of texels and their indices are whole and exact.

use super::beams::{Floats, LANES, select, whole};
use super::cast::{Axis, Caster, Meeting, SQUARE, Walks};
use super::layout::BlockMap;
use std::ops::Deref;
use wide::i32x4;

const SQUARE_SIDE: f32 = SQUARE as f32;
/// By how much a place along a ray may be off its crossings, in squares, and more.
const MARGIN: f32 = 1.0 / 1024.0;

/// Rows of numbers over a block, by the rays' own columns and rows.
struct Field<'a> {
    heights: &'a [f32],
    base: Floats,
    /// Along x and y.
    strides: [Floats; 2],
}

/// Rays, and which axis is which.
struct Course<'a> {
    walks: &'a Walks,
    /// Where x is the major axis.
    is_x: Floats,
    major: Axis,
    minor: Axis,
    /// Texels along the block.
    side: Floats,
}

/// Columns of squares in which rays may meet something.
struct Found {
    lanes: Floats,
    column: Floats,
    /// The greatest height of the column's squares.
    top: Floats,
}

/// Rays in texels.
struct Places {
    texel: [Floats; 2],
    /// Index of the texel before; below 0 for none.
    before: Floats,
    distance: Floats,
}

impl<M: Deref<Target = BlockMap>> Caster<M> {
    /// Tells the meetings of those of four rays that have one; gives which.
    #[inline(always)]
    pub(super) fn leap(
        &self,
        walks: &Walks,
        lanes: Floats,
        mut tell: impl FnMut(usize, Meeting),
    ) -> Floats {
        let side = self.side_texels() as f32;
        let course = Course::new(walks, side);
        let texels = Field::new(&self.heights, walks, side);
        let squares = Field::new(&self.squares, walks, side / SQUARE_SIDE);
        let mut column = whole(course.major.origin * (1.0 / SQUARE_SIDE));
        let (mut sought, mut met) = (lanes, Floats::ZERO);
        while sought.any() {
            let found = course.search(&squares, column, sought);
            if !found.lanes.any() {
                break;
            }
            let places = course.enter(&found, &texels);
            let (meetings, onward) = course.stroll(&texels, &found, places);
            meetings.each(&mut tell);
            met |= meetings.lanes;
            column = found.column + 1.0;
            sought = onward & (column * SQUARE_SIDE).simd_lt(course.side);
        }
        met
    }
}

impl<'a> Field<'a> {
    #[inline(always)]
    fn new(heights: &'a [f32], walks: &Walks, side: f32) -> Field<'a> {
        let (last, one) = (Floats::splat(side - 1.0), Floats::splat(1.0));
        let (x, y) = (walks.x.is_mirrored, walks.y.is_mirrored);
        Field {
            heights,
            base: (x & last) + (y & (last * side)),
            strides: [select(x, -one, one), select(y, -one, one) * side],
        }
    }

    #[inline(always)]
    fn index(&self, [x, y]: [Floats; 2]) -> Floats {
        self.base + x * self.strides[0] + y * self.strides[1]
    }

    /// The heights at indices. Those of rays that are done may be any.
    #[inline(always)]
    fn at(&self, indices: Floats) -> Floats {
        let bits = i32x4::splat(self.heights.len() as i32 - 1);
        let indices = (indices.fast_trunc_int() & bits).to_array();
        Floats::from(indices.map(|index| self.heights[index as usize]))
    }
}

impl Axis {
    /// The distances at which lines are crossed.
    #[inline(always)]
    fn crossing(&self, line: Floats) -> Floats {
        line * self.inverse + self.offset
    }

    #[inline(always)]
    fn place(&self, distance: Floats) -> Floats {
        self.origin + distance * self.direction
    }
}

impl<'a> Course<'a> {
    #[inline(always)]
    fn new(walks: &'a Walks, side: f32) -> Course<'a> {
        let (x, y) = (&walks.x, &walks.y);
        let is_x = y.direction.simd_le(x.direction);
        let pick = |one: &Axis, other: &Axis| Axis {
            origin: select(is_x, one.origin, other.origin),
            direction: select(is_x, one.direction, other.direction),
            inverse: select(is_x, one.inverse, other.inverse),
            offset: select(is_x, one.offset, other.offset),
            is_mirrored: select(is_x, one.is_mirrored, other.is_mirrored),
        };
        Course {
            walks,
            is_x,
            major: pick(x, y),
            minor: pick(y, x),
            side: Floats::splat(side),
        }
    }

    #[inline(always)]
    fn height(&self, distance: Floats) -> Floats {
        self.walks.origin + distance * self.walks.direction
    }

    /// The first columns of squares, from a column on, in which those sought may meet something.
    #[inline(always)]
    fn search(&self, squares: &Field, mut column: Floats, mut sought: Floats) -> Found {
        let per_square = Floats::splat(1.0 / SQUARE_SIDE);
        let across = self.side * per_square;
        let highest = across - 1.0;
        let [x, y] = squares.strides;
        let (columns, rows) = (select(self.is_x, x, y), select(self.is_x, y, x));
        let mut found = Found {
            lanes: Floats::ZERO,
            column: Floats::ZERO,
            top: Floats::ZERO,
        };
        let distance = self.major.crossing(column * SQUARE_SIDE);
        let distance = distance.fast_max(Floats::ZERO);
        let mut height = self.height(distance);
        let mut along = self.minor.place(distance) * per_square;
        loop {
            let leave = self.major.crossing((column + 1.0) * SQUARE_SIDE);
            let leave = leave.fast_min(self.walks.end);
            let next = self.height(leave);
            let low = whole((along - MARGIN).fast_max(Floats::ZERO));
            along = self.minor.place(leave) * per_square;
            let high = whole((along + MARGIN).fast_min(highest));
            let first = squares.base + column * columns;
            let one = squares.at(first + low * rows);
            let other = squares.at(first + high * rows);
            // Along a diagonal, with the margins, there may be a third between them.
            let is_wide = (high - low).simd_gt(Floats::splat(1.0));
            let top = select(is_wide, Floats::splat(f32::INFINITY), one.fast_max(other));
            let is_met = height.fast_min(next).simd_le(top) & sought;
            found.lanes |= is_met;
            found.column = select(is_met, column, found.column);
            found.top = select(is_met, top, found.top);
            column += 1.0;
            sought = sought & !is_met & leave.simd_lt(self.walks.end) & column.simd_lt(across);
            height = next;
            if !sought.any() {
                return found;
            }
        }
    }

    /// Texels from which on rays may meet something in the columns that were found.
    #[inline(always)]
    fn enter(&self, found: &Found, texels: &Field) -> Places {
        let one = Floats::splat(1.0);
        let start = found.column * SQUARE_SIDE;
        // Where the ray comes down to the top, or the line before.
        let reach = (found.top - self.walks.origin) / self.walks.direction;
        let along = self
            .major
            .place(reach)
            .fast_min(start + (SQUARE_SIDE - 1.0));
        let line = whole(along).fast_max(start);
        let is_above = |line: Floats| {
            let distance = self.major.crossing(line).fast_max(Floats::ZERO);
            self.height(distance).simd_gt(found.top)
        };
        let line = select(is_above(start) & is_above(line), line, start);
        let is_first = line.simd_le(self.major.origin);
        let line = select(is_first, whole(self.major.origin), line);
        let distance = !is_first & self.major.crossing(line);
        // A line of x is crossed before one of y at the same distance.
        let is_past = |row: Floats| {
            let crossing = self.minor.crossing(row);
            crossing.simd_lt(distance) | (!self.is_x & crossing.simd_le(distance))
        };
        let last = self.side - 1.0;
        let row = whole(self.minor.place(distance).fast_min(last));
        let is_before = row.simd_lt(last) & is_past(row + one);
        let is_after = row.simd_gt(Floats::ZERO) & !is_past(row) & !is_before;
        let row = row + (!is_first & ((is_before & one) - (is_after & one)));
        let texel = [select(self.is_x, line, row), select(self.is_x, row, line)];
        let [x, y] = texels.strides;
        let before = texels.index(texel) - select(self.is_x, x, y);
        Places {
            texel,
            before: select(is_first, -one, before),
            distance,
        }
    }

    /// The meetings in the columns that were found, and the rays that go on to the next ones.
    #[inline(always)]
    fn stroll(&self, texels: &Field, found: &Found, places: Places) -> (Meetings, Floats) {
        let one = Floats::splat(1.0);
        let (axis_x, axis_y, end) = (&self.walks.x, &self.walks.y, self.walks.end);
        let line = (found.column + 1.0) * SQUARE_SIDE;
        let limit_x = select(self.is_x, line, self.side);
        let limit_y = select(self.is_x, self.side, line);
        let Places {
            texel: [mut x, mut y],
            mut before,
            mut distance,
        } = places;
        let mut height = self.height(distance);
        let (mut strolling, mut onward) = (found.lanes, Floats::ZERO);
        let mut met = Meetings::default();
        loop {
            let (cross_x, cross_y) = (axis_x.crossing(x + one), axis_y.crossing(y + one));
            let leave = cross_x.fast_min(cross_y).fast_min(end);
            let next = self.height(leave);
            let index = texels.index([x, y]);
            let is_met = height.fast_min(next).simd_le(texels.at(index)) & strolling;
            met.lanes |= is_met;
            met.index = select(is_met, index, met.index);
            met.before = select(is_met, before, met.before);
            met.distance = select(is_met, distance, met.distance);
            met.leave = select(is_met, leave, met.leave);
            let is_x = cross_x.simd_le(cross_y);
            x += is_x & one;
            y += !is_x & one;
            let (in_x, in_y) = (x.simd_lt(limit_x), y.simd_lt(limit_y));
            strolling = strolling & !is_met & leave.simd_lt(end);
            onward |= strolling & !select(self.is_x, in_x, in_y);
            strolling = strolling & in_x & in_y;
            (height, distance, before) = (next, leave, index);
            if !strolling.any() {
                return (met, onward);
            }
        }
    }
}

/// Meetings of four rays, as [`Meeting`].
#[derive(Default)]
struct Meetings {
    lanes: Floats,
    index: Floats,
    before: Floats,
    distance: Floats,
    leave: Floats,
}

impl Meetings {
    #[inline(always)]
    fn each(&self, tell: &mut impl FnMut(usize, Meeting)) {
        let (index, before) = (self.index.to_array(), self.before.to_array());
        let (distance, leave) = (self.distance.to_array(), self.leave.to_array());
        let lanes = self.lanes.to_bitmask();
        for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
            let meeting = Meeting {
                index: index[lane] as i32,
                before: before[lane] as i32,
                distance: distance[lane],
                leave: leave[lane],
            };
            tell(lane, meeting);
        }
    }
}
