//! A copy of a repository without what is damaged, and what that costs.

use super::Progress;
use crate::codec::ErrorCode;
use crate::cut::Layer;
use crate::lattice::{Diamond, Lattice};
use crate::store::{FileSink, Kept};
use crate::{Error, Result};
use std::path::Path;

/// What a repair found and left.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RepairReport {
    /// Blocks that were damaged, or whose page of the index was.
    pub damaged_blocks: u64,
    /// Those of them that are now missing; a page of the index with a single wrong bit costs none.
    pub lost_blocks: u64,
    /// All blocks that are missing now, those of earlier repairs too.
    pub missing_blocks: u64,
    /// Diamonds that can no longer be refined: those whose blocks are missing, and all their descendants.
    pub blocked_blocks: u64,
    /// Samples of the raster, void ones too, that lie inside such a diamond.
    pub coarse_samples: u64,
    /// The same in percent of all samples.
    pub coarse_percent: f64,
    /// The coarsest level of a diamond whose block is missing.
    pub coarsest_level: Option<u32>,
    /// The repository's leaf level.
    pub levels: u32,
    /// Bytes of the repaired file.
    pub bytes: u64,
}

/// Writes a repository without what is damaged to `output`, which may be the file itself: it is written beside it
/// and takes its name when it is whole, and whoever has the old file open goes on with that. A file without
/// damage is copied byte for byte, or left alone where it is its own output.
///
/// Blocks that fail their checksum are marked as missing, and so are those of a damaged page of the index, since
/// nothing verifies where they lie; but a page whose checksum comes right when one bit is turned is restored.
/// What such a page said of errors and ranges is lost with it: a diamond then has the least error of its
/// parents and the range of its first one, and its descendants, whose ranges referred to it, have that range too.
///
/// Header, metadata, roots and tables cannot be repaired: all else refers to them. Heights would survive without
/// the metadata, but not what they mean: their unit and their place on the Earth.
///
/// # Errors
///
/// [`Error::Damaged`] where the file cannot be opened, naming the part; [`Error::Version`] for one that a later
/// version wrote; those of writing; [`Error::Cancelled`]. Nothing is left under the output's name then, or what
/// was there before.
pub fn repair(file: &Path, output: &Path, progress: Progress) -> Result<RepairReport> {
    let layer = Layer::open_damaged(file).map_err(beyond_repair)?;
    let lattice = layer.lattice();
    let count = lattice.diamond_count();
    let mut copies = Copies::new(lattice);
    let mut recode = |kept: Kept| {
        if kept.rank.is_multiple_of(1024) && !progress(kept.rank, count) {
            return Err(Error::Cancelled);
        }
        Ok(copies.add(kept))
    };
    let sink = Box::new(FileSink::create(output)?);
    let repaired = layer
        .store()
        .repair(output, sink, file == output, &mut recode)?;
    progress(count, count);
    let coarse_samples = copies.coarse_samples();
    let samples = u64::from(lattice.width()) * u64::from(lattice.height());
    Ok(RepairReport {
        damaged_blocks: repaired.damaged_blocks,
        lost_blocks: repaired.lost_blocks,
        missing_blocks: repaired.missing_blocks,
        blocked_blocks: copies.blocked().count() as u64,
        coarse_samples,
        coarse_percent: 100.0 * coarse_samples as f64 / samples as f64,
        // Ranks ascend with levels, and the first that is blocked is missing itself.
        coarsest_level: copies.blocked().next().map(Diamond::level),
        levels: lattice.levels(),
        bytes: repaired.bytes,
    })
}

fn beyond_repair(error: Error) -> Error {
    match error {
        Error::Damaged { path, message } => Error::Damaged {
            path,
            message: format!("{message}; without that part nothing can be repaired"),
        },
        error => error,
    }
}

/// What a copy says of the diamonds so far, by rank.
struct Copies<'a> {
    lattice: &'a Lattice,
    errors: Vec<u8>,
    /// Whose range is not that which its stored codes gave.
    has_other_range: Vec<bool>,
    is_blocked: Vec<bool>,
}

