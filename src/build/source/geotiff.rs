//! GeoTIFF, one band of strips or tiles at a time.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use tiff::decoder::{ChunkType, Decoder, Limits};
use tiff::tags::{ByteOrder as TiffByteOrder, Tag, Type, ValueBuffer};

use super::flat::{FlatRows, Layout};
use super::geokeys::{self, GeoKeys};
use super::samples::{ByteOrder, FileSource, RowReader, decode};
use super::{RasterSource, SourceOptions};
use crate::geo::{RasterInfo, SampleType};
use crate::log::{LogLevel, log};
use crate::{Error, Result};

type TiffDecoder = Decoder<BufReader<File>>;

/// The largest strip or tile that is decoded, in bytes.
const CHUNK_LIMIT: usize = 1 << 30;

pub(super) fn open(path: &Path, options: &SourceOptions) -> Result<Box<dyn RasterSource>> {
    let mut file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    check_signature(path, &mut file)?;
    let mut limits = Limits::default();
    limits.intermediate_buffer_size = CHUNK_LIMIT;
    let mut tiff = Decoder::new(BufReader::with_capacity(1 << 16, file))
        .map_err(|error| Error::input(path, format!("cannot read the TIFF directory: {error}")))?
        .with_limits(limits);
    let mut tags = Tags {
        path,
        tiff: &mut tiff,
    };
    let sample_type = tags.sample_type()?;
    let info = options.complete(path, tags.info(sample_type)?)?;
    match tags.flat_layout(&info)? {
        Some(layout) => Ok(FileSource::boxed(path, info, FlatRows::open(path, layout)?)),
        None => {
            let rows = ChunkRows::new(path, tiff, &info);
            Ok(FileSource::boxed(path, info, rows))
        }
    }
}

fn check_signature(path: &Path, file: &mut File) -> Result<()> {
    let mut start = Vec::new();
    file.take(4)
        .read_to_end(&mut start)
        .map_err(Error::io(path, "cannot read"))?;
    file.rewind().map_err(Error::io(path, "cannot read"))?;
    let signatures: [&[u8]; 4] = [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"];
    if signatures.contains(&start.as_slice()) {
        return Ok(());
    }
    let text = start.escape_ascii();
    Err(Error::input(
        path,
        format!("not a TIFF file (its first bytes are \"{text}\")"),
    ))
}

/// The image directory.
struct Tags<'a> {
    path: &'a Path,
    tiff: &'a mut TiffDecoder,
}

