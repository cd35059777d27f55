//! Whether new samples leave all that holds for a whole raster as it is.

use super::decoder::{Decoder, decode_chunks};
use super::{Predecessor, Replacement};
use crate::build::leaf::Tile;
use crate::codec::Units;
use crate::lattice::Diamond;
use crate::{Error, Result};

/// How many samples are void afterwards. `None` where the range of all samples, whether any is void, the unit of
/// floats or the list of heights would be others, or may be.
pub(super) fn void_samples_after(
    old: &Predecessor,
    new: &Replacement,
    decoder: &mut Decoder,
    threads: usize,
) -> Result<Option<u64>> {
    let before = decoder.tile(new.corners())?;
    let heights = |place| [before.height(place), new.height(old.units, place).flatten()];
    let mut voids = [0; 2];
    // Ends that were in the rectangle, and that still are.
    let mut has = [[false; 2]; 2];
    let [low, high] = old.units.range;
    for place in new.places() {
        for (side, height) in heights(place).into_iter().enumerate() {
            let Some(height) = height else {
                voids[side] += 1;
                continue;
            };
            if !(low..=high).contains(&height) {
                return Ok(None);
            }
            has[side][0] |= height == low;
            has[side][1] |= height == high;
        }
    }
    let header = old.store.header();
    let after = header.void_samples - voids[0] + voids[1];
    let is_same = (after > 0) == (header.void_samples > 0)
        && keeps_unit(old.units, &before, new)
        && keeps_list(old, new);
    if !is_same {
        return Ok(None);
    }
    let [was, is] = has;
    let missing = [(0, low), (1, high)]
        .into_iter()
        .filter(|&(end, _)| was[end] && !is[end]);
    let missing: Vec<i32> = missing.map(|(_, height)| height).collect();
    let is_elsewhere = missing.is_empty() || are_elsewhere(old, new, missing, threads)?;
    Ok(is_elsewhere.then_some(after))
}

/// Whether a build would choose the unit of floats that it did. It takes the first that divides all samples.
fn keeps_unit(units: &Units, before: &Tile, new: &Replacement) -> bool {
    if units.sample_type.is_integer() {
        return true;
    }
    let divides = |number: f64, unit: f64| Units::is_multiple(units.sample_type, number, unit);
    let after = |unit: f64| {
        new.samples
            .iter()
            .all(|&number| number.is_nan() || divides(number, unit))
    };
    let was = |unit: f64| {
        let mut heights = new.places().filter_map(|place| before.height(place));
        heights.all(|height| divides(units.to_sample(height), unit))
    };
    // A unit before that one did not divide what was there. It still does not where the rest was to blame.
    let mut before_it = Units::whole_units().take_while(|&unit| unit != units.scale);
    after(units.scale) && before_it.all(|unit| was(unit) || !after(unit))
}

/// Whether the tables' list of heights has all that are new.
fn keeps_list(old: &Predecessor, new: &Replacement) -> bool {
    let listed = old.codec.model().and_then(|model| model.listed.as_ref());
    let mut numbers = new.samples.iter().filter(|number| !number.is_nan());
    listed.is_none_or(|listed| numbers.all(|&number| listed.contains(old.units.to_unit(number))))
}

/// Whether each of these heights is one of a sample outside the rectangle. Looks no further than it must.
fn are_elsewhere(
    old: &Predecessor,
    new: &Replacement,
    mut heights: Vec<i32>,
    threads: usize,
) -> Result<bool> {
    enum End {
        Found,
        Failed(Error),
    }
    let sought = heights.clone();
    let look = |decoder: &mut Decoder, diamonds: &[Diamond]| -> Result<Vec<i32>> {
        let mut found = Vec::new();
        for &diamond in diamonds {
            for &height in &sought {
                if !found.contains(&height) && has_outside(old, new, decoder, diamond, height)? {
                    found.push(height);
                }
            }
        }
        Ok(found)
    };
    let finest = old.lattice.diamonds(old.lattice.levels() - 1);
    let ended = decode_chunks(
        || Decoder::before(old),
        &finest,
        threads,
        look,
        |found| {
            let found = found.map_err(End::Failed)?;
            heights.retain(|height| !found.contains(height));
            match heights.is_empty() {
                true => Err(End::Found),
                false => Ok(()),
            }
        },
    );
    match ended {
        Ok(()) => Ok(false),
        Err(End::Found) => Ok(true),
        Err(End::Failed(error)) => Err(error),
    }
}

/// Whether a diamond of the finest refinable level has a sample of this height that lies outside the rectangle.
fn has_outside(
    old: &Predecessor,
    new: &Replacement,
    decoder: &mut Decoder,
    diamond: Diamond,
    height: i32,
) -> Result<bool> {
    let state = decoder.state(diamond)?;
    let (placement, cells) = (old.lattice.placement(diamond), old.lattice.cells());
    let (vertices, centres) = (&state.vertices, &state.refined.centres);
    let side = cells + 1;
    let is_outside = |at| old.lattice.in_raster(at) && !new.contains(at);
    let mut all = 0..side * side;
    let is_vertex = all.any(|index| {
        vertices.values[index] == height
            && vertices.is_valid(index)
            && is_outside(placement.vertex(index % side, index / side))
    });
    Ok(is_vertex
        || (0..cells * cells).any(|index| {
            centres.values[index] == height
                && centres.is_valid(index)
                && is_outside(placement.centre(index % cells, index / cells))
        }))
}
