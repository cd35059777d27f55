//! Flat samples with a `.hdr` file beside them, in the style of ENVI or of ESRI's BIL; one band.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::flat::{FlatRows, Layout};
use super::samples::{ByteOrder, FileSource};
use super::{RasterSource, SourceOptions, crs};
use crate::geo::{RasterInfo, Registration, SampleType};
use crate::{Error, Result};

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let mut start = Vec::new();
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    file.take(15)
        .read_to_end(&mut start)
        .map_err(Error::io(path, "cannot read"))?;
    if start == b"EHFA_HEADER_TAG" {
        return Err(Error::input(
            path,
            "an ERDAS Imagine file, which is not supported",
        ));
    }
    let header_path = header_beside(path)?;
    let bytes = std::fs::read(&header_path).map_err(Error::io(&header_path, "cannot read"))?;
    let text = String::from_utf8_lossy(&bytes);
    let header = Header::parse(&header_path, &text)?;
    let (mut info, layout) = if header.is_envi {
        header.envi()?
    } else {
        header.bil()?
    };
    if info.crs.is_empty() {
        crs::read_prj_beside(path, &mut info)?;
    }
    let info = options.complete(path, info)?;
    Ok(FileSource::boxed(path, info, FlatRows::open(path, layout)?))
}

/// `name.hdr` or `name.ext.hdr`.
fn header_beside(path: &Path) -> Result<PathBuf> {
    let mut appended = path.as_os_str().to_os_string();
    appended.push(".hdr");
    let replaced = path.with_extension("hdr");
    [replaced.clone(), PathBuf::from(appended)]
        .into_iter()
        .find(|candidate| candidate.is_file())
        .ok_or_else(|| {
            Error::input(
                path,
                format!("there is no header {} beside it", replaced.display()),
            )
        })
}

struct Entry {
    line: usize,
    value: String,
}

/// Keys in lower case, with their values and lines.
struct Header {
    path: PathBuf,
    is_envi: bool,
    entries: BTreeMap<String, Entry>,
}

impl Header {
    fn parse(path: &Path, text: &str) -> Result<Header> {
        let is_envi = text.trim_start().starts_with("ENVI");
        let mut header = Header {
            path: path.to_path_buf(),
            is_envi,
            entries: BTreeMap::new(),
        };
        let mut lines = text.lines().enumerate();
        while let Some((index, line)) = lines.next() {
            let separator = if is_envi {
                line.find('=')
            } else {
                line.trim().find([' ', '\t'])
            };
            let line = if is_envi { line } else { line.trim() };
            let Some((key, value)) = separator.map(|at| line.split_at(at)) else {
                continue;
            };
            let mut value = value.trim_start_matches('=').trim().to_string();
            while is_envi && value.starts_with('{') && !value.contains('}') {
                let Some((_, more)) = lines.next() else {
                    let cause = format!("line {}: {}: no closing brace", index + 1, key.trim());
                    return Err(Error::input(path, cause));
                };
                value.push(' ');
                value.push_str(more.trim());
            }
            let value = value.trim_matches(['{', '}', ' ']).to_string();
            header.entries.insert(
                key.trim().to_lowercase(),
                Entry {
                    line: index + 1,
                    value,
                },
            );
        }
        Ok(header)
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.entries.get(key).map(|entry| entry.value.as_str())
    }

    fn number<T: FromStr>(&self, key: &str) -> Result<Option<T>> {
        self.text(key)
            .map(|text| {
                text.parse()
                    .map_err(|_| self.refuse(key, "is not a number that fits"))
            })
            .transpose()
    }

    fn required<T: FromStr>(&self, key: &str) -> Result<T> {
        let missing = || Error::input(&self.path, format!("the header has no {key}"));
        self.number(key)?.ok_or_else(missing)
    }

    /// An error about the value of a key that is there.
    fn refuse(&self, key: &str, cause: &str) -> Error {
        let (line, value) = self
            .entries
            .get(key)
            .map_or((0, ""), |entry| (entry.line, entry.value.as_str()));
        Error::input(&self.path, format!("line {line}: {key}: `{value}` {cause}"))
    }

    fn one_band(&self, key: &str) -> Result<()> {
        match self.number::<u32>(key)? {
            None | Some(1) => Ok(()),
            Some(_) => Err(self.refuse(key, "bands; heights have one")),
        }
    }

    fn bil_sample_type(&self) -> Result<SampleType> {
        let bits = self.number::<u32>("nbits")?.unwrap_or(8);
        let pixel_type = self
            .text("pixeltype")
            .unwrap_or("UNSIGNEDINT")
            .to_ascii_uppercase();
        Ok(match (pixel_type.as_str(), bits) {
            ("UNSIGNEDINT", 8) => SampleType::U8,
            ("UNSIGNEDINT", 16) => SampleType::U16,
            ("UNSIGNEDINT", 32) => SampleType::U32,
            ("SIGNEDINT", 8) => SampleType::I8,
            ("SIGNEDINT", 16) => SampleType::I16,
            ("SIGNEDINT", 32) => SampleType::I32,
            ("FLOAT", 32) => SampleType::F32,
            ("FLOAT", 64) => SampleType::F64,
            ("UNSIGNEDINT" | "SIGNEDINT" | "FLOAT", _) => {
                return Err(self.refuse("nbits", "is not a supported number of bits"));
            }
            _ => {
                return Err(self.refuse("pixeltype", "is none of UNSIGNEDINT, SIGNEDINT and FLOAT"));
            }
        })
    }

