//! The check of a whole repository: checksums, decoding, and the distance from its input.

use super::Progress;
use super::bands::Bands;
use crate::build::source::RasterSource;
use crate::cut::{Layer, Window};
use crate::lattice::{Diamond, Lattice};
use crate::store::{Damage, Verification};
use crate::{Error, Result};
use std::ops::RangeInclusive;

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Damaged blocks, coarse levels first. Where there are any, nothing was compared.
    pub damage: Vec<DamagedBlocks>,
    /// Blocks that are missing since a repair, in the same order. Nothing is wrong with the file because of them.
    pub missing: Vec<MissingBlocks>,
    /// Samples of the leaf level whose detail is missing, where all was decoded.
    pub coarse_samples: Option<u64>,
    /// The distance from the input, where one was given and every block can be decoded.
    pub comparison: Option<Comparison>,
    /// Whether nothing is damaged and the input, if given, is kept as the repository promises.
    pub ok: bool,
}

impl Verdict {
    /// Count of blocks that cannot be used.
    pub fn damaged_blocks(&self) -> u64 {
        self.damage.iter().map(|damage| damage.blocks).sum()
    }

    /// Count of blocks that are missing.
    pub fn missing_blocks(&self) -> u64 {
        self.missing.iter().map(|missing| missing.blocks).sum()
    }
}

/// Neighbouring blocks that are missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingBlocks {
    /// How many.
    pub blocks: u64,
    /// Their levels and diamonds, in one line.
    pub description: String,
}

/// Neighbouring blocks that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedBlocks {
    /// How many.
    pub blocks: u64,
    /// Their levels and diamonds, and the cause, in one line.
    pub description: String,
}

/// The distance of decoded samples from the input's. Where detail is missing nothing is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Largest |decoded - input| over all samples that are valid in both, in sample units.
    pub max_error: f64,
    /// Root of the mean square of the same; of colours over red, green and blue.
    pub rms_error: f64,
    /// Samples that are void in one and valid in the other.
    pub void_mismatches: u64,
}

/// Verifies every checksum, then decodes every sample, and compares it with the input's if there is one.
///
/// # Errors
///
/// Those of reading the input; [`Error::Argument`] where its shape is not the repository's;
/// [`Error::Cancelled`]. Damage is no error.
pub fn verify(
    layer: &Layer,
    mut against: Option<&mut dyn RasterSource>,
    progress: Progress,
) -> Result<Verdict> {
    if let Some(source) = &against {
        check_shape(layer, &**source)?;
    }
    let found = layer.store().verify();
    let mut damage = broken_checksums(layer, &found);
    let mut sums = Sums::default();
    let mut coarse_samples = None;
    if damage.is_empty() {
        (damage, coarse_samples) = decode_all(layer, &mut against, &mut sums, progress)?;
    }
    let comparison = (against.is_some() && damage.is_empty()).then(|| sums.comparison());
    let kept = comparison.is_none_or(|found| {
        found.max_error <= layer.header().max_error_bound && found.void_mismatches == 0
    });
    Ok(Verdict {
        ok: damage.is_empty() && kept,
        damage,
        missing: missing(layer, &found),
        coarse_samples,
        comparison,
    })
}

fn check_shape(layer: &Layer, source: &dyn RasterSource) -> Result<()> {
    let (stored, given) = (&layer.header().raster, source.info());
    if stored.bands != given.bands {
        return Err(Error::Argument(format!(
            "its samples have {} bands, those of the input to compare with {}",
            stored.bands, given.bands
        )));
    }
    if (stored.width, stored.height) == (given.width, given.height) {
        return Ok(());
    }
    Err(Error::Argument(format!(
        "it has {} x {} samples, the input to compare with {} x {}",
        stored.width, stored.height, given.width, given.height
    )))
}

fn broken_checksums(layer: &Layer, found: &Verification) -> Vec<DamagedBlocks> {
    let describe = |damage: &Damage| DamagedBlocks {
        blocks: damage.last - damage.first + 1,
        description: format!(
            "{}: {damage}",
            diamonds(layer.lattice(), damage.first, damage.last)
        ),
    };
    found.damaged.iter().map(describe).collect()
}

