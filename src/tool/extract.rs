//! A level of a repository, or a part of it, as a GeoTIFF.

use super::Progress;
use super::bands::Bands;
use super::raster_file::write_geotiff;
use crate::cut::{Layer, Window, level_size, level_step};
use crate::geo::RasterInfo;
use crate::{Error, Result};
use std::ops::Range;
use std::path::Path;

/// How far beside a box's edge, in samples of the finest level, a sample may lie and count as in it:
/// coordinates come with rounding errors.
const EDGE_TOLERANCE: f64 = 1e-6;

/// What to extract.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Extract {
    /// An even level of the repository; the finest if `None`.
    pub level: Option<u32>,
    /// Two opposite corners x0, y0, x1, y1 in the reference system; everything if `None`.
    pub corners: Option<[f64; 4]>,
}

/// What was extracted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extracted {
    /// Samples a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// The level.
    pub level: u32,
    /// Samples that are those of a coarser level, since their detail is missing.
    pub coarse_samples: u64,
}

/// Writes the samples of a level as a GeoTIFF with the input's type, georeference and void value; colours as
/// red, green and blue. Where detail is missing, samples are those that [`read_window`](crate::cut::read_window) has.
///
/// # Errors
///
/// [`Error::Argument`] for a level that is odd or too fine, for a box without samples, and for voids of
/// integers for which the input had no value; those of reading and of writing;
/// [`Error::Cancelled`]. Nothing is left under the output's name then.
pub fn extract(
    layer: &Layer,
    output: &Path,
    what: &Extract,
    progress: Progress,
) -> Result<Extracted> {
    let level = what.level.unwrap_or(layer.lattice().levels());
    let stride = level_step(layer, level)?;
    let raster = layer.raster_info();
    let window = match what.corners {
        Some(corners) => window_in_box(raster, stride, corners)?,
        None => {
            let [width, height] = level_size(layer, level)?;
            Window {
                column: 0,
                row: 0,
                width,
                height,
            }
        }
    };
    let first = [window.column, window.row].map(|first| f64::from(first) * f64::from(stride));
    let info = raster.on_grid(first, f64::from(stride), [window.width, window.height]);
    let mut bands = Bands::new(layer, level, window);
    write_geotiff(output, &info, |first_row, samples| {
        for (row, line) in (first_row..).zip(samples.chunks_exact_mut(info.row_length())) {
            if !progress(u64::from(row), u64::from(info.height)) {
                return Err(Error::Cancelled);
            }
            line.copy_from_slice(bands.row(row)?);
            check_voids(&info, row, line)?;
        }
        Ok(())
    })?;
    Ok(Extracted {
        width: info.width,
        height: info.height,
        level,
        coarse_samples: bands.coarse_samples(),
    })
}

/// The samples whose columns and rows are multiples of `stride` and that lie in a box, given by two opposite
/// corners x0, y0, x1, y1 in the reference system.
///
/// # Errors
///
/// [`Error::Argument`] where there are none.
pub fn window_in_box(
    raster: &RasterInfo,
    stride: u32,
    [x0, y0, x1, y1]: [f64; 4],
) -> Result<Window> {
    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    let corners = corners.map(|[x, y]| raster.crs_to_sample(x, y));
    let [Some(a), Some(b), Some(c), Some(d)] = corners else {
        return Err(Error::Argument(
            "its geotransform has no inverse: no box can be cut out".into(),
        ));
    };
    let span = |axis: usize, count: u32| -> Option<Range<u32>> {
        let along = [a[axis], b[axis], c[axis], d[axis]];
        let low = along.into_iter().fold(f64::INFINITY, f64::min) - EDGE_TOLERANCE;
        let high = along.into_iter().fold(f64::NEG_INFINITY, f64::max) + EDGE_TOLERANCE;
        let stride = f64::from(stride);
        let last = ((f64::from(count) - 1.0) / stride).floor();
        let first = (low / stride).ceil().max(0.0);
        let last = (high / stride).floor().min(last);
        (first <= last).then(|| first as u32..last as u32 + 1)
    };
    match (span(0, raster.width), span(1, raster.height)) {
        (Some(columns), Some(rows)) => Ok(Window {
            column: columns.start,
            row: rows.start,
            width: columns.end - columns.start,
            height: rows.end - rows.start,
        }),
        _ => Err(Error::Argument(format!(
            "no sample lies in the box {x0} {y0} {x1} {y1}"
        ))),
    }
}

fn check_voids(info: &RasterInfo, row: u32, samples: &[f64]) -> Result<()> {
    if info.nodata.is_some() || info.alpha || !info.sample_type.is_integer() {
        return Ok(());
    }
    let bands = usize::from(info.bands);
    match samples.iter().position(|number| number.is_nan()) {
        None => Ok(()),
        Some(place) => Err(Error::Argument(format!(
            "the sample at column {}, row {row} is void, and its {} samples have no value for \
             that: build it with --nodata V",
            place / bands,
            info.sample_type.name()
        ))),
    }
}
