//! Rows of samples one after the other: raw files, and the body of several formats.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::samples::{ByteOrder, FileSource, RowReader, decode};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, SampleType};
use crate::{Error, Result};

/// Where the samples lie in a file, and how they are stored.
pub(super) struct Layout {
    pub(super) skip: u64,
    /// Samples a row, those of all bands.
    pub(super) row_length: usize,
    pub(super) height: u32,
    pub(super) sample_type: SampleType,
    pub(super) order: ByteOrder,
}

impl Layout {
    fn row_bytes(&self) -> u64 {
        self.row_length as u64 * self.sample_type.size() as u64
    }

    /// Length of a file that ends with the last row; saturates where no file can be that long.
    fn end(&self) -> u64 {
        self.row_bytes()
            .saturating_mul(u64::from(self.height))
            .saturating_add(self.skip)
    }
}

/// Reads rows that lie one after the other.
pub(super) struct FlatRows {
    path: PathBuf,
    file: BufReader<File>,
    layout: Layout,
    bytes: Vec<u8>,
}

impl FlatRows {
    /// Opens `path`, whose length must reach to the end of the last row.
    pub(super) fn open(path: &Path, layout: Layout) -> Result<FlatRows> {
        let mut file = File::open(path).map_err(Error::io(path, "cannot open"))?;
        let length = file
            .metadata()
            .map_err(Error::io(path, "cannot open"))?
            .len();
        if length < layout.end() {
            let row = length.saturating_sub(layout.skip) / layout.row_bytes().max(1);
            return Err(Error::input(
                path,
                format!(
                    "truncated: row {row} of {} cannot be read ({length} bytes of {})",
                    layout.height,
                    layout.end()
                ),
            ));
        }
        file.seek(SeekFrom::Start(layout.skip))
            .map_err(Error::io(path, "cannot read"))?;
        Ok(FlatRows {
            path: path.to_path_buf(),
            file: BufReader::with_capacity(1 << 20, file),
            bytes: vec![0; layout.row_bytes() as usize],
            layout,
        })
    }
}

impl RowReader for FlatRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        self.file
            .read_exact(&mut self.bytes)
            .map_err(|error| Error::input(&self.path, format!("cannot read row {row}: {error}")))?;
        decode(
            self.layout.sample_type,
            self.layout.order,
            &self.bytes,
            samples,
        );
        Ok(())
    }
}

/// Reads `WxHxTYPE`, such as `1024x512xu16`.
///
/// # Errors
///
/// [`Error::Argument`].
pub fn parse_raw_shape(text: &str) -> Result<(u32, u32, SampleType)> {
    let shape = || -> Option<(u32, u32, SampleType)> {
        let mut parts = text.split('x');
        let width = parts.next()?.parse().ok().filter(|&width| width > 0)?;
        let height = parts.next()?.parse().ok().filter(|&height| height > 0)?;
        let name = parts.next()?;
        let sample_type = SampleType::ALL
            .into_iter()
            .find(|kind| kind.name() == name)?;
        parts
            .next()
            .is_none()
            .then_some((width, height, sample_type))
    };
    shape().ok_or_else(|| {
        Error::Argument(format!(
            "raw shape `{text}` is not WxHxTYPE, such as 1024x512xu16 \
             (types u8 i8 u16 i16 u32 i32 f32 f64)"
        ))
    })
}

/// Opens a file that is nothing but little-endian samples, of the shape in `options.raw`.
pub(super) fn open_raw(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let Some((width, height, sample_type)) = options.raw else {
        return Err(Error::Argument("a raw file needs its shape".to_string()));
    };
    let info = options.complete(path, RasterInfo::new(width, height, sample_type))?;
    let layout = Layout {
        skip: 0,
        row_length: width as usize,
        height,
        sample_type,
        order: ByteOrder::Little,
    };
    let length = std::fs::metadata(path)
        .map_err(Error::io(path, "cannot open"))?
        .len();
    if length != layout.end() {
        return Err(Error::input(
            path,
            format!(
                "{length} bytes, but {width} x {height} samples of {} are {} bytes",
                sample_type.name(),
                layout.end()
            ),
        ));
    }
    Ok(FileSource::boxed(path, info, FlatRows::open(path, layout)?))
}
