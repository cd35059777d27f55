//! Several rasters on one grid, as one.

use std::path::PathBuf;

use super::RasterSource;
use super::samples::{rows_asked, stored_value};
use crate::geo::RasterInfo;
use crate::{Error, Result};

/// How far, in samples, an input may lie from the first one's grid.
const TOLERANCE: f64 = 1e-3;

struct Part {
    path: PathBuf,
    /// Dropped after its last row.
    source: Option<Box<dyn RasterSource>>,
    /// Numbers a row.
    row_length: usize,
    height: u32,
    /// Position of its upper left sample in the mosaic.
    column: usize,
    row: u32,
    /// The mosaic's nodata value, where this input has another or none: no sample may be that in all bands.
    forbidden: Option<f64>,
}

/// The union rectangle of rasters whose samples lie on one grid. What no input covers is void. Where inputs
/// overlap the one named later wins where it is valid.
pub struct Mosaic {
    info: RasterInfo,
    parts: Vec<Part>,
    next_row: u32,
    line: Vec<f64>,
}

impl Mosaic {
    /// Joins sources, each with the name that errors give it. The first one's georeference, units and
    /// metadata hold for the whole, and the first nodata value that one of them has.
    ///
    /// # Errors
    ///
    /// [`Error::Input`], with the name, for a source that has no georeference, or whose spacing,
    /// position, sample type, scale or reference system does not fit the first one's;
    /// [`Error::Argument`] where there is no source.
    pub fn new(sources: Vec<(PathBuf, Box<dyn RasterSource>)>) -> Result<Mosaic> {
        let Some((first_path, first)) = sources.first() else {
            return Err(Error::Argument("no input".to_string()));
        };
        let first = first.info().clone();
        let positions = sources
            .iter()
            .map(|(path, source)| {
                position(&first, source.info())
                    .map_err(|cause| Error::input(path, cause_beside(&cause, first_path)))
            })
            .collect::<Result<Vec<[i64; 2]>>>()?;
        let nodata = sources.iter().find_map(|(_, source)| source.info().nodata);
        let info = union(&first, nodata, &sources, &positions)
            .ok_or_else(|| Error::input(first_path, "the inputs lie too far apart for a mosaic"))?;

        let left = positions.iter().map(|at| at[0]).min().unwrap_or(0);
        let top = positions.iter().map(|at| at[1]).min().unwrap_or(0);
        let value = |nodata: Option<f64>| nodata.and_then(|n| stored_value(n, info.sample_type));
        let parts = sources
            .into_iter()
            .zip(&positions)
            .map(|((path, source), at)| Part {
                path,
                row_length: source.info().row_length(),
                height: source.info().height,
                column: (at[0] - left) as usize,
                row: (at[1] - top) as u32,
                forbidden: value(nodata).filter(|_| value(source.info().nodata) != value(nodata)),
                source: Some(source),
            })
            .collect();
        Ok(Mosaic {
            info,
            parts,
            next_row: 0,
            line: Vec::new(),
        })
    }

    fn read_row(&mut self, samples: &mut [f64]) -> Result<()> {
        samples.fill(f64::NAN);
        let bands = usize::from(self.info.bands).max(1);
        for part in &mut self.parts {
            let Some(row) = self.next_row.checked_sub(part.row) else {
                continue;
            };
            let Some(source) = &mut part.source else {
                continue;
            };
            self.line.resize(part.row_length, 0.0);
            source.read_rows(&mut self.line)?;
            if row + 1 == part.height {
                part.source = None;
            }
            let target = samples.chunks_exact_mut(bands).skip(part.column);
            let given = self.line.chunks_exact(bands);
            for (column, (sample, value)) in target.zip(given).enumerate() {
                if let Some(forbidden) = part.forbidden
                    && value.iter().all(|&number| number == forbidden)
                {
                    return Err(Error::input(
                        &part.path,
                        format!(
                            "the sample at column {column}, row {row} is {forbidden}, \
                             which is the nodata value of another input"
                        ),
                    ));
                }
                if !value.iter().any(|number| number.is_nan()) {
                    sample.copy_from_slice(value);
                }
            }
        }
        self.next_row += 1;
        Ok(())
    }
}

