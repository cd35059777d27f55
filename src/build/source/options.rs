//! What the caller says of an input beside its path.

use std::path::Path;

use crate::geo::{RasterInfo, Registration, SampleType};
use crate::log::{LogLevel, log};
use crate::{Error, Result};

/// What a raster's file leaves unsaid, or what the caller knows better.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceOptions {
    /// Whether samples are colours (three bands) instead of heights (one).
    pub colour: bool,
    /// Distance between neighbouring samples, where the file has no georeference.
    pub spacing: Option<f64>,
    /// Two opposite corners x0, y0, x1, y1 of the whole raster, outer edge to outer edge, in the reference
    /// system's coordinates, north up, where the file has no georeference.
    pub bounds: Option<[f64; 4]>,
    /// Physical height of one sample unit; overrides the file's.
    pub scale: Option<f64>,
    /// The value of void samples, in all bands; overrides the file's.
    pub nodata: Option<f64>,
    /// The file is nothing but little-endian samples: width, height and type.
    pub raw: Option<(u32, u32, SampleType)>,
}

impl SourceOptions {
    /// Refuses a spacing or a scale that is not a positive, finite number, and bounds without an area.
    pub(super) fn check(&self) -> Result<()> {
        for (name, value) in [("spacing", self.spacing), ("scale", self.scale)] {
            if let Some(value) = value
                && !(value.is_finite() && value > 0.0)
            {
                return Err(Error::Argument(format!(
                    "{name} {value} is not a positive number"
                )));
            }
        }
        if let Some([x0, y0, x1, y1]) = self.bounds {
            if ![x1 - x0, y1 - y0]
                .iter()
                .all(|d| d.is_finite() && *d != 0.0)
            {
                let text = format!("bounds {x0} {y0} {x1} {y1} are not corners of an area");
                return Err(Error::Argument(text));
            }
            if self.spacing.is_some() {
                let text = "bounds already give the spacing";
                return Err(Error::Argument(text.to_string()));
            }
        }
        Ok(())
    }

    /// Completes what a file's reader found out: refuses an empty raster, drops a georeference without an
    /// inverse, and applies the overrides.
    pub(super) fn complete(&self, path: &Path, mut info: RasterInfo) -> Result<RasterInfo> {
        if info.width == 0 || info.height == 0 {
            return Err(Error::input(
                path,
                format!("{} x {} samples", info.width, info.height),
            ));
        }
        if info.georeferenced && !has_inverse(&info.geotransform) {
            let text = "geotransform has no inverse; read as a raster without georeference";
            log(LogLevel::Warning, &format!("{}: {text}", path.display()));
            info.georeferenced = false;
        }
        if info.georeferenced {
            for (name, given) in [
                ("spacing is", self.spacing.is_some()),
                ("bounds are", self.bounds.is_some()),
            ] {
                if given {
                    let text = "not used, because the file is georeferenced";
                    let text = format!("{}: {name} {text}", path.display());
                    log(LogLevel::Warning, &text);
                }
            }
        } else if let Some([x0, y0, x1, y1]) = self.bounds {
            let (width, height) = (f64::from(info.width), f64::from(info.height));
            info.geotransform = [
                x0.min(x1),
                (x1 - x0).abs() / width,
                0.0,
                y0.max(y1),
                0.0,
                -(y1 - y0).abs() / height,
            ];
            info.georeferenced = true;
            info.registration = Registration::Area;
        } else {
            let plain = RasterInfo::new(info.width, info.height, info.sample_type);
            let spacing = self.spacing.unwrap_or(1.0);
            info.geotransform = plain.geotransform.map(|number| number * spacing);
            info.registration = plain.registration;
            info.geographic = plain.geographic;
            info.crs = plain.crs;
        }
        if let Some(scale) = self.scale {
            info.value_scale = scale;
            // It holds the scale that was just overridden.
            info.metadata.remove("tiff.42112");
        }
        info.nodata = self.nodata.or(info.nodata);
        Ok(info)
    }
}

fn has_inverse(g: &[f64; 6]) -> bool {
    let determinant = g[1] * g[5] - g[2] * g[4];
    g.iter().all(|number| number.is_finite()) && determinant != 0.0 && determinant.is_finite()
}
