//! Rows of a window out of a repository, decoded a band at a time, so that memory stays bounded.

use crate::Result;
use crate::cut::{Coarse, Layer, Window, read_window};

/// Samples of a band: few enough for memory, so many that ancestors are seldom decoded again.
const BAND_SAMPLES: u32 = 1 << 22;

/// Rows of a window, read from the first to the last.
pub(super) struct Bands<'a> {
    layer: &'a Layer,
    level: u32,
    window: Window,
    samples: Vec<f64>,
    /// Those of the band that are coarse.
    coarse: Coarse,
    coarse_samples: u64,
    /// Rows of the window in `samples`.
    rows: std::ops::Range<u32>,
}

impl<'a> Bands<'a> {
    /// The rows of `window`, in samples of the even level `level`.
    pub(super) fn new(layer: &'a Layer, level: u32, window: Window) -> Bands<'a> {
        Bands {
            layer,
            level,
            window,
            samples: Vec::new(),
            coarse: Coarse::default(),
            coarse_samples: 0,
            rows: 0..0,
        }
    }

    /// Height of a band, but for the last.
    pub(super) fn band_rows(&self) -> u32 {
        (BAND_SAMPLES / self.window.width).clamp(1, self.window.height)
    }

    /// The samples of row `row`, `[column * bands + band]`; NaN is a void.
    ///
    /// # Errors
    ///
    /// Those of [`read_window`] over the band that begins at this row, if no band before it holds it.
    pub(super) fn row(&mut self, row: u32) -> Result<&[f64]> {
        if !self.rows.contains(&row) {
            self.rows = 0..0;
            let rows = self.band_rows().min(self.window.height - row);
            let band = Window {
                row: self.window.row + row,
                height: rows,
                ..self.window
            };
            self.samples
                .resize(self.row_length() * rows as usize, f64::NAN);
            self.coarse = read_window(self.layer, self.level, band, &mut self.samples)?;
            self.coarse_samples += self.coarse.count();
            self.rows = row..row + rows;
        }
        let start = (row - self.rows.start) as usize * self.row_length();
        Ok(&self.samples[start..start + self.row_length()])
    }

    /// Whether a sample of the row that was read last is only that of a coarser level ([`Coarse`]).
    pub(super) fn is_coarse(&self, column: usize, row: u32) -> bool {
        let first = (row - self.rows.start) as usize * self.window.width as usize;
        self.coarse.contains(first + column)
    }

    /// How many there were in all bands so far, each being read once.
    pub(super) fn coarse_samples(&self) -> u64 {
        self.coarse_samples
    }

    fn row_length(&self) -> usize {
        self.window.width as usize * self.layer.components().count()
    }
}