    fn bil(&self) -> Result<(RasterInfo, Layout)> {
        self.one_band("nbands")?;
        let (width, height) = (self.required("ncols")?, self.required("nrows")?);
        let sample_type = self.bil_sample_type()?;
        let order = match self
            .text("byteorder")
            .unwrap_or("I")
            .to_ascii_uppercase()
            .as_str()
        {
            "I" | "LSBFIRST" => ByteOrder::Little,
            "M" | "MSBFIRST" => ByteOrder::Big,
            _ => return Err(self.refuse("byteorder", "is neither I nor M")),
        };
        let row_bytes = u64::from(width) * sample_type.size() as u64;
        for key in ["bandrowbytes", "totalrowbytes"] {
            if self
                .number::<u64>(key)?
                .is_some_and(|bytes| bytes != row_bytes)
            {
                return Err(self.refuse(key, "differs from the bytes of a row's samples"));
            }
        }
        let skip = self.number("skipbytes")?.unwrap_or(0);
        let mut info = RasterInfo::new(width, height, sample_type);
        info.nodata = match self.number("nodata")? {
            None => self.number("nodata_value")?,
            some => some,
        };
        if let (Some(x), Some(y)) = (self.number("ulxmap")?, self.number("ulymap")?) {
            let (dx, dy): (f64, f64) = (
                self.number("xdim")?.unwrap_or(1.0),
                self.number("ydim")?.unwrap_or(1.0),
            );
            info.geotransform = [x, dx, 0.0, y, 0.0, -dy];
            info.georeferenced = true;
            info.registration = Registration::Point;
        }
        Ok((
            info,
            Layout {
                skip,
                row_length: width as usize,
                height,
                sample_type,
                order,
            },
        ))
    }

    fn envi(&self) -> Result<(RasterInfo, Layout)> {
        self.one_band("bands")?;
        let (width, height) = (self.required("samples")?, self.required("lines")?);
        let sample_type = match self.required::<u32>("data type")? {
            1 => SampleType::U8,
            2 => SampleType::I16,
            3 => SampleType::I32,
            4 => SampleType::F32,
            5 => SampleType::F64,
            12 => SampleType::U16,
            13 => SampleType::U32,
            _ => {
                let cause = "is not a supported type (1, 2, 3, 4, 5, 12, 13)";
                return Err(self.refuse("data type", cause));
            }
        };
        let order = match self.number("byte order")?.unwrap_or(0) {
            0 => ByteOrder::Little,
            1 => ByteOrder::Big,
            _ => return Err(self.refuse("byte order", "is neither 0 nor 1")),
        };
        let skip = self.number("header offset")?.unwrap_or(0);
        let mut info = RasterInfo::new(width, height, sample_type);
        info.nodata = self.number("data ignore value")?;
        if let Some(text) = self.text("map info") {
            self.map_info(text, &mut info)?;
        }
        Ok((
            info,
            Layout {
                skip,
                row_length: width as usize,
                height,
                sample_type,
                order,
            },
        ))
    }

    /// `map info = { projection, column, row, x, y, dx, dy, ... }`, where (1, 1) is the upper left corner.
    fn map_info(&self, text: &str, info: &mut RasterInfo) -> Result<()> {
        let fields: Vec<&str> = text.split(',').map(str::trim).collect();
        let number = |index: usize| {
            let field = fields
                .get(index)
                .and_then(|field| field.parse::<f64>().ok());
            field.ok_or_else(|| self.refuse("map info", "is not a name and six numbers"))
        };
        let [column, row, x, y, dx, dy] = [
            number(1)?,
            number(2)?,
            number(3)?,
            number(4)?,
            number(5)?,
            number(6)?,
        ];
        let rotation = fields
            .iter()
            .find_map(|field| field.strip_prefix("rotation="));
        if rotation.is_some_and(|angle| angle.trim().parse() != Ok(0.0)) {
            return Err(self.refuse("map info", "is rotated, which is not supported"));
        }
        info.geotransform = [
            x - (column - 1.0) * dx,
            dx,
            0.0,
            y + (row - 1.0) * dy,
            0.0,
            -dy,
        ];
        info.georeferenced = true;
        info.registration = Registration::Area;
        self.reference_system(&fields, info);
        Ok(())
    }

    /// From WKT, or from the projection's name where it is well known.
    fn reference_system(&self, fields: &[&str], info: &mut RasterInfo) {
        let wgs84 = fields
            .iter()
            .any(|field| field.eq_ignore_ascii_case("WGS-84"));
        let name = fields.first().copied().unwrap_or_default();
        if let Some(wkt) = self.text("coordinate system string") {
            info.crs = wkt.to_string();
            info.geographic = crs::is_geographic(wkt);
        } else if name.eq_ignore_ascii_case("Geographic Lat/Lon") {
            info.geographic = true;
            info.crs = if wgs84 {
                "EPSG:4326".to_string()
            } else {
                String::new()
            };
        } else if name.eq_ignore_ascii_case("UTM") && wgs84 {
            let zone = fields.get(7).and_then(|zone| zone.parse::<u32>().ok());
            let south = fields
                .get(8)
                .is_some_and(|side| side.eq_ignore_ascii_case("South"));
            if let Some(zone) = zone.filter(|zone| (1..=60).contains(zone)) {
                info.crs = format!("EPSG:{}", if south { 32700 } else { 32600 } + zone);
            }
        }
    }
}