impl Tags<'_> {
    /// A tag's bytes, in little-endian order.
    fn bytes(&mut self, tag: u16) -> Result<Option<Vec<u8>>> {
        let mut buffer = ValueBuffer::empty(Type::BYTE);
        let found = self
            .tiff
            .image_ifd()
            .find_tag_buf(Tag::Unknown(tag), &mut buffer);
        match found {
            Ok(None) => Ok(None),
            Ok(Some(_)) => {
                buffer.set_byte_order(TiffByteOrder::LittleEndian);
                Ok(Some(buffer.as_bytes().to_vec()))
            }
            Err(error) => Err(Error::input(
                self.path,
                format!("cannot read the TIFF tag {tag}: {error}"),
            )),
        }
    }

    fn text(&mut self, tag: u16) -> Result<Option<String>> {
        let bytes = self.bytes(tag)?;
        Ok(bytes.map(|bytes| {
            String::from_utf8_lossy(&bytes)
                .trim_end_matches('\0')
                .trim()
                .to_string()
        }))
    }

    fn doubles(&mut self, tag: u16) -> Result<Vec<f64>> {
        let bytes = self.bytes(tag)?.unwrap_or_default();
        Ok(bytes
            .as_chunks::<8>()
            .0
            .iter()
            .map(|&number| f64::from_le_bytes(number))
            .collect())
    }

    fn integers(&mut self, tag: Tag) -> Result<Vec<u64>> {
        let found = self
            .tiff
            .find_tag_unsigned_vec::<u64>(tag)
            .map_err(|error| {
                Error::input(
                    self.path,
                    format!("cannot read the TIFF tag {}: {error}", tag.to_u16()),
                )
            })?;
        Ok(found.unwrap_or_default())
    }

    fn integer(&mut self, tag: Tag, default: u64) -> Result<u64> {
        Ok(self.integers(tag)?.first().copied().unwrap_or(default))
    }

    /// The type of the one band's samples.
    fn sample_type(&mut self) -> Result<SampleType> {
        let refuse = |cause: String| Err(Error::input(self.path, cause));
        let bands = self.integer(Tag::SamplesPerPixel, 1)?;
        if bands != 1 {
            return refuse(format!("{bands} bands; heights have one"));
        }
        match self.integer(Tag::PhotometricInterpretation, 1)? {
            1 => {}
            0 => return refuse("grey from white to black, which is not supported".to_string()),
            3 => return refuse("a palette image; heights are grey".to_string()),
            other => return refuse(format!("photometric interpretation {other}, not grey")),
        }
        let bits = self.integer(Tag::BitsPerSample, 1)?;
        let format = self.integer(Tag::SampleFormat, 1)?;
        Ok(match (format, bits) {
            (1, 8) => SampleType::U8,
            (1, 16) => SampleType::U16,
            (1, 32) => SampleType::U32,
            (2, 8) => SampleType::I8,
            (2, 16) => SampleType::I16,
            (2, 32) => SampleType::I32,
            (3, 32) => SampleType::F32,
            (3, 64) => SampleType::F64,
            _ => {
                return refuse(format!(
                    "samples of {bits} bits and TIFF sample format {format} are not supported"
                ));
            }
        })
    }

    fn info(&mut self, sample_type: SampleType) -> Result<RasterInfo> {
        let (width, height) = self
            .tiff
            .dimensions()
            .map_err(|error| Error::input(self.path, format!("cannot read the size: {error}")))?;
        let mut info = RasterInfo::new(width, height, sample_type);
        for tag in [
            geokeys::GEO_KEY_DIRECTORY,
            geokeys::GEO_DOUBLE_PARAMS,
            geokeys::GEO_ASCII_PARAMS,
            geokeys::GDAL_METADATA,
        ] {
            if let Some(bytes) = self.bytes(tag)? {
                info.metadata.insert(geokeys::metadata_key(tag), bytes);
            }
        }
        let kept = |tag| {
            info.metadata
                .get(&geokeys::metadata_key(tag))
                .map_or(&[][..], Vec::as_slice)
        };
        let keys = GeoKeys::new(
            kept(geokeys::GEO_KEY_DIRECTORY),
            kept(geokeys::GEO_ASCII_PARAMS),
        );
        let gdal = String::from_utf8_lossy(kept(geokeys::GDAL_METADATA)).into_owned();
        if let Some(geotransform) = self.geotransform()? {
            info.geotransform = geotransform;
            info.georeferenced = true;
            info.registration = keys.registration();
            info.geographic = keys.geographic();
            info.crs = keys.crs();
        }
        if let Some(text) = self.text(geokeys::GDAL_NODATA)? {
            let refuse = |_| Error::input(self.path, format!("nodata `{text}` is not a number"));
            info.nodata = Some(text.parse().map_err(refuse)?);
        }
        let number = |role: &str, default: f64| match gdal_item(&gdal, role) {
            None => Ok(default),
            Some(text) => text.trim().parse().map_err(|_| {
                Error::input(
                    self.path,
                    format!("GDAL metadata: {role} `{text}` is not a number"),
                )
            }),
        };
        info.value_scale = number("scale", 1.0)?;
        info.value_offset = number("offset", 0.0)?;
        info.units = gdal_item(&gdal, "unittype").unwrap_or_default();
        Ok(info)
    }

    fn geotransform(&mut self) -> Result<Option<[f64; 6]>> {
        let scale = self.doubles(geokeys::MODEL_PIXEL_SCALE)?;
        let tiepoint = self.doubles(geokeys::MODEL_TIEPOINT)?;
        let matrix = self.doubles(geokeys::MODEL_TRANSFORMATION)?;
        let warn = |text: &str| {
            log(
                LogLevel::Warning,
                &format!("{}: {text}", self.path.display()),
            )
        };
        if let ([dx, dy, ..], [column, row, _, x, y, ..]) = (scale.as_slice(), tiepoint.as_slice())
        {
            if *dy < 0.0 {
                warn("the vertical pixel scale is negative; read as a north-up raster");
            }
            return Ok(Some([
                x - column * dx,
                *dx,
                0.0,
                y + row * dy.abs(),
                0.0,
                -dy.abs(),
            ]));
        }
        if let [a, b, _, d, e, f, _, h, ..] = matrix.as_slice() {
            return Ok(Some([*d, *a, *b, *h, *e, *f]));
        }
        if !tiepoint.is_empty() {
            warn("tiepoints without a pixel scale are not used; not georeferenced");
        }
        Ok(None)
    }

    /// Where uncompressed strips follow each other, the file is read as flat rows: a single strip can be as
    /// large as the raster.
    fn flat_layout(&mut self, info: &RasterInfo) -> Result<Option<Layout>> {
        if self.integer(Tag::Compression, 1)? != 1
            || self.integer(Tag::Predictor, 1)? != 1
            || self.tiff.get_chunk_type() != ChunkType::Strip
        {
            return Ok(None);
        }
        let strip_rows = u64::from(self.tiff.chunk_dimensions().1);
        let strip_bytes =
            u128::from(strip_rows) * u128::from(info.width) * info.sample_type.size() as u128;
        let offsets = self.integers(Tag::StripOffsets)?;
        let contiguous = offsets
            .iter()
            .zip(offsets.iter().skip(1))
            .all(|(&one, &next)| u128::from(one) + strip_bytes == u128::from(next));
        let Some(&skip) = offsets.first().filter(|_| contiguous) else {
            return Ok(None);
        };
        Ok(Some(Layout {
            skip,
            width: info.width,
            height: info.height,
            sample_type: info.sample_type,
            order: match self.tiff.byte_order() {
                TiffByteOrder::LittleEndian => ByteOrder::Little,
                TiffByteOrder::BigEndian => ByteOrder::Big,
            },
        }))
    }
}

