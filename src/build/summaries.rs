//! The stored error and height range of every diamond.

use super::descent::{Descent, extremes, union};
use super::leaf::{Deviation, Tile, walk_tiles};
use super::surface::{Finding, look_at};
use crate::Result;
use crate::codec::{Components, ErrorCode, RangeCode};
use crate::lattice::Lattice;

/// What is stored of all diamonds beside their blocks.
pub(super) struct Summaries {
    /// Error, low and high code of every diamond by rank (`codec::bounds`).
    pub(super) codes: Vec<[u8; 3]>,
    /// What the codes of level 0 refer to.
    pub(super) range: [i32; 2],
}

/// The summaries after a whole descent, and how far it came from the input. The range is that of the input,
/// widened to contain every decoded height. `step` is told of samples measured.
pub(super) fn summarise(
    descent: &Descent,
    components: &Components,
    threads: usize,
    step: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<(Summaries, Deviation)> {
    let lattice = descent.levels.lattice;
    let mut findings = vec![Finding::default(); lattice.diamond_count() as usize];
    let has_voids = descent.levels.plane.void_samples > 0;
    let look = |tile: &Tile| {
        let mut seen = Vec::new();
        for level in 0..lattice.levels() {
            for diamond in lattice.diamonds_around(level, tile.first, tile.last) {
                let vertices = descent.vertices(diamond)?;
                let finding = look_at(lattice, diamond, &vertices, tile, has_voids);
                seen.push((lattice.rank(diamond), finding));
            }
        }
        Ok(seen)
    };
    let deviation = walk_tiles(descent, components, threads, look, |seen, samples| {
        for (rank, finding) in seen {
            findings[rank as usize].merge(finding);
        }
        step(samples)
    })?;
    let mut errors: Vec<f64> = findings.iter().map(Finding::error).collect();
    let mut ranges = descent.ranges.clone();
    nest(lattice, &mut errors, &mut ranges);
    // The root contains all, but a root alone has no summary.
    let widest = ranges.first().copied();
    let widest = widest.unwrap_or(extremes(&descent.root, components.count()));
    let range = union(components.range(0), widest);
    let codes = encode(lattice, &errors, &ranges, range);
    Ok((Summaries { codes, range }, deviation))
}

/// Makes every diamond's error and range contain those of its children.
fn nest(lattice: &Lattice, errors: &mut [f64], ranges: &mut [[i32; 2]]) {
    for rank in (0..errors.len()).rev() {
        let diamond = lattice.diamond(rank as u64);
        for parent in lattice.parents(diamond).into_iter().flatten() {
            let parent = lattice.rank(parent) as usize;
            errors[parent] = errors[parent].max(errors[rank]);
            ranges[parent] = union(ranges[parent], ranges[rank]);
        }
    }
}

fn encode(lattice: &Lattice, errors: &[f64], ranges: &[[i32; 2]], whole: [i32; 2]) -> Vec<[u8; 3]> {
    let mut decoded: Vec<[i32; 2]> = Vec::with_capacity(ranges.len());
    let mut codes = Vec::with_capacity(ranges.len());
    for (rank, (&error, &range)) in errors.iter().zip(ranges).enumerate() {
        let parents = lattice.parents(lattice.diamond(rank as u64));
        let reference = match parents.into_iter().flatten().next() {
            Some(parent) => decoded[lattice.rank(parent) as usize],
            None => whole,
        };
        let code = RangeCode::covering(range, reference);
        decoded.push(code.range(reference));
        codes.push([ErrorCode::covering(error).0, code.low, code.high]);
    }
    codes
}
