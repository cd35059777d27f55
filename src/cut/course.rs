//! A ray over the grid of samples, and its walk from square to square.

use std::hint::select_unpredictable;

/// Part of the heights' size by which a ray must pass above or below a range to be told apart from what is in it. Far
/// more than rounding errors come to, so that no ray slips between what is skipped and what is not.
const CLEARANCE: f64 = 1e-9;

/// A ray over the grid, and on which side of the surface it was seen last.
pub(super) struct Course {
    /// Column and row at 0, and per unit.
    pub start: [f64; 2],
    pub step: [f64; 2],
    /// Distance from column to column and from row to row; infinite along them.
    pub pace: [f64; 2],
    /// World z likewise.
    pub z: [f64; 2],
    /// Height above the surface where it was last looked at, if nothing but surface lay between; else NaN.
    pub above: f64,
}

/// Parts of an interval on both sides of a line, and how far on its side each comes.
pub(super) type Parts = [Option<(f64, [f64; 2])>; 2];

impl Course {
    pub(super) fn new(start: [f64; 2], step: [f64; 2], z: [f64; 2]) -> Course {
        let pace = step.map(|step| match step.recip() {
            pace if pace.is_finite() => pace,
            _ => f64::INFINITY,
        });
        Course {
            start,
            step,
            pace,
            z,
            above: f64::NAN,
        }
    }

    pub(super) fn grid(&self, t: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.start[axis] + t * self.step[axis])
    }

    pub(super) fn height(&self, t: f64) -> f64 {
        self.z[0] + t * self.z[1]
    }

    /// What the ray must keep from a range within which its heights over an interval are.
    pub(super) fn clearance(&self, interval: [f64; 2]) -> f64 {
        let [from, to] = interval.map(|t| self.height(t).abs());
        CLEARANCE * (1.0 + from.max(to))
    }

    /// Part of [0, longest] over a rectangle from the origin to `last`, and as high as what lies between two heights.
    pub(super) fn clipped(
        &self,
        last: [f64; 2],
        [low, high]: [f64; 2],
        longest: f64,
    ) -> Option<[f64; 2]> {
        let margin = CLEARANCE * (1.0 + low.abs().max(high.abs()));
        let bounds = [
            [0.0, last[0]],
            [0.0, last[1]],
            [low - margin, high + margin],
        ];
        let starts = [self.start[0], self.start[1], self.z[0]];
        let paces = [self.pace[0], self.pace[1], self.z[1].recip()];
        let [mut from, mut to] = [0.0, longest];
        for axis in 0..3 {
            let ([low, high], start, pace) = (bounds[axis], starts[axis], paces[axis]);
            if pace.is_finite() {
                let ends = [(low - start) * pace, (high - start) * pace];
                from = greatest(least(ends[0], ends[1]), from);
                to = least(greatest(ends[0], ends[1]), to);
            } else if !(low..=high).contains(&start) {
                return None;
            }
        }
        (from <= to).then_some([from, to])
    }

    /// The parts of an interval on both sides of the line from `a` to `b`, in the order of the ray; the first number is
    /// positive on the side of `side`.
    pub(super) fn split(
        &self,
        [a, b]: [[f64; 2]; 2],
        side: [f64; 2],
        [from, to]: [f64; 2],
    ) -> Parts {
        let across = |p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let sign = across(side).signum();
        let [first, last] = [from, to].map(|t| sign * across(self.grid(t)));
        if first * last < 0.0 {
            let between = (from + (to - from) * first / (first - last)).clamp(from, to);
            return [Some((first, [from, between])), Some((last, [between, to]))];
        }
        let only = if first == 0.0 { last } else { first };
        [Some((only, [from, to])), None]
    }

    /// Looks at the surface between two places of one triangle, at which the ray is so high above it, NaN if the triangle is
    /// not drawn: where it meets it. Where the surface goes on from the last triangle, the height found there counts, so that
    /// whatever rounding does there is one chain of heights, and a change of sign in it is within a triangle.
    #[inline]
    pub(super) fn meet(&mut self, [from, to]: [f64; 2], [first, last]: [f64; 2]) -> Option<f64> {
        let first = if self.above.is_nan() || first.is_nan() {
            first
        } else {
            self.above
        };
        self.above = last;
        let changes = first * last <= 0.0;
        if !changes {
            return None;
        }
        if first == 0.0 {
            return Some(from);
        }
        Some(from + (to - from) * (first / (first - last)))
    }
}

/// Where a ray is on its way over the cells between samples.
pub(super) struct Walk {
    pub t: f64,
    /// Its height at `t`.
    pub z: f64,
    /// The cell that it is over from `t` on.
    pub cell: [i32; 2],
    end: f64,
    /// Last column and row of cells.
    last: [i32; 2],
    /// Where the ray's distance to lines between cells is counted from.
    anchor: [f64; 2],
    /// As [`Course::pace`].
    pace: [f64; 2],
    /// 1 where columns or rows grow along the ray, else 0.
    grows: [i32; 2],
    clearance: f64,
}

/// Where a ray leaves a square.
pub(super) struct Exit {
    pub t: f64,
    /// Its height there.
    pub z: f64,
    /// It leaves over a line between columns; else rows.
    pub over_column: bool,
    /// The ray ends in the square.
    pub is_end: bool,
}

