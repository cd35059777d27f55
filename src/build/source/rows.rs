//! Rows from a closure: how a program hands over a raster of any other format.

use std::path::Path;

use super::RasterSource;
use super::samples::{mark_voids, rows_asked};
use crate::Result;
use crate::geo::RasterInfo;

/// Fills whole rows, the first of which has the given number. A void is NaN or the raster's nodata value.
pub type RowCallback = Box<dyn FnMut(u32, &mut [f64]) -> Result<()> + Send>;

/// A raster whose rows come from a callback, from the first to the last, each once.
pub struct RowSource {
    info: RasterInfo,
    callback: RowCallback,
    next_row: u32,
}

impl RowSource {
    /// A source of `info.height` rows of `info.width` samples.
    pub fn new(info: RasterInfo, callback: RowCallback) -> RowSource {
        RowSource {
            info,
            callback,
            next_row: 0,
        }
    }
}

impl RasterSource for RowSource {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        let rows = rows_asked(&self.info, self.next_row, samples)?;
        if rows > 0 {
            (self.callback)(self.next_row, samples)?;
            mark_voids(Path::new("(rows)"), &self.info, self.next_row, samples)?;
            self.next_row += rows;
        }
        Ok(())
    }
}
