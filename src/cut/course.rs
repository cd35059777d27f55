//! A ray over the grid of samples, and its walk from square to square.

/// Part of the heights' size by which a ray must pass above or below a range to be told apart from what is in it. Far
/// more than rounding errors come to, so that no ray slips between what is skipped and what is not.
const CLEARANCE: f64 = 1e-9;

/// A ray over the grid, and on which side of the surface it was seen last.
pub(super) struct Course {
    /// Column and row at 0, and per unit.
    pub start: [f64; 2],
    pub step: [f64; 2],
    /// World z likewise.
    pub z: [f64; 2],
    /// Height above the surface where it was last looked at, if nothing but surface lay between; else NaN.
    pub above: f64,
}

/// Parts of an interval on both sides of a line, and how far on its side each comes.
pub(super) type Parts = [Option<(f64, [f64; 2])>; 2];

impl Course {
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
        let slabs = [
            ([self.start[0], self.step[0]], [0.0, last[0]]),
            ([self.start[1], self.step[1]], [0.0, last[1]]),
            (self.z, [low - margin, high + margin]),
        ];
        let [mut from, mut to] = [0.0, longest];
        for ([start, step], [low, high]) in slabs {
            if step == 0.0 {
                if !(low..=high).contains(&start) {
                    return None;
                }
                continue;
            }
            let ends = [low, high].map(|end| (end - start) / step);
            from = ends[0].min(ends[1]).max(from);
            to = ends[0].max(ends[1]).min(to);
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
        Some((from + (to - from) * (first / (first - last))).clamp(from, to))
    }

    /// Column and row within a cell.
    #[inline]
    pub(super) fn within(&self, cell: [i32; 2], t: f64) -> [f64; 2] {
        let [column, row] = self.grid(t);
        [column - f64::from(cell[0]), row - f64::from(cell[1])].map(|along| along.clamp(0.0, 1.0))
    }
}

/// Where a ray is on its way over the cells between samples.
pub(super) struct Walk {
    pub t: f64,
    /// The cell that it is over from `t` on.
    pub cell: [i32; 2],
    end: f64,
    /// Last column and row of cells.
    last: [i32; 2],
    /// Where lines between cells are counted from, and the distance of the ray from one to the next.
    anchor: [f64; 2],
    pace: [f64; 2],
    /// 1 where columns or rows grow along the ray, else 0.
    grows: [i32; 2],
    clearance: f64,
}

/// Where a ray leaves a square.
pub(super) struct Exit {
    pub t: f64,
    /// It leaves over a line between columns; else rows.
    over_column: bool,
    /// The number of the line.
    line: i32,
    /// The ray ends in the square.
    pub is_end: bool,
}

impl Walk {
    /// Over the part of a ray that is over a raster of so many columns and rows of cells.
    pub(super) fn new(course: &Course, [from, to]: [f64; 2], cells: [i32; 2]) -> Walk {
        let last = cells.map(|count| count - 1);
        let at = course.grid(from);
        let pace = course.step.map(f64::recip);
        Walk {
            t: from,
            cell: [0, 1].map(|axis| (at[axis] as i32).clamp(0, last[axis])),
            end: to,
            last,
            // Along a line all others are infinitely far: they are all ahead of such an anchor.
            anchor: [0, 1].map(|axis| match pace[axis].is_finite() {
                true => course.start[axis],
                false => -1.0,
            }),
            pace: pace.map(|pace| {
                if pace.is_finite() {
                    pace
                } else {
                    f64::INFINITY
                }
            }),
            grows: [0, 1].map(|axis| i32::from(pace[axis] > 0.0 || !pace[axis].is_finite())),
            clearance: course.clearance([from, to]),
        }
    }

    /// Where the ray leaves the square of 2^step cells a side that it is in.
    #[inline]
    pub(super) fn exit(&self, step: u32) -> Exit {
        let line = |axis: usize| ((self.cell[axis] >> step) + self.grows[axis]) << step;
        let at = |axis: usize, line: i32| (f64::from(line) - self.anchor[axis]) * self.pace[axis];
        let lines = [line(0), line(1)];
        let [column, row] = [at(0, lines[0]), at(1, lines[1])];
        let over_column = column <= row;
        let t = if over_column { column } else { row };
        Exit {
            t: if t < self.end { t } else { self.end }.max(self.t),
            over_column,
            line: if over_column { lines[0] } else { lines[1] },
            is_end: t >= self.end,
        }
    }

    /// Whether the ray is above or below a range all the way to an exit.
    #[inline]
    pub(super) fn passes(&self, course: &Course, exit: &Exit, [low, high]: [f32; 2]) -> bool {
        let ends = [course.height(self.t), course.height(exit.t)];
        ends[0].min(ends[1]) - self.clearance > f64::from(high)
            || ends[0].max(ends[1]) + self.clearance < f64::from(low)
    }

    /// Goes to the cell beyond an exit of the square of 2^step cells a side, which may be beside the raster. The line between is a
    /// multiple of 2 to the power that is returned.
    #[inline]
    pub(super) fn advance(&mut self, course: &Course, exit: &Exit, step: u32) -> u32 {
        let at = course.grid(exit.t);
        let beside = |axis: usize| {
            // Rounding may put the place beside the square that it leaves.
            let first = self.cell[axis] >> step << step;
            (at[axis] as i32).clamp(first, first + (1 << step) - 1)
        };
        let beyond = |axis: usize| exit.line - 1 + self.grows[axis];
        self.cell = match exit.over_column {
            true => [beyond(0), beside(1)],
            false => [beside(0), beyond(1)],
        };
        self.t = exit.t;
        exit.line.trailing_zeros()
    }

    pub(super) fn is_over_raster(&self) -> bool {
        (0..2).all(|axis| (0..=self.last[axis]).contains(&self.cell[axis]))
    }
}
