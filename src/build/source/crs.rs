//! Coordinate reference systems as text.

use std::io::ErrorKind;
use std::path::Path;

use crate::geo::RasterInfo;
use crate::log::{LogLevel, log};
use crate::{Error, Result};

/// Whether a WKT text describes degrees of longitude and latitude.
pub(super) fn is_geographic(wkt: &str) -> bool {
    let keyword = wkt
        .trim_start()
        .split(['[', '('])
        .next()
        .unwrap_or_default();
    ["GEOGCS", "GEOGCRS", "GEODCRS"]
        .iter()
        .any(|name| keyword.trim().eq_ignore_ascii_case(name))
}

/// Takes the reference system from the `.prj` file beside `path`, where there is one with WKT.
pub(super) fn read_prj_beside(path: &Path, info: &mut RasterInfo) -> Result<()> {
    let prj = path.with_extension("prj");
    let bytes = match std::fs::read(&prj) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Error::io(&prj, "cannot read")(error)),
    };
    let text = String::from_utf8_lossy(&bytes);
    if text.contains('[') {
        info.crs = text.trim().to_string();
        info.geographic = is_geographic(&info.crs);
    } else {
        let text = "not WKT; the reference system stays unknown";
        log(LogLevel::Warning, &format!("{}: {text}", prj.display()));
    }
    Ok(())
}
