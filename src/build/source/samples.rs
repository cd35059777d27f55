//! What all formats share: bytes to samples, samples to voids, and rows in order.

use std::path::{Path, PathBuf};

use super::RasterSource;
use crate::geo::{RasterInfo, SampleType};
use crate::vectors::widened;
use crate::{Error, Result};

/// Order of the bytes of one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    Little,
    Big,
}

impl ByteOrder {
    /// This machine's.
    pub(super) const NATIVE: ByteOrder = if cfg!(target_endian = "big") {
        ByteOrder::Big
    } else {
        ByteOrder::Little
    };
}

/// Turns stored bytes into samples, one for each `sample_type.size()` bytes.
pub(super) fn decode(sample_type: SampleType, order: ByteOrder, bytes: &[u8], samples: &mut [f64]) {
    macro_rules! decode_as {
        ($number:ty) => {{
            let (chunks, _) = bytes.as_chunks::<{ size_of::<$number>() }>();
            for (sample, chunk) in samples.iter_mut().zip(chunks) {
                *sample = f64::from(match order {
                    ByteOrder::Little => <$number>::from_le_bytes(*chunk),
                    ByteOrder::Big => <$number>::from_be_bytes(*chunk),
                });
            }
        }};
    }
    match sample_type {
        SampleType::U8 => decode_as!(u8),
        SampleType::I8 => decode_as!(i8),
        SampleType::U16 => decode_as!(u16),
        SampleType::I16 => decode_as!(i16),
        SampleType::U32 => decode_as!(u32),
        SampleType::I32 => decode_as!(i32),
        SampleType::F32 => decode_as!(f32),
        SampleType::F64 => decode_as!(f64),
    }
}

/// The value of `sample_type` that a nodata value written as text stands for, or `None` where it lies
/// outside the type, so that no sample can match it.
pub(crate) fn stored_value(value: f64, sample_type: SampleType) -> Option<f64> {
    let (low, high) = match sample_type {
        SampleType::U8 => (f64::from(u8::MIN), f64::from(u8::MAX)),
        SampleType::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        SampleType::U16 => (f64::from(u16::MIN), f64::from(u16::MAX)),
        SampleType::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        SampleType::U32 => (f64::from(u32::MIN), f64::from(u32::MAX)),
        SampleType::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        SampleType::F32 => {
            let rounded = value as f32;
            return (rounded.is_infinite() == value.is_infinite()).then_some(f64::from(rounded));
        }
        SampleType::F64 => return Some(value),
    };
    (value.fract() == 0.0 && (low..=high).contains(&value)).then_some(value)
}

/// Copies red, green and blue of the pixels of one row; a pixel with alpha 0 becomes a void.
///
/// # Errors
///
/// The column of a pixel whose alpha is neither 0 nor `opaque`, and what to say of it.
pub(super) fn without_alpha(
    stored: &[f64],
    opaque: f64,
    samples: &mut [f64],
) -> std::result::Result<(), String> {
    let (stored, _) = stored.as_chunks::<4>();
    let (samples, _) = samples.as_chunks_mut::<3>();
    for (column, (pixel, &[red, green, blue, alpha])) in samples.iter_mut().zip(stored).enumerate()
    {
        *pixel = match alpha {
            0.0 => [f64::NAN; 3],
            _ if alpha == opaque => [red, green, blue],
            _ => {
                return Err(format!(
                    "the pixel at column {column} is half transparent (alpha {alpha}); \
                     alpha must be 0, a void, or {opaque}"
                ));
            }
        };
    }
    Ok(())
}

/// What is said of an image with this number of bands that should be one of colours.
pub(super) fn not_colours(bands: u64) -> String {
    let plural = if bands == 1 { "" } else { "s" };
    format!("{bands} band{plural}; colours have three: red, green and blue")
}

/// How many rows `samples` asks for.
///
/// # Errors
///
/// [`Error::Argument`] where that is no whole number, or more than are left.
pub(super) fn rows_asked(info: &RasterInfo, next_row: u32, samples: &[f64]) -> Result<u32> {
    let row_length = info.row_length();
    let left = (info.height - next_row) as usize;
    let rows = samples.len().checked_div(row_length).unwrap_or(0);
    if samples.len() != rows * row_length || rows > left {
        return Err(Error::Argument(format!(
            "{} numbers asked of a raster that has {row_length} a row and {left} rows left",
            samples.len()
        )));
    }
    Ok(rows as u32)
}

/// Makes voids of stored samples that equal the nodata value in all bands or are NaN in any, and refuses
/// infinite ones.
pub(super) fn mark_voids(
    path: &Path,
    info: &RasterInfo,
    first_row: u32,
    samples: &mut [f64],
) -> Result<()> {
    let nodata = info
        .nodata
        .and_then(|value| stored_value(value, info.sample_type));
    if are_plain(samples, nodata.unwrap_or(f64::NAN)) {
        return Ok(());
    }
    let bands = usize::from(info.bands).max(1);
    for (index, sample) in samples.chunks_exact_mut(bands).enumerate() {
        let is_nodata = sample.iter().all(|&number| Some(number) == nodata);
        if is_nodata || sample.iter().any(|number| number.is_nan()) {
            sample.fill(f64::NAN);
        } else if sample.iter().any(|number| number.is_infinite()) {
            let width = info.width as usize;
            let (column, row) = (index % width, first_row as usize + index / width);
            return Err(Error::input(
                path,
                format!("the sample at column {column}, row {row} is infinite"),
            ));
        }
    }
    Ok(())
}

widened! {
    /// Whether all numbers are finite, and none is this one.
    fn are_plain(numbers: &[f64], nodata: f64) -> bool {
        numbers.iter().fold(true, |plain, &number| {
            plain & (number.abs() < f64::INFINITY) & (number != nodata)
        })
    }
}

/// A format's own part: one row of samples as they are stored.
pub(super) trait RowReader: Send {
    /// Fills `samples`, width x bands, with row number `row`; rows are asked for from 0 upwards, each once.
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()>;
}

/// A raster file: what its header said, and its rows.
pub(super) struct FileSource<R> {
    path: PathBuf,
    info: RasterInfo,
    reader: R,
    next_row: u32,
}

impl<R: RowReader + 'static> FileSource<R> {
    pub(super) fn boxed(path: &Path, info: RasterInfo, reader: R) -> Box<dyn RasterSource> {
        Box::new(FileSource {
            path: path.to_path_buf(),
            info,
            reader,
            next_row: 0,
        })
    }
}

impl<R: RowReader> RasterSource for FileSource<R> {
    fn info(&self) -> &RasterInfo {
        &self.info
    }

    fn read_rows(&mut self, samples: &mut [f64]) -> Result<()> {
        rows_asked(&self.info, self.next_row, samples)?;
        for row in samples.chunks_exact_mut(self.info.row_length()) {
            self.reader.read_row(self.next_row, row)?;
            mark_voids(&self.path, &self.info, self.next_row, row)?;
            self.next_row += 1;
        }
        Ok(())
    }
}
