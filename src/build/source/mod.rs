//! Where rasters come from: one trait, read by rows from the top, and one file for each format.

mod ascii_grid;
mod crs;
mod flat;
pub(crate) mod geokeys;
mod geotiff;
mod header_pair;
mod hgt;
mod in_memory;
mod jpeg;
mod mosaic;
mod options;
mod png;
mod resample;
mod rows;
pub(crate) mod samples;

use std::path::{Path, PathBuf};

use crate::geo::RasterInfo;
use crate::{Error, Result};
use samples::not_colours;

pub use flat::parse_raw_shape;
pub use in_memory::InMemory;
pub use mosaic::{Mosaic, position};
pub use options::SourceOptions;
pub use resample::{MOST_TEXELS, Resampled, texels_per_sample};
pub use rows::{RowCallback, RowSource};

/// A raster of heights or of colours that is read once, from its first row to its last.
pub trait RasterSource: Send {
    /// Shape, type and georeference; known before the first row is read.
    fn info(&self) -> &RasterInfo;

    /// Fills `samples` with the next `samples.len() / (width * bands)` rows (a whole number), row by row;
    /// a row is `[column * bands + band]`. A void, by the file's nodata value or otherwise, is NaN in
    /// all bands; every other number is the stored one, exact in `f64`.
    ///
    /// # Errors
    ///
    /// [`Error::Io`](crate::Error::Io) and [`Error::Input`](crate::Error::Input), the latter also
    /// for an infinite sample, with its column and row.
    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()>;
}

const SUPPORTED_COLOURS: &str =
    "GeoTIFF (.tif, .tiff), PNG (.png) and JPEG (.jpg, .jpeg) of red, green and blue";
const SUPPORTED: &str = "GeoTIFF (.tif, .tiff), grey PNG (.png), SRTM (.hgt), \
    ESRI ASCII grid (.asc), ENVI or BIL with a .hdr (.bil, .dat, .img, .bin), \
    or any file as raw samples of a given shape";

/// Opens a raster file; the extension decides on the format, unless `options.raw` is given.
///
/// # Errors
///
/// [`Error::Io`] where the file cannot be opened, [`Error::Input`] where it is not what its
/// extension says or holds a kind of raster that is not supported, [`Error::Argument`] for options
/// outside their range.
pub fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    options.check()?;
    if options.colour {
        return open_colours(path, options);
    }
    if options.raw.is_some() {
        return flat::open_raw(path, options);
    }
    match lower_extension(path).as_str() {
        "tif" | "tiff" => geotiff::open(path, options),
        "png" => png::open(path, options),
        "hgt" => hgt::open(path, options),
        "asc" => ascii_grid::open(path, options),
        "bil" | "dat" | "img" | "bin" => header_pair::open(path, options),
        "jpg" | "jpeg" => Err(Error::input(
            path,
            "a JPEG image holds colours, not heights",
        )),
        extension => Err(unknown_extension(path, extension, SUPPORTED)),
    }
}

fn open_colours(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    if options.raw.is_some() {
        return Err(Error::input(path, not_colours(1)));
    }
    match lower_extension(path).as_str() {
        "tif" | "tiff" => geotiff::open(path, options),
        "png" => png::open(path, options),
        "jpg" | "jpeg" => jpeg::open(path, options),
        "hgt" | "asc" | "bil" | "dat" | "img" | "bin" => Err(Error::input(
            path,
            format!("a format of heights; colours come from {SUPPORTED_COLOURS}"),
        )),
        extension => Err(unknown_extension(path, extension, SUPPORTED_COLOURS)),
    }
}

fn lower_extension(path: &Path) -> String {
    path.extension()
        .map(|text| text.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default()
}

fn unknown_extension(path: &Path, extension: &str, supported: &str) -> Error {
    let what = match extension {
        "" => "no file extension".to_string(),
        other => format!("extension .{other} is unknown"),
    };
    Error::input(path, format!("{what}; supported: {supported}"))
}

/// Opens one file as itself, several as a [`Mosaic`].
///
/// # Errors
///
/// Those of [`open`] and [`Mosaic::new`]; [`Error::Argument`] where `paths` is empty.
pub fn open_all(paths: &[PathBuf], options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    if let [path] = paths {
        return open(path, options);
    }
    if options.bounds.is_some() {
        let text = "bounds are those of one raster, and there are several";
        return Err(Error::Argument(text.to_string()));
    }
    let parts = paths
        .iter()
        .map(|path| Ok((path.clone(), open(path, options)?)))
        .collect::<Result<Vec<_>>>()?;
    Ok(Box::new(Mosaic::new(parts)?))
}
