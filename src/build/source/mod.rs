//! Where rasters come from: one trait, read by rows from the top.

use crate::Result;
use crate::geo::RasterInfo;

/// A raster that is read once, from its first row to its last.
pub trait RasterSource: Send {
    /// Shape, type and georeference; known before the first row is read.
    fn info(&self) -> &RasterInfo;

    /// Fills `samples` with the next `samples.len() / width` rows (a whole number), row by row. A void,
    /// by the file's nodata value or otherwise, is NaN; every other sample is the stored one,
    /// exact in `f64`.
    ///
    /// # Errors
    ///
    /// [`Error::Io`](crate::Error::Io) and [`Error::Input`](crate::Error::Input), the latter also
    /// for an infinite sample, with its column and row.
    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()>;
}
