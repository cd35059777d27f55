//! Samples that lie in memory as their type.

use std::path::Path;

use super::RasterSource;
use super::samples::{mark_voids, rows_asked};
use crate::geo::{RasterInfo, Sample};
use crate::{Error, Result};

/// A raster of samples in memory, row by row without gaps. A void is NaN or the raster's nodata value.
pub struct InMemory<'a, T> {
    info: RasterInfo,
    samples: &'a [T],
    next_row: u32,
}

impl<'a, T: Sample> InMemory<'a, T> {
    /// A source of these samples.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where `info` is of another type, or of another count of samples.
    pub fn new(info: RasterInfo, samples: &'a [T]) -> Result<InMemory<'a, T>> {
        if info.sample_type != T::TYPE
            || samples.len() as u64 != info.row_length() as u64 * u64::from(info.height)
        {
            return Err(Error::Argument(format!(
                "{} {} samples for a raster of {} x {} {}",
                samples.len(),
                T::TYPE.name(),
                info.width,
                info.height,
                info.sample_type.name()
            )));
        }
        Ok(InMemory {
            info,
            samples,
            next_row: 0,
        })
    }
}

impl<T: Sample> RasterSource for InMemory<'_, T> {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        let rows = rows_asked(&self.info, self.next_row, samples)?;
        let first = self.next_row as usize * self.info.row_length();
        for (sample, own) in samples.iter_mut().zip(&self.samples[first..]) {
            *sample = own.value();
        }
        mark_voids(Path::new("(samples)"), &self.info, self.next_row, samples)?;
        self.next_row += rows;
        Ok(())
    }
}