/// The text of the first band's item with this role in GDAL's metadata.
fn gdal_item(xml: &str, role: &str) -> Option<String> {
    let role = format!("role=\"{role}\"");
    let item = xml.split("<Item ").skip(1).find_map(|item| {
        let (attributes, rest) = item.split_once('>')?;
        let first_band = !attributes.contains("sample=") || attributes.contains("sample=\"0\"");
        (first_band && attributes.contains(&role)).then(|| rest.split('<').next())?
    })?;
    Some(
        item.replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&quot;", "\"")
            .replace("&apos;", "'")
            .replace("&amp;", "&"),
    )
}

/// Reads strips, or rows of tiles, as they are needed; holds one band of them.
struct ChunkRows {
    path: PathBuf,
    tiff: TiffDecoder,
    sample_type: SampleType,
    width: u32,
    height: u32,
    chunk_width: u32,
    chunk_height: u32,
    /// The chunks of one band from left to right, in native byte order, without padding.
    band: Vec<Vec<u8>>,
    band_index: Option<u32>,
}

impl ChunkRows {
    fn new(path: &Path, tiff: TiffDecoder, info: &RasterInfo) -> ChunkRows {
        let (chunk_width, chunk_height) = tiff.chunk_dimensions();
        let chunk_height = chunk_height.min(info.height);
        let across = info.width.div_ceil(chunk_width) as usize;
        ChunkRows {
            path: path.to_path_buf(),
            tiff,
            sample_type: info.sample_type,
            width: info.width,
            height: info.height,
            chunk_width,
            chunk_height,
            band: vec![Vec::new(); across],
            band_index: None,
        }
    }

    fn load(&mut self, band_index: u32) -> Result<()> {
        let first = band_index * self.chunk_height;
        let last = first.saturating_add(self.chunk_height).min(self.height) - 1;
        let refuse = |cause: String| {
            Error::input(
                &self.path,
                format!("cannot read rows {first} to {last}: {cause}"),
            )
        };
        let across = self.band.len() as u32;
        for (column, bytes) in (0..across).zip(&mut self.band) {
            let chunk = band_index * across + column;
            let layout = self
                .tiff
                .image_chunk_buffer_layout(chunk)
                .map_err(|error| refuse(error.to_string()))?;
            if layout.complete_len > CHUNK_LIMIT {
                return Err(refuse(format!(
                    "a strip or tile has {} bytes, more than {CHUNK_LIMIT}",
                    layout.complete_len
                )));
            }
            bytes.resize(layout.complete_len, 0);
            self.tiff
                .read_chunk_bytes(chunk, bytes)
                .map_err(|error| refuse(error.to_string()))?;
        }
        self.band_index = Some(band_index);
        Ok(())
    }
}

impl RowReader for ChunkRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let band_index = row / self.chunk_height;
        if self.band_index != Some(band_index) {
            self.load(band_index)?;
        }
        let row_in_band = (row % self.chunk_height) as usize;
        let mut left = self.width;
        for (samples, bytes) in samples
            .chunks_mut(self.chunk_width as usize)
            .zip(&self.band)
        {
            let columns = left.min(self.chunk_width) as usize;
            left -= columns as u32;
            let row_bytes = columns * self.sample_type.size();
            let line = bytes
                .get(row_in_band * row_bytes..(row_in_band + 1) * row_bytes)
                .ok_or_else(|| {
                    Error::input(
                        &self.path,
                        format!("cannot read row {row}: chunk too short"),
                    )
                })?;
            decode(self.sample_type, ByteOrder::NATIVE, line, samples);
        }
        Ok(())
    }
}
