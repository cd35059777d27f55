//! Most bytes that a repository can have.

use super::BuildOptions;
use crate::Result;
use crate::codec::{DECISION_BITS, NUMBER_BITS, longest_blocks};
use crate::lattice::Lattice;
use crate::store::{EntropyKind, TransformKind, file_length};

/// Bytes of the weights and tables of one matrix in a group of levels: 32 contexts of 256 symbols. The frequencies of
/// a context add up to 2048, so that their lengths are at most those of 256 equal ones.
const MODEL_BYTES: u64 = 80 << 10;

/// Most bytes that [`build`](super::build) can make of a raster of heights without a reference system, unit or
/// metadata.
///
/// # Errors
///
/// Those of [`Lattice::new`] and [`BuildOptions::check`].
pub fn longest_repository(width: u32, height: u32, options: &BuildOptions) -> Result<u64> {
    options.check()?;
    let lattice = Lattice::new(width, height, options.cells_log2)?;
    let samples = u64::from(width) * u64::from(height);
    let (count, levels) = (lattice.diamond_count(), u64::from(lattice.levels()));
    let entries = (lattice.cells() * lattice.cells()) as u64;
    let matrices = if options.transform == TransformKind::TwoStage {
        2
    } else {
        1
    };
    let in_contexts = options.entropy == EntropyKind::Rans;
    // A sample is the centre of one diamond, and inside at most one diamond of each finer level.
    let inner = samples
        .saturating_mul(levels)
        .min(count.saturating_mul(entries));
    let coefficients = samples + (matrices - 1) * inner;
    let blocks = longest_blocks(count, coefficients, samples, in_contexts);
    let root_vertices = ((lattice.cells() + 1) * (lattice.cells() + 1)) as u64;
    let roots = root_vertices.min(samples) * (NUMBER_BITS + DECISION_BITS) / 8 + 8;
    let tables = if in_contexts {
        // A group for each level at most; a list of heights is only made where it is short against the samples.
        levels.max(1) * matrices * MODEL_BYTES + samples
    } else {
        0
    };
    Ok(file_length(roots, tables, count, blocks))
}
