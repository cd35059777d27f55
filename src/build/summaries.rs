//! The stored error and height range of every diamond.

use super::descent::Descent;
use super::levels::Levels;
use super::surface::LeafSurface;
use super::workers::map_in_order;
use crate::Result;
use crate::codec::{ErrorCode, Matrix, RangeCode};

/// What is stored of all diamonds beside their blocks.
pub(super) struct Summaries {
    /// Error, low and high code of every diamond by rank (`codec::bounds`).
    pub(super) codes: Vec<[u8; 3]>,
    /// What the codes of level 0 refer to.
    pub(super) range: [i32; 2],
}

/// The summaries after a whole descent. `range` is that of the input, widened here to contain every
/// decoded height. `step` is told of samples measured.
pub(super) fn summarise(
    levels: &Levels,
    descent: &Descent,
    range: [i32; 2],
    threads: usize,
    step: &mut dyn FnMut(u64) -> Result<()>,
) -> Result<Summaries> {
    let lattice = levels.lattice;
    let count = lattice.diamond_count() as usize;
    let surface = LeafSurface {
        lattice,
        plane: levels.plane,
        heights: &descent.heights,
    };
    let mut errors = Vec::with_capacity(count);
    let per_level = levels.plane.count() as u64;
    let measure =
        |rank: usize| surface.error_of(lattice.diamond(rank as u64), &descent.vertices[rank]);
    map_in_order(threads, count, measure, |rank, error| {
        errors.push(error);
        let ranks = lattice.level_ranks(lattice.diamond(rank as u64).level());
        step(per_level / (ranks.end - ranks.start))
    })?;
    let ranges = nest(levels, descent, &mut errors);
    // The root contains all, but a root alone has no summary.
    let widest = ranges.first().copied();
    let range = union(
        range,
        widest.unwrap_or(extremes(&descent.vertices[0], levels.components)),
    );
    let codes = encode(levels, &errors, &ranges, range);
    Ok(Summaries { codes, range })
}

/// Makes every diamond's error and range contain those of its children; returns the ranges.
fn nest(levels: &Levels, descent: &Descent, errors: &mut [f64]) -> Vec<[i32; 2]> {
    let (lattice, count) = (levels.lattice, errors.len());
    let mut ranges: Vec<[i32; 2]> = {
        let vertices = descent.vertices[..count].iter();
        vertices
            .map(|own| extremes(own, levels.components))
            .collect()
    };
    let last_level = lattice.levels().saturating_sub(1);
    let last_start = count - descent.refined.len().min(count);
    for rank in (0..count).rev() {
        let diamond = lattice.diamond(rank as u64);
        if diamond.level() == last_level {
            let refined = &descent.refined[rank - last_start];
            ranges[rank] = union(ranges[rank], extremes(&refined.centres, levels.components));
            if let Some(vertices) = &refined.vertices {
                ranges[rank] = union(ranges[rank], extremes(vertices, levels.components));
            }
        }
        for parent in lattice.parents(diamond).into_iter().flatten() {
            let parent = lattice.rank(parent) as usize;
            errors[parent] = errors[parent].max(errors[rank]);
            ranges[parent] = union(ranges[parent], ranges[rank]);
        }
    }
    ranges
}

fn encode(levels: &Levels, errors: &[f64], ranges: &[[i32; 2]], whole: [i32; 2]) -> Vec<[u8; 3]> {
    let lattice = levels.lattice;
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

/// Least and greatest height of a matrix; of colours, of the first of their components.
fn extremes(matrix: &Matrix, components: usize) -> [i32; 2] {
    let own = || matrix.values[..matrix.values.len() / components].iter();
    let least = own().copied().min().unwrap_or_default();
    let greatest = own().copied().max().unwrap_or_default();
    [least, greatest]
}

/// The least range that contains both.
fn union(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}
