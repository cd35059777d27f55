//! PNG of 8 or 16 bits, row by row: grey for heights, red, green and blue for colours.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};

use super::samples::{ByteOrder, FileSource, RowReader, decode, not_colours, without_alpha};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, SampleType};
use crate::{Error, Result};

struct PngRows {
    path: PathBuf,
    reader: Reader<BufReader<File>>,
    sample_type: SampleType,
    /// Whether a stored row has an alpha band to be taken out.
    alpha: bool,
    /// One row with its alpha; grows when the first row is read.
    stored: Vec<f64>,
}

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    let limits = Limits { bytes: 1 << 30 };
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(if options.colour {
        // Palettes become colours, and a transparent colour becomes an alpha band.
        Transformations::EXPAND
    } else {
        Transformations::IDENTITY
    });
    let reader = decoder
        .read_info()
        .map_err(|error| Error::input(path, format!("cannot read the PNG header: {error}")))?;
    let header = reader.info();
    let refuse = |cause: String| Err(Error::input(path, cause));
    let (color_type, bit_depth) = reader.output_color_type();
    match (options.colour, color_type) {
        (false, ColorType::Grayscale) | (true, ColorType::Rgb | ColorType::Rgba) => {}
        (false, ColorType::Indexed) => {
            return refuse("a palette image; heights are grey".to_string());
        }
        (false, other) => return refuse(format!("{} bands; heights have one", other.samples())),
        (true, other) => return refuse(not_colours(other.samples() as u64)),
    }
    let sample_type = match bit_depth {
        BitDepth::Eight => SampleType::U8,
        BitDepth::Sixteen => SampleType::U16,
        other => {
            return refuse(format!(
                "{} bits a sample; 8 and 16 are supported",
                other as u8
            ));
        }
    };
    if header.interlaced {
        return refuse("interlaced; it cannot be read row by row".to_string());
    }
    let mut info = RasterInfo::new(header.width, header.height, sample_type);
    info.bands = if options.colour { 3 } else { 1 };
    info.alpha = color_type == ColorType::Rgba;
    let info = options.complete(path, info)?;
    let alpha = info.alpha;
    Ok(FileSource::boxed(
        path,
        info,
        PngRows {
            path: path.to_path_buf(),
            reader,
            sample_type,
            alpha,
            stored: Vec::new(),
        },
    ))
}

impl RowReader for PngRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let refuse =
            |cause: String| Error::input(&self.path, format!("cannot read row {row}: {cause}"));
        let line = match self.reader.next_row() {
            Ok(Some(line)) => line,
            Ok(None) => return Err(refuse("no more rows".to_string())),
            Err(error) => return Err(refuse(error.to_string())),
        };
        if !self.alpha {
            decode(self.sample_type, ByteOrder::Big, line.data(), samples);
            return Ok(());
        }
        self.stored.resize(samples.len() / 3 * 4, 0.0);
        decode(
            self.sample_type,
            ByteOrder::Big,
            line.data(),
            &mut self.stored,
        );
        without_alpha(&self.stored, self.sample_type.greatest(), samples).map_err(refuse)
    }
}
