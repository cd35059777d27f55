//! JPEG images of colours, 8 bits a band.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::samples::{ByteOrder, FileSource, RowReader, decode, not_colours};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, SampleType};
use crate::{Error, Result};

/// Most columns, and rows, that the format can say.
const MOST: usize = u16::MAX as usize;

/// A whole image in memory: a progressive one has no rows before its last byte.
struct JpegRows {
    path: PathBuf,
    /// Until the first row is read.
    decoder: Option<JpegDecoder<BufReader<File>>>,
    /// Red, green and blue of all pixels.
    pixels: Vec<u8>,
}

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    // Without the vector kernels every machine decodes to the same samples.
    let settings = DecoderOptions::default()
        .set_use_unsafe(false)
        .set_strict_mode(true)
        .set_max_width(MOST)
        .set_max_height(MOST)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(BufReader::new(file), settings);
    let refuse = |cause: String| Error::input(path, cause);
    decoder
        .decode_headers()
        .map_err(|error| refuse(format!("cannot read the JPEG header: {}", one_line(&error))))?;
    match decoder.input_colorspace() {
        Some(ColorSpace::YCbCr | ColorSpace::RGB) => {}
        Some(ColorSpace::Luma) => return Err(refuse(not_colours(1))),
        other => {
            let name = other.map_or("unknown".to_string(), |space| format!("{space:?}"));
            return Err(refuse(format!("{name} colours are not supported")));
        }
    }
    let size = decoder
        .info()
        .ok_or_else(|| refuse("it has no size".to_string()))?;
    let (width, height) = (u32::from(size.width), u32::from(size.height));
    let mut info = RasterInfo::new(width, height, SampleType::U8);
    info.bands = 3;
    let info = options.complete(path, info)?;
    let rows = JpegRows {
        path: path.to_path_buf(),
        decoder: Some(decoder),
        pixels: Vec::new(),
    };
    Ok(FileSource::boxed(path, info, rows))
}

/// The decoder's messages may have several lines.
fn one_line(error: &DecodeErrors) -> String {
    let text = error.to_string();
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl RowReader for JpegRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let refuse = |cause: String| Error::input(&self.path, cause);
        if let Some(mut decoder) = self.decoder.take() {
            self.pixels = decoder.decode().map_err(|error| {
                refuse(format!(
                    "cannot decode the JPEG image: {}",
                    one_line(&error)
                ))
            })?;
        }
        let length = samples.len();
        let line = self
            .pixels
            .get(row as usize * length..(row as usize + 1) * length)
            .ok_or_else(|| refuse(format!("cannot read row {row}: it is missing")))?;
        decode(SampleType::U8, ByteOrder::NATIVE, line, samples);
        Ok(())
    }
}
