//! The centres of a diamond by rows of the raster.

use super::planar::Placement;

/// Centres of a diamond in one row of the raster, evenly spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CentreRun {
    /// Row of the raster.
    pub row: i64,
    /// Column of the first.
    pub column: i64,
    /// Columns from one to the next.
    pub step: i64,
    /// How many.
    pub count: usize,
    /// Index of the first among the N^2 centres.
    pub index: usize,
    /// From the index of one to that of the next.
    pub stride: usize,
}

impl CentreRun {
    /// The part in columns `first` to `last`, both included; `None` where there is none.
    pub fn within(self, first: i64, last: i64) -> Option<CentreRun> {
        let end = self.column + self.step * (self.count as i64 - 1);
        if first > end || last < self.column {
            return None;
        }
        let skipped = ((first - self.column).max(0) + self.step - 1) / self.step;
        let kept = (last.min(end) - self.column).div_euclid(self.step) + 1 - skipped;
        (kept > 0).then_some(CentreRun {
            column: self.column + skipped * self.step,
            count: kept as usize,
            index: self.index + skipped as usize * self.stride,
            ..self
        })
    }
}

/// All centres of a refinable diamond of `cells` cells that lies so.
pub fn centre_runs(placement: Placement, cells: usize) -> impl Iterator<Item = CentreRun> {
    let Placement { origin, ax, .. } = placement;
    let (step, n) = (ax[0], cells as i64);
    let is_turned = ax[1] != 0;
    let rows = if is_turned { 1 - n..n } else { 0..n };
    rows.map(move |t| {
        if !is_turned {
            return CentreRun {
                row: origin[1] + step * t + step / 2,
                column: origin[0] + step / 2,
                step,
                count: cells,
                index: t as usize * cells,
                stride: 1,
            };
        }
        // Centre (i, j) is at column i + j + 1 and row t = j - i, in steps.
        let i = (-t).max(0);
        CentreRun {
            row: origin[1] + step * t,
            column: origin[0] + step * (2 * i + t + 1),
            step: 2 * step,
            count: (n - t.abs()) as usize,
            index: ((i + t) * n + i) as usize,
            stride: cells + 1,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::Lattice;

    #[test]
    fn runs_hold_every_centre_once_where_it_lies() {
        let lattice = Lattice::new(300, 200, 4).unwrap();
        let cells = lattice.cells();
        for rank in 0..lattice.diamond_count() {
            let placement = lattice.placement(lattice.diamond(rank));
            let mut seen = vec![0; cells * cells];
            for run in centre_runs(placement, cells) {
                for k in 0..run.count {
                    let index = run.index + k * run.stride;
                    let at = [run.column + k as i64 * run.step, run.row];
                    assert_eq!(at, placement.centre(index % cells, index / cells));
                    seen[index] += 1;
                }
            }
            assert!(seen.iter().all(|&times| times == 1));
        }
    }

    #[test]
    fn a_run_within_columns_keeps_just_the_centres_there() {
        let whole = CentreRun {
            row: 5,
            column: -7,
            step: 4,
            count: 9,
            index: 3,
            stride: 2,
        };
        let centres = |run: CentreRun| {
            let all = (0..run.count).map(move |k| (run.column + k as i64 * 4, run.index + 2 * k));
            all.collect::<Vec<_>>()
        };
        for (first, last) in (-12..35).flat_map(|first| (first..36).map(move |last| (first, last)))
        {
            let mut expected = centres(whole);
            expected.retain(|(column, _)| (first..=last).contains(column));
            let found = whole.within(first, last).map(centres).unwrap_or_default();
            assert_eq!(found, expected, "{first} to {last}");
        }
    }
}