impl Copies<'_> {
    fn new(lattice: &Lattice) -> Copies<'_> {
        Copies {
            lattice,
            errors: Vec::new(),
            has_other_range: Vec::new(),
            is_blocked: Vec::new(),
        }
    }

    /// The error, low and high code of the next diamond in the copy. Errors and ranges contain those of all
    /// descendants, so that those of a parent are bounds too.
    fn add(&mut self, kept: Kept) -> [u8; 3] {
        let diamond = self.lattice.diamond(kept.rank);
        let parents = self.lattice.parents(diamond).into_iter().flatten();
        let parents: Vec<usize> = parents.map(|d| self.lattice.rank(d) as usize).collect();
        let least = parents.iter().map(|&parent| self.errors[parent]).min();
        let has_other_range = kept.codes.is_none()
            || parents
                .first()
                .is_some_and(|&parent| self.has_other_range[parent]);
        let mut codes = kept
            .codes
            .unwrap_or([least.unwrap_or(ErrorCode::UNBOUNDED.0), 0, 0]);
        if has_other_range {
            codes = [codes[0], 0, 0];
        }
        let is_blocked = kept.is_missing || parents.iter().any(|&parent| self.is_blocked[parent]);
        self.errors.push(codes[0]);
        self.has_other_range.push(has_other_range);
        self.is_blocked.push(is_blocked);
        codes
    }

    /// The diamonds that cannot be refined.
    fn blocked(&self) -> impl Iterator<Item = Diamond> {
        let ranks = (0..)
            .zip(&self.is_blocked)
            .filter(|&(_, &is_blocked)| is_blocked);
        ranks.map(|(rank, _)| self.lattice.diamond(rank))
    }

    /// Samples inside any of them.
    fn coarse_samples(&self) -> u64 {
        self.blocked()
            .map(|diamond| samples_finest_around(self.lattice, diamond))
            .sum()
    }
}

/// Samples whose finest refinable diamond around them ([`Lattice::finest_around`]) this is.
fn samples_finest_around(lattice: &Lattice, diamond: Diamond) -> u64 {
    let cells = lattice.cells() as i64;
    let [x, y] = lattice
        .placement(diamond)
        .vertex(lattice.cells() / 2, lattice.cells() / 2);
    let [width, height] = [lattice.width(), lattice.height()].map(i64::from);
    match lattice.levels() - diamond.level() {
        // All inside a turned square; its half diagonals have `cells` samples.
        1 => (1 - cells..cells)
            .filter(|dy| (0..height).contains(&(y + dy)))
            .map(|dy| {
                let reach = cells - 1 - dy.abs();
                let (first, last) = ((x - reach).max(0), (x + reach).min(width - 1));
                (last - first + 1).max(0) as u64
            })
            .sum(),
        // Those on its diagonals, along which the squares of the next level meet.
        2 => (1 - cells..cells)
            .flat_map(|d| {
                [[x + d, y + d], [x + d, y - d]]
                    .into_iter()
                    .take(if d == 0 { 1 } else { 2 })
            })
            .filter(|&at| lattice.in_raster(at))
            .count() as u64,
        // Its centre: all else is inside a diamond of the next two levels.
        _ => u64::from(lattice.in_raster([x, y])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_sample_belongs_to_the_finest_diamond_around_it(
            (width, height, cells_log2) in (2u32..150, 2u32..150, 2u32..5),
        ) {
            let lattice = Lattice::new(width, height, cells_log2).unwrap();
            let mut found = vec![0u64; lattice.diamond_count() as usize];
            for index in 0..i64::from(width) * i64::from(height) {
                let at = [index % i64::from(width), index / i64::from(width)];
                if let Some((diamond, _)) = lattice.finest_around(at) {
                    found[lattice.rank(diamond) as usize] += 1;
                }
            }
            let counted = (0..lattice.diamond_count())
                .map(|rank| samples_finest_around(&lattice, lattice.diamond(rank)));
            prop_assert_eq!(counted.collect::<Vec<_>>(), found);
        }
    }
}
