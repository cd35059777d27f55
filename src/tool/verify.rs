//! The check of a whole repository: checksums, decoding, and the distance from its input.

use super::Progress;
use super::bands::Bands;
use crate::build::source::RasterSource;
use crate::cut::{Layer, Window};
use crate::store::Damage;
use crate::{Error, Result};

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Damaged blocks, coarse levels first. Where there are any, nothing was compared.
    pub damage: Vec<DamagedBlocks>,
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
}

/// Neighbouring blocks that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedBlocks {
    /// How many.
    pub blocks: u64,
    /// Their levels and diamonds, and the cause, in one line.
    pub description: String,
}

/// The distance of decoded samples from the input's.
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
    let mut damage = broken_checksums(layer);
    let mut sums = Sums::default();
    if damage.is_empty() {
        damage = decode_all(layer, &mut against, &mut sums, progress)?;
    }
    let comparison = (against.is_some() && damage.is_empty()).then(|| sums.comparison());
    let kept = comparison.is_none_or(|found| {
        found.max_error <= layer.header().max_error_bound && found.void_mismatches == 0
    });
    Ok(Verdict {
        ok: damage.is_empty() && kept,
        damage,
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

fn broken_checksums(layer: &Layer) -> Vec<DamagedBlocks> {
    let lattice = layer.lattice();
    let found = layer.store().verify();
    let describe = |damage: &Damage| {
        let (first, last) = (lattice.diamond(damage.first), lattice.diamond(damage.last));
        let diamonds = match damage.last - damage.first {
            0 => format!("level {} diamond ({}, {})", first.level(), first.x, first.y),
            more => format!(
                "level {} diamond ({}, {}) to level {} diamond ({}, {}), {} diamonds",
                first.level(),
                first.x,
                first.y,
                last.level(),
                last.x,
                last.y,
                more + 1
            ),
        };
        DamagedBlocks {
            blocks: damage.last - damage.first + 1,
            description: format!("{diamonds}: {damage}"),
        }
    };
    found.damaged.iter().map(describe).collect()
}

/// Decodes the whole leaf level; what fails is returned, each block once.
fn decode_all(
    layer: &Layer,
    against: &mut Option<&mut dyn RasterSource>,
    sums: &mut Sums,
    progress: Progress,
) -> Result<Vec<DamagedBlocks>> {
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
    let mut row = 0;
    while row < raster.height {
        if !progress(u64::from(row), u64::from(raster.height)) {
            return Err(Error::Cancelled);
        }
        let end = (row + bands.band_rows()).min(raster.height);
        for row in row..end {
            let decoded = match bands.row(row) {
                Ok(decoded) => decoded,
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
            };
            if let Some(source) = against.as_mut().filter(|_| damage.is_empty()) {
                source.read_rows(&mut input)?;
                sums.add(decoded, &input, bands_each);
            }
        }
        row = end;
    }
    Ok(damage)
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
    /// Adds a row of samples of so many numbers each.
    fn add(&mut self, decoded: &[f64], input: &[f64], bands: usize) {
        let samples = decoded.chunks_exact(bands);
        for (decoded, input) in samples.zip(input.chunks_exact(bands)) {
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
