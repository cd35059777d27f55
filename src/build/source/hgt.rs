//! SRTM height tiles: a square of big-endian 16-bit samples; the file's name is its lower left corner.

use std::path::Path;

use super::flat::{FlatRows, Layout};
use super::samples::{ByteOrder, FileSource};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, Registration, SampleType};
use crate::log::{LogLevel, log};
use crate::{Error, Result};

const VOID: f64 = -32768.0;

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let length = std::fs::metadata(path)
        .map_err(Error::io(path, "cannot open"))?
        .len();
    let side = (length / 2).isqrt();
    let side = match u32::try_from(side) {
        Ok(side_samples) if side >= 2 && side * side * 2 == length => side_samples,
        _ => {
            return Err(Error::input(
                path,
                format!(
                    "{length} bytes are no square of 16-bit samples: truncated, or not SRTM \
                     (3 arc seconds: 2884802 bytes, 1 arc second: 25934402 bytes)"
                ),
            ));
        }
    };
    let mut info = RasterInfo::new(side, side, SampleType::I16);
    info.nodata = Some(VOID);
    info.units = "m".to_string();
    match corner(path) {
        Some([longitude, latitude]) => {
            let step = 1.0 / f64::from(side - 1);
            info.geotransform = [longitude, step, 0.0, latitude + 1.0, 0.0, -step];
            info.georeferenced = true;
            info.registration = Registration::Point;
            info.geographic = true;
            info.crs = "EPSG:4326".to_string();
        }
        None => {
            let text = "the name is not that of a tile, such as N49W123.hgt; not georeferenced";
            log(LogLevel::Warning, &format!("{}: {text}", path.display()));
        }
    }
    let info = options.complete(path, info)?;
    let layout = Layout {
        skip: 0,
        row_length: side as usize,
        height: side,
        sample_type: SampleType::I16,
        order: ByteOrder::Big,
    };
    Ok(FileSource::boxed(path, info, FlatRows::open(path, layout)?))
}

/// Longitude and latitude from a name that begins like `N49W123`.
fn corner(path: &Path) -> Option<[f64; 2]> {
    let name = path.file_name()?.to_str()?;
    let degrees = |range: std::ops::Range<usize>, positive: &str, negative: &str| {
        let sign = match name.get(range.start..range.start + 1)?.to_ascii_uppercase() {
            letter if letter == positive => 1.0,
            letter if letter == negative => -1.0,
            _ => return None,
        };
        let digits = name.get(range.start + 1..range.end)?;
        let all_digits = digits.bytes().all(|byte| byte.is_ascii_digit());
        Some(sign * f64::from(digits.parse::<u16>().ok().filter(|_| all_digits)?))
    };
    let latitude = degrees(0..3, "N", "S")?;
    let longitude = degrees(3..7, "E", "W")?;
    (latitude.abs() <= 90.0 && longitude.abs() <= 180.0).then_some([longitude, latitude])
}