fn missing(layer: &Layer, found: &Verification) -> Vec<MissingBlocks> {
    let describe = |ranks: &RangeInclusive<u64>| {
        let (first, last) = (*ranks.start(), *ranks.end());
        let diamonds = diamonds(layer.lattice(), first, last);
        MissingBlocks {
            blocks: last - first + 1,
            description: format!("{diamonds}: blocks {first} to {last}"),
        }
    };
    found.missing.iter().map(describe).collect()
}

/// The diamonds of neighbouring ranks.
fn diamonds(lattice: &Lattice, first: u64, last: u64) -> String {
    let count = last - first + 1;
    let (first, last) = (lattice.diamond(first), lattice.diamond(last));
    let name = |diamond: Diamond| {
        let Diamond { x, y, .. } = diamond;
        format!("level {} diamond ({x}, {y})", diamond.level())
    };
    match count {
        1 => name(first),
        _ => format!("{} to {}, {count} diamonds", name(first), name(last)),
    }
}

/// Decodes the whole leaf level; what fails is returned, each block once, or where nothing does the count of
/// samples that stay coarse.
fn decode_all(
    layer: &Layer,
    against: &mut Option<&mut dyn RasterSource>,
    sums: &mut Sums,
    progress: Progress,
) -> Result<(Vec<DamagedBlocks>, Option<u64>)> {
    let raster = &layer.header().raster;
    let window = Window {
        column: 0,
        row: 0,
        width: raster.width,
        height: raster.height,
    };
    let mut bands = Bands::new(layer, layer.lattice().levels(), window);
    let mut damage: Vec<DamagedBlocks> = Vec::new();
    let bands_each = usize::from(raster.bands);
    let mut input = vec![f64::NAN; raster.row_length()];
    let mut decoded = input.clone();
    let mut row = 0;
    while row < raster.height {
        if !progress(u64::from(row), u64::from(raster.height)) {
            return Err(Error::Cancelled);
        }
        let end = (row + bands.band_rows()).min(raster.height);
        for row in row..end {
            match bands.row(row) {
                Ok(found) => decoded.copy_from_slice(found),
                Err(Error::Damaged { message, .. }) => {
                    if damage.iter().all(|known| known.description != message) {
                        damage.push(DamagedBlocks {
                            blocks: 1,
                            description: message,
                        });
                    }
                    break;
                }
                Err(error) => return Err(error),
            }
            if let Some(source) = against.as_mut().filter(|_| damage.is_empty()) {
                source.read_rows(&mut input)?;
                let is_coarse = |column: usize| bands.is_coarse(column, row);
                sums.add(&decoded, &input, bands_each, is_coarse);
            }
        }
        row = end;
    }
    let coarse_samples = damage.is_empty().then(|| bands.coarse_samples());
    Ok((damage, coarse_samples))
}

#[derive(Default)]
struct Sums {
    max_error: f64,
    squares: f64,
    /// Numbers that are valid in both.
    valid: u64,
    void_mismatches: u64,
}

impl Sums {
    /// Adds a row of samples of so many numbers each, without those whose detail is missing: they keep to no bound
    /// of the whole repository.
    fn add(
        &mut self,
        decoded: &[f64],
        input: &[f64],
        bands: usize,
        is_coarse: impl Fn(usize) -> bool,
    ) {
        let samples = decoded.chunks_exact(bands).zip(input.chunks_exact(bands));
        for (column, (decoded, input)) in samples.enumerate() {
            if is_coarse(column) {
                continue;
            }
            if decoded[0].is_nan() != input[0].is_nan() {
                self.void_mismatches += 1;
                continue;
            }
            for (decoded, input) in decoded.iter().zip(input) {
                if !input.is_nan() {
                    let error = (decoded - input).abs();
                    self.max_error = self.max_error.max(error);
                    self.squares += error * error;
                    self.valid += 1;
                }
            }
        }
    }

    fn comparison(&self) -> Comparison {
        Comparison {
            max_error: self.max_error,
            rms_error: (self.squares / self.valid.max(1) as f64).sqrt(),
            void_mismatches: self.void_mismatches,
        }
    }
}
