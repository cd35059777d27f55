//! The order of diamonds within a level: the Morton curve over a rectangle of lattice positions.

/// Positions of a level: all, or only those with x + y odd, of a rectangle at the origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    width: u64,
    height: u64,
    checkered: bool,
    /// The last position of a checkered rectangle is missing. It is the last of the order.
    without_corner: bool,
}

impl Extent {
    pub(super) fn full(width: u64, height: u64) -> Extent {
        Extent {
            width,
            height,
            checkered: false,
            without_corner: false,
        }
    }

    pub(super) fn checkered(width: u64, height: u64, without_corner: bool) -> Extent {
        Extent {
            width,
            height,
            checkered: true,
            without_corner,
        }
    }

    pub(super) fn count(&self) -> u64 {
        self.count_in([0, 0], u64::MAX, u64::MAX) - u64::from(self.without_corner)
    }

    /// Positions in the part of the rectangle that starts at `from` and spans at most `width` x
    /// `height`, the missing corner counted.
    fn count_in(&self, from: [u64; 2], width: u64, height: u64) -> u64 {
        let area = self.width.saturating_sub(from[0]).min(width)
            * self.height.saturating_sub(from[1]).min(height);
        if self.checkered {
            (area + (from[0] + from[1]) % 2) / 2
        } else {
            area
        }
    }

    fn bits(&self) -> u32 {
        u64::BITS - self.width.max(self.height).leading_zeros()
    }

    pub(super) fn rank(&self, at: [u64; 2]) -> u64 {
        let (mut from, mut before) = ([0, 0], 0);
        for bit in (0..self.bits()).rev() {
            let half = 1u64 << bit;
            if at[1] & half != 0 {
                before += self.count_in(from, 2 * half, half);
                from[1] += half;
            }
            if at[0] & half != 0 {
                before += self.count_in(from, half, half);
                from[0] += half;
            }
        }
        before
    }

    pub(super) fn position(&self, mut rank: u64) -> [u64; 2] {
        let mut from = [0, 0];
        for bit in (0..self.bits()).rev() {
            let half = 1u64 << bit;
            let upper = self.count_in(from, 2 * half, half);
            if rank >= upper {
                rank -= upper;
                from[1] += half;
            }
            let left = self.count_in(from, half, half);
            if rank >= left {
                rank -= left;
                from[0] += half;
            }
        }
        from
    }

    pub(super) fn positions(&self) -> Vec<[u64; 2]> {
        let mut all = Vec::with_capacity(self.count() as usize);
        self.collect([0, 0], 1 << self.bits(), &mut all);
        all.truncate(self.count() as usize);
        all
    }

    fn collect(&self, from: [u64; 2], side: u64, all: &mut Vec<[u64; 2]>) {
        if from[0] >= self.width || from[1] >= self.height {
            return;
        }
        if side == 1 {
            if !self.checkered || (from[0] + from[1]) % 2 == 1 {
                all.push(from);
            }
            return;
        }
        let half = side / 2;
        for (x, y) in [(0, 0), (half, 0), (0, half), (half, half)] {
            self.collect([from[0] + x, from[1] + y], half, all);
        }
    }
}
