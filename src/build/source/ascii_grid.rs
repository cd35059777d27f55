//! ESRI ASCII grids: a few header lines, then numbers as text.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::samples::{FileSource, RowReader};
use super::{RasterSource, SourceOptions, crs};
use crate::geo::{RasterInfo, Registration, SampleType};
use crate::{Error, Result};

const KEYS: &str =
    "ncols nrows xllcorner yllcorner xllcenter yllcenter cellsize dx dy nodata_value";

/// Opens a grid. Samples are `I32` where every one is a whole number that fits, else `F64`; a first
/// pass over the file finds that out.
pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let mut lines = Lines::open(path)?;
    let header = Header::read(&mut lines)?;
    let (offset, number) = (lines.start, lines.number - 1);
    let integers = only_integers(&mut lines)?;
    lines.back_to(offset, number)?;

    let mut info = header.info(
        path,
        if integers {
            SampleType::I32
        } else {
            SampleType::F64
        },
    )?;
    crs::read_prj_beside(path, &mut info)?;
    let info = options.complete(path, info)?;
    let rows = GridRows {
        lines,
        width: info.width,
        height: info.height,
    };
    Ok(FileSource::boxed(path, info, rows))
}

/// Lines of text with their numbers, from 1.
struct Lines {
    path: PathBuf,
    file: BufReader<File>,
    number: u64,
    /// Byte offset of the current line.
    start: u64,
    bytes: Vec<u8>,
}

impl Lines {
    fn open(path: &Path) -> Result<Lines> {
        let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
        let file = BufReader::with_capacity(1 << 18, file);
        Ok(Lines {
            path: path.to_path_buf(),
            file,
            number: 0,
            start: 0,
            bytes: Vec::new(),
        })
    }

    /// Moves on to the next line; false at the end of the file.
    fn advance(&mut self) -> Result<bool> {
        self.start += self.bytes.len() as u64;
        self.bytes.clear();
        self.file
            .read_until(b'\n', &mut self.bytes)
            .map_err(Error::io(&self.path, "cannot read"))?;
        self.number += 1;
        Ok(!self.bytes.is_empty())
    }

    fn text(&self) -> Result<&str> {
        std::str::from_utf8(&self.bytes).map_err(|_| self.refuse("not text"))
    }

    fn back_to(&mut self, offset: u64, number: u64) -> Result<()> {
        self.bytes.clear();
        self.start = offset;
        self.number = number;
        self.file
            .seek(SeekFrom::Start(offset))
            .map_err(Error::io(&self.path, "cannot read"))?;
        Ok(())
    }

    fn refuse(&self, cause: impl std::fmt::Display) -> Error {
        Error::input(&self.path, format!("line {}: {cause}", self.number))
    }
}

/// Whether all values from the current line on are whole numbers of 32 bits.
fn only_integers(lines: &mut Lines) -> Result<bool> {
    loop {
        let whole = |token: &str| token.parse::<i32>().is_ok();
        if !lines.text()?.split_ascii_whitespace().all(whole) {
            return Ok(false);
        }
        if !lines.advance()? {
            return Ok(true);
        }
    }
}

#[derive(Default)]
struct Header {
    columns: Option<u32>,
    rows: Option<u32>,
    corner: [Option<f64>; 2],
    center: [Option<f64>; 2],
    step: [Option<f64>; 2],
    nodata: Option<f64>,
}

impl Header {
    /// Reads the lines that begin with a key; afterwards the current line is the first with samples.
    fn read(lines: &mut Lines) -> Result<Header> {
        let mut header = Header::default();
        while lines.advance()? {
            let mut tokens = lines.text()?.split_ascii_whitespace();
            let Some(key) = tokens.next() else { continue };
            if key.parse::<f64>().is_ok() {
                return Ok(header);
            }
            let value = tokens.next().unwrap_or_default();
            header
                .set(key, value)
                .map_err(|cause| lines.refuse(cause))?;
        }
        Err(lines.refuse("the file ends before the first sample"))
    }

    fn set(&mut self, key: &str, value: &str) -> std::result::Result<(), String> {
        let wrong = || format!("{key}: `{value}` is not a number of the kind that belongs there");
        let count = || {
            value
                .parse::<u32>()
                .ok()
                .filter(|&count| count > 0)
                .ok_or_else(wrong)
        };
        let number = || value.parse::<f64>().map_err(|_| wrong());
        match key.to_ascii_lowercase().as_str() {
            "ncols" => self.columns = Some(count()?),
            "nrows" => self.rows = Some(count()?),
            "xllcorner" => self.corner[0] = Some(number()?),
            "yllcorner" => self.corner[1] = Some(number()?),
            "xllcenter" => self.center[0] = Some(number()?),
            "yllcenter" => self.center[1] = Some(number()?),
            "cellsize" => self.step = [Some(number()?); 2],
            "dx" => self.step[0] = Some(number()?),
            "dy" => self.step[1] = Some(number()?),
            "nodata_value" => self.nodata = Some(number()?),
            _ => {
                return Err(format!(
                    "`{key}` is not a header key of an ASCII grid ({KEYS})"
                ));
            }
        }
        Ok(())
    }

    fn info(&self, path: &Path, sample_type: SampleType) -> Result<RasterInfo> {
        let missing = |key: &str| Error::input(path, format!("the header has no {key}"));
        let width = self.columns.ok_or_else(|| missing("ncols"))?;
        let height = self.rows.ok_or_else(|| missing("nrows"))?;
        let mut info = RasterInfo::new(width, height, sample_type);
        info.nodata = self.nodata;
        let (origin, rows_up) = match (self.corner, self.center) {
            ([None, None], [None, None]) => return Ok(info),
            ([Some(x), Some(y)], [None, None]) => {
                info.registration = Registration::Area;
                ([x, y], f64::from(height))
            }
            ([None, None], [Some(x), Some(y)]) => ([x, y], f64::from(height) - 1.0),
            _ => {
                return Err(missing(
                    "pair of either xllcorner, yllcorner or xllcenter, yllcenter",
                ));
            }
        };
        let [Some(dx), Some(dy)] = self.step else {
            return Err(missing("cellsize"));
        };
        info.geotransform = [origin[0], dx, 0.0, origin[1] + rows_up * dy, 0.0, -dy];
        info.georeferenced = true;
        Ok(info)
    }
}

/// A row may be wrapped over several lines, but the next row begins on a line of its own, so that a
/// missing or surplus value is found in its row.
struct GridRows {
    lines: Lines,
    width: u32,
    height: u32,
}

impl RowReader for GridRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let mut filled = 0;
        while filled < samples.len() {
            if !self.lines.advance()? {
                return Err(Error::input(
                    &self.lines.path,
                    format!(
                        "truncated: row {row} of {} cannot be read ({filled} values of {})",
                        self.height, self.width
                    ),
                ));
            }
            for token in self.lines.text()?.split_ascii_whitespace() {
                let Some(sample) = samples.get_mut(filled) else {
                    let cause = format!("row {row} does not have {} values", self.width);
                    return Err(self.lines.refuse(cause));
                };
                *sample = token.parse().map_err(|_| {
                    let place = format!("column {filled}, row {row}");
                    self.lines
                        .refuse(format!("{place}: `{token}` is not a number"))
                })?;
                filled += 1;
            }
        }
        if row + 1 == self.height {
            while self.lines.advance()? {
                if !self.lines.text()?.trim_ascii().is_empty() {
                    return Err(self.lines.refuse(format!("more than {} rows", self.height)));
                }
            }
        }
        Ok(())
    }
}
