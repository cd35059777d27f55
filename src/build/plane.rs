//! The whole raster in memory.

use super::source::RasterSource;
use crate::geo::RasterInfo;
use crate::{Error, Result};

/// Samples as their source gave them, row by row; NaN is a void.
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) samples: Vec<f64>,
    /// Least and greatest valid sample; zeros when there is none.
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
        let count = width
            .checked_mul(height)
            .filter(|&count| count <= isize::MAX as usize / 8);
        let Some(count) = count else {
            return Err(Error::Argument(format!(
                "{width} x {height} samples exceed the memory"
            )));
        };
        let mut samples = Vec::new();
        samples.try_reserve_exact(count).map_err(|_| {
            Error::Argument(format!("{width} x {height} samples exceed the memory"))
        })?;
        let mut plane = Plane {
            width,
            height,
            samples,
            sample_range: [f64::INFINITY, f64::NEG_INFINITY],
            void_samples: 0,
        };
        let band_rows = (BAND_SAMPLES / width).max(1);
        for row in (0..height).step_by(band_rows) {
            let end = (row + band_rows).min(height) * width;
            plane.samples.resize(end, f64::NAN);
            source.read_rows(&mut plane.samples[row * width..])?;
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
        for (offset, &sample) in self.samples[start..].iter().enumerate() {
            if sample.is_nan() {
                self.void_samples += 1;
                continue;
            }
            if !sample.is_finite() || !info.sample_type.holds(sample) {
                let index = start + offset;
                return Err(Error::Argument(format!(
                    "the sample at column {}, row {} is {sample}, which is no {} height",
                    index % self.width,
                    index / self.width,
                    info.sample_type.name(),
                )));
            }
            low = low.min(sample);
            high = high.max(sample);
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
        self.samples[self.index(at)].is_nan()
    }
}