/// From square to square of one size.
pub(super) struct Steps {
    /// Column and row of the square, counted in squares.
    pub square: [i32; 2],
    /// What one step adds to them.
    ahead: [i32; 2],
    /// Where the ray passes the lines ahead between columns and between rows.
    next: [f64; 2],
    /// From one such line to the next.
    stride: [f64; 2],
}

impl Steps {
    #[inline]
    pub(super) fn exit(&self, course: &Course, walk: &Walk) -> Exit {
        let over_column = self.next[0] <= self.next[1];
        let ahead = least(self.next[0], self.next[1]);
        let t = greatest(walk.t, least(ahead, walk.end));
        Exit {
            t,
            z: course.height(t),
            over_column,
            is_end: ahead >= walk.end,
        }
    }

    /// Goes over a line between columns, else rows.
    #[inline]
    pub(super) fn advance(&mut self, over_column: bool) {
        // Which of them it is cannot be foretold.
        self.square[0] += select_unpredictable(over_column, self.ahead[0], 0);
        self.square[1] += select_unpredictable(over_column, 0, self.ahead[1]);
        self.next[0] += select_unpredictable(over_column, self.stride[0], 0.0);
        self.next[1] += select_unpredictable(over_column, 0.0, self.stride[1]);
    }

    /// Whether the square is in the larger one with these coordinates, which has 2^larger of them along a side.
    #[inline]
    pub(super) fn is_in(&self, square: [i32; 2], larger: u32) -> bool {
        (self.square[0] >> larger == square[0]) & (self.square[1] >> larger == square[1])
    }
}

impl Walk {
    /// Over the part of a ray that is over a raster of so many columns and rows of cells.
    pub(super) fn new(course: &Course, [from, to]: [f64; 2], cells: [i32; 2]) -> Walk {
        let last = cells.map(|count| count - 1);
        let at = course.grid(from);
        let is_along = course.pace.map(f64::is_infinite);
        Walk {
            t: from,
            z: course.height(from),
            cell: [0, 1].map(|axis| (at[axis] as i32).clamp(0, last[axis])),
            end: to,
            last,
            // Lines along the ray are infinitely far: all that are asked for are ahead of -1.
            anchor: [0, 1].map(|axis| {
                if is_along[axis] {
                    -1.0
                } else {
                    course.start[axis]
                }
            }),
            pace: course.pace,
            grows: [0, 1].map(|axis| i32::from(course.pace[axis] > 0.0)),
            clearance: course.clearance([from, to]),
        }
    }

    /// From the square of 2^step cells a side around the cell.
    #[inline]
    pub(super) fn steps(&self, step: u32) -> Steps {
        let square = self.cell.map(|along| along >> step);
        let line = |axis: usize| f64::from((square[axis] + self.grows[axis]) << step);
        let size = f64::from(1 << step);
        Steps {
            square,
            ahead: self.grows.map(|grows| 2 * grows - 1),
            next: [0, 1].map(|axis| (line(axis) - self.anchor[axis]) * self.pace[axis]),
            stride: self.pace.map(|pace| pace.abs() * size),
        }
    }

    /// Whether the ray is above or below a range all the way to an exit.
    #[inline]
    pub(super) fn passes(&self, exit: &Exit, [low, high]: [f32; 2]) -> bool {
        let is_above = least(self.z, exit.z) - self.clearance > f64::from(high);
        let is_below = greatest(self.z, exit.z) + self.clearance < f64::from(low);
        is_above | is_below
    }

    /// Goes to an exit.
    #[inline]
    pub(super) fn go_on(&mut self, exit: &Exit) {
        (self.t, self.z) = (exit.t, exit.z);
    }

    /// Finds the cell that the ray is over, in the square of 2^step cells a side: rounding may put the place beside it. The last column and
    /// row of samples belong to the cells before them.
    #[inline]
    pub(super) fn enter(&mut self, course: &Course, square: [i32; 2], step: u32) {
        let at = course.grid(self.t);
        self.cell = [0, 1].map(|axis| {
            let first = square[axis] << step;
            let last = (first + (1 << step) - 1).min(self.last[axis]);
            (at[axis] as i32).min(last).max(first)
        });
    }

    /// Goes over a line between columns, else rows, into the square of 2^step cells a side beside the present one, which may be beside
    /// the raster. The line is a multiple of 2 to the power that is returned.
    pub(super) fn advance(&mut self, course: &Course, over_column: bool, step: u32) -> u32 {
        let axis = usize::from(!over_column);
        let mut square = self.cell.map(|along| along >> step);
        let line = (square[axis] + self.grows[axis]) << step;
        square[axis] += 2 * self.grows[axis] - 1;
        self.enter(course, square, step);
        line.trailing_zeros()
    }

    pub(super) fn is_over_raster(&self) -> bool {
        (0..2).all(|axis| (0..=self.last[axis]).contains(&self.cell[axis]))
    }
}

/// The less of two numbers; the second where one is NaN. Unlike `f64::min` a single instruction.
#[inline]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The greater of two numbers; the second where one is NaN.
#[inline]
fn greatest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}
