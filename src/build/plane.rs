//! The whole raster in memory.

use super::source::RasterSource;
use crate::geo::RasterInfo;
use crate::{Error, Result};

/// Samples as their source gave them, row by row; a void is NaN in all bands.
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Numbers of a sample.
    bands: usize,
    /// `[sample * bands + band]`.
    numbers: Vec<f64>,
    /// Least and greatest number of any valid sample; zeros when there is none.
    pub(super) sample_range: [f64; 2],
    pub(super) void_samples: u64,
}

/// Samples asked of a source at a time.
const BAND_SAMPLES: usize = 1 << 20;

impl Plane {
    /// Reads a source to its end; `progress` gets the samples read so far and returns false to cancel.
    pub(super) fn read(
        source: &mut dyn RasterSource,
        mut progress: impl FnMut(u64) -> bool,
    ) -> Result<Plane> {
        let (width, height) = (source.info().width as usize, source.info().height as usize);
        let bands = usize::from(source.info().bands);
        let exceeded = || Error::Argument(format!("{width} x {height} samples exceed the memory"));
        let count = width.checked_mul(height).ok_or_else(exceeded)?;
        let length = count.checked_mul(bands);
        let length = length.filter(|&length| length <= isize::MAX as usize / 8);
        let mut numbers = Vec::new();
        numbers
            .try_reserve_exact(length.ok_or_else(exceeded)?)
            .map_err(|_| exceeded())?;
        let mut plane = Plane {
            width,
            height,
            bands,
            numbers,
            sample_range: [f64::INFINITY, f64::NEG_INFINITY],
            void_samples: 0,
        };
        let band_rows = (BAND_SAMPLES / width).max(1);
        for row in (0..height).step_by(band_rows) {
            let end = (row + band_rows).min(height) * width;
            plane.numbers.resize(end * bands, f64::NAN);
            source.read_rows(&mut plane.numbers[row * width * bands..])?;
            plane.take_statistics(row * width, source.info())?;
            if !progress(end as u64) {
                return Err(Error::Cancelled);
            }
        }
        if plane.void_samples == count as u64 {
            plane.sample_range = [0.0, 0.0];
        }
        Ok(plane)
    }

    fn take_statistics(&mut self, start: usize, info: &RasterInfo) -> Result<()> {
        let [mut low, mut high] = self.sample_range;
        let what = if self.bands == 1 { "height" } else { "colour" };
        let samples = self.numbers[start * self.bands..].chunks_exact(self.bands);
        for (offset, sample) in samples.enumerate() {
            if is_void(sample) {
                self.void_samples += 1;
                continue;
            }
            for &number in sample {
                if !number.is_finite() || !info.sample_type.holds(number) {
                    let index = start + offset;
                    return Err(Error::Argument(format!(
                        "the sample at column {}, row {} is {number}, which is no {} {what}",
                        index % self.width,
                        index / self.width,
                        info.sample_type.name(),
                    )));
                }
                low = low.min(number);
                high = high.max(number);
            }
        }
        self.sample_range = [low, high];
        Ok(())
    }

    /// Where the sample at a position in the raster is among all.
    pub(super) fn index(&self, [column, row]: [i64; 2]) -> usize {
        row as usize * self.width + column as usize
    }

    /// Whether the sample at a position in the raster is void.
    pub(super) fn is_void(&self, at: [i64; 2]) -> bool {
        self.numbers[self.index(at) * self.bands].is_nan()
    }

    /// How many samples there are, valid and void.
    pub(super) fn count(&self) -> usize {
        self.width * self.height
    }

    /// All samples with their numbers; `None` for a void.
    pub(super) fn samples(&self) -> impl Iterator<Item = Option<&[f64]>> {
        let samples = self.numbers.chunks_exact(self.bands);
        samples.map(|sample| (!is_void(sample)).then_some(sample))
    }

    /// All numbers of all samples, NaN those of voids.
    pub(super) fn numbers(&self) -> &[f64] {
        &self.numbers
    }
}

fn is_void(sample: &[f64]) -> bool {
    sample.first().is_none_or(|number| number.is_nan())
}