impl RasterSource for Mosaic {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        rows_asked(&self.info, self.next_row, samples)?;
        samples
            .chunks_exact_mut(self.info.row_length())
            .try_for_each(|row| self.read_row(row))
    }
}

fn cause_beside(cause: &str, first: &std::path::Path) -> String {
    format!("{cause}, so it cannot be joined to {}", first.display())
}

/// Column and row of `other`'s upper left sample in the grid of `first`, or why it does not fit.
///
/// # Errors
///
/// What differs: the reference system, the distance between samples, their type or their scale.
pub fn position(first: &RasterInfo, other: &RasterInfo) -> std::result::Result<[i64; 2], String> {
    if !first.georeferenced || !other.georeferenced {
        return Err("an input of a mosaic is not georeferenced".to_string());
    }
    if other.sample_type != first.sample_type {
        let names = (other.sample_type.name(), first.sample_type.name());
        return Err(format!("its samples are {} and not {}", names.0, names.1));
    }
    if other.bands != first.bands {
        return Err(format!(
            "it has {} bands and not {}",
            other.bands, first.bands
        ));
    }
    if (other.value_scale, other.value_offset, &other.units)
        != (first.value_scale, first.value_offset, &first.units)
    {
        return Err("its scale, offset or units differ".to_string());
    }
    if other.crs != first.crs || other.geographic != first.geographic {
        let name = |crs: &str| {
            if crs.is_empty() {
                "unknown".to_string()
            } else {
                crs.to_string()
            }
        };
        let names = (name(&other.crs), name(&first.crs));
        return Err(format!(
            "its reference system is {} and not {}",
            names.0, names.1
        ));
    }
    let place = |column: f64, row: f64| {
        let [x, y] = other.sample_to_crs(column, row);
        first
            .crs_to_sample(x, y)
            .ok_or("its geotransform has no inverse".to_string())
    };
    let near = |one: [f64; 2], two: [f64; 2]| {
        (one[0] - two[0]).abs() <= TOLERANCE && (one[1] - two[1]).abs() <= TOLERANCE
    };
    let (right, bottom) = (f64::from(other.width) - 1.0, f64::from(other.height) - 1.0);
    let at = place(0.0, 0.0)?;
    for (column, row) in [(right, 0.0), (0.0, bottom)] {
        if !near(place(column, row)?, [at[0] + column, at[1] + row]) {
            return Err("its sample spacing differs".to_string());
        }
    }
    let whole = at.map(f64::round);
    if !near(at, whole) {
        let off = [at[0] - whole[0], at[1] - whole[1]];
        return Err(format!(
            "its samples lie {:.3} columns, {:.3} rows off",
            off[0], off[1]
        ));
    }
    if whole
        .iter()
        .any(|offset| offset.abs() > f64::from(u32::MAX))
    {
        return Err("it lies too far away".to_string());
    }
    Ok(whole.map(|offset| offset as i64))
}

/// The whole raster, or `None` where it has too many columns or rows.
fn union(
    first: &RasterInfo,
    nodata: Option<f64>,
    sources: &[(PathBuf, Box<dyn RasterSource>)],
    positions: &[[i64; 2]],
) -> Option<RasterInfo> {
    let placed = || {
        sources
            .iter()
            .map(|(_, source)| source.info())
            .zip(positions)
    };
    let left = positions.iter().map(|at| at[0]).min()?;
    let top = positions.iter().map(|at| at[1]).min()?;
    let right = placed()
        .map(|(info, at)| at[0] + i64::from(info.width))
        .max()?;
    let bottom = placed()
        .map(|(info, at)| at[1] + i64::from(info.height))
        .max()?;
    let (c, r, g) = (left as f64, top as f64, &first.geotransform);
    let mut info = first.clone();
    info.width = u32::try_from(right - left).ok()?;
    info.height = u32::try_from(bottom - top).ok()?;
    info.geotransform[0] = g[0] + c * g[1] + r * g[2];
    info.geotransform[3] = g[3] + c * g[4] + r * g[5];
    info.nodata = nodata;
    info.alpha = placed().any(|(info, _)| info.alpha);
    Some(info)
}
