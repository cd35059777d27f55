//! The whole raster in memory.

use super::source::RasterSource;
use crate::codec::Units;
use crate::geo::RasterInfo;
use crate::lattice::{Diamond, Lattice};
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

    /// The sample at a position in the raster, in units; `None` for a void.
    pub(super) fn unit(&self, units: &Units, [column, row]: [i64; 2]) -> Option<i32> {
        let sample = self.samples[row as usize * self.width + column as usize];
        (!sample.is_nan()).then(|| units.to_unit(sample))
    }

    /// Whether the sample at a position in the raster is void.
    pub(super) fn is_void(&self, [column, row]: [i64; 2]) -> bool {
        self.samples[row as usize * self.width + column as usize].is_nan()
    }

    /// The samples at a diamond's centres, N^2 in units (0 where not codable), and 1 for each void.
    pub(super) fn centres_of(
        &self,
        lattice: &Lattice,
        units: &Units,
        diamond: Diamond,
        codable: &Option<Box<[u8]>>,
    ) -> (Vec<i32>, Option<Box<[u8]>>) {
        let (placement, cells) = (lattice.placement(diamond), lattice.cells());
        let mut samples = vec![0; cells * cells];
        let mut voids =
            (self.void_samples > 0).then(|| vec![0u8; cells * cells].into_boxed_slice());
        for (index, sample) in samples.iter_mut().enumerate() {
            if codable.as_ref().is_some_and(|codable| codable[index] == 0) {
                continue;
            }
            match self.unit(units, placement.centre(index % cells, index / cells)) {
                Some(unit) => *sample = unit,
                None => {
                    if let Some(voids) = &mut voids {
                        voids[index] = 1;
                    }
                }
            }
        }
        (samples, voids)
    }
}
