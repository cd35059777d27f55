//! Grey PNG of 8 or 16 bits, row by row.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Decoder, Limits, Reader, Transformations};

use super::samples::{ByteOrder, FileSource, RowReader, decode};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, SampleType};
use crate::{Error, Result};

struct PngRows {
    path: PathBuf,
    reader: Reader<BufReader<File>>,
    sample_type: SampleType,
}

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    let limits = Limits { bytes: 1 << 30 };
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let reader = decoder
        .read_info()
        .map_err(|error| Error::input(path, format!("cannot read the PNG header: {error}")))?;
    let header = reader.info();
    let refuse = |cause: String| Err(Error::input(path, cause));
    match header.color_type {
        ColorType::Grayscale => {}
        ColorType::Indexed => return refuse("a palette image; heights are grey".to_string()),
        other => return refuse(format!("{} bands; heights have one", other.samples())),
    }
    let sample_type = match header.bit_depth {
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
    let info = options.complete(
        path,
        RasterInfo::new(header.width, header.height, sample_type),
    )?;
    Ok(FileSource::boxed(
        path,
        info,
        PngRows {
            path: path.to_path_buf(),
            reader,
            sample_type,
        },
    ))
}

impl RowReader for PngRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let refuse =
            |cause: String| Error::input(&self.path, format!("cannot read row {row}: {cause}"));
        match self.reader.next_row() {
            Ok(Some(line)) => {
                decode(self.sample_type, ByteOrder::Big, line.data(), samples);
                Ok(())
            }
            Ok(None) => Err(refuse("no more rows".to_string())),
            Err(error) => Err(refuse(error.to_string())),
        }
    }
}
