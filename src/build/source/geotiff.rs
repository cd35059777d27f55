//! GeoTIFF, one strip, or one row of tiles, at a time.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use tiff::decoder::{ChunkType, Decoder, Limits};
use tiff::tags::{ByteOrder as TiffByteOrder, Tag, Type, ValueBuffer};

use super::flat::{FlatRows, Layout};
use super::geokeys::{self, GeoKeys};
use super::samples::{ByteOrder, FileSource, RowReader, decode, not_colours, without_alpha};
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
    let alpha = if options.colour {
        tags.check_colours()?
    } else {
        tags.check_heights()?;
        false
    };
    let mut info = tags.info()?;
    info.bands = if options.colour { 3 } else { 1 };
    info.alpha = alpha;
    let info = options.complete(path, info)?;
    match tags.flat_layout(&info)? {
        Some(layout) => Ok(FileSource::boxed(path, info, FlatRows::open(path, layout)?)),
        None => {
            let planar = tags.planar()?;
            let rows = ChunkRows::new(path, tiff, &info, planar);
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

    /// Refuses what is no image of red, green and blue; returns whether it has an alpha band.
    fn check_colours(&mut self) -> Result<bool> {
        let refuse = |cause: String| Err(Error::input(self.path, cause));
        let bands = self.integer(Tag::SamplesPerPixel, 1)?;
        let alpha = match (bands, self.integers(Tag::ExtraSamples)?.as_slice()) {
            (3, []) => false,
            (4, [1 | 2]) => true,
            (4, _) => return refuse("4 bands, of which none is said to be alpha".to_string()),
            _ => return refuse(not_colours(bands)),
        };
        match self.integer(Tag::PhotometricInterpretation, 2)? {
            2 => {}
            6 => return refuse("YCbCr inside TIFF, which is not supported".to_string()),
            other => {
                return refuse(format!(
                    "photometric interpretation {other}, not red, green and blue"
                ));
            }
        }
        match self.sample_type()? {
            SampleType::U8 | SampleType::U16 => Ok(alpha),
            other => refuse(format!("{} samples; colours are u8 or u16", other.name())),
        }
    }

    /// Refuses what is no image of one grey band.
    fn check_heights(&mut self) -> Result<()> {
        let refuse = |cause: String| Err(Error::input(self.path, cause));
        let bands = self.integer(Tag::SamplesPerPixel, 1)?;
        if bands != 1 {
            return refuse(format!("{bands} bands; heights have one"));
        }
        match self.integer(Tag::PhotometricInterpretation, 1)? {
            1 => Ok(()),
            0 => refuse("grey from white to black, which is not supported".to_string()),
            3 => refuse("a palette image; heights are grey".to_string()),
            other => refuse(format!("photometric interpretation {other}, not grey")),
        }
    }

    fn planar(&mut self) -> Result<bool> {
        Ok(self.integer(Tag::PlanarConfiguration, 1)? == 2)
    }

    fn sample_type(&mut self) -> Result<SampleType> {
        let refuse = |cause: String| Err(Error::input(self.path, cause));
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

    /// All but the bands.
    fn info(&mut self) -> Result<RasterInfo> {
        let sample_type = self.sample_type()?;
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
            || info.alpha
            || info.bands > 1 && self.planar()?
        {
            return Ok(None);
        }
        let strip_rows = u64::from(self.tiff.chunk_dimensions().1);
        let row_bytes = info.row_length() as u128 * info.sample_type.size() as u128;
        let strip_bytes = u128::from(strip_rows) * row_bytes;
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
            row_length: info.row_length(),
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

/// Reads strips, or rows of tiles, as they are needed; holds one of them.
struct ChunkRows {
    path: PathBuf,
    tiff: TiffDecoder,
    sample_type: SampleType,
    width: u32,
    height: u32,
    chunk_width: u32,
    chunk_height: u32,
    /// Bands as the file has them: those of a sample, and alpha.
    stored_bands: usize,
    alpha: bool,
    /// Whether each band has chunks of its own.
    planar: bool,
    /// The chunks of one row of chunks, from left to right, in native byte order, without padding; where
    /// `planar`, one such row for each band.
    chunks: Vec<Vec<u8>>,
    chunk_row: Option<u32>,
    /// One row of one chunk.
    line: Vec<f64>,
    /// One row with its alpha, `[column * stored_bands + band]`; grows when the first row is read.
    stored: Vec<f64>,
}

impl ChunkRows {
    fn new(path: &Path, tiff: TiffDecoder, info: &RasterInfo, planar: bool) -> ChunkRows {
        let (chunk_width, chunk_height) = tiff.chunk_dimensions();
        let chunk_height = chunk_height.min(info.height);
        let across = info.width.div_ceil(chunk_width) as usize;
        let stored_bands = usize::from(info.bands) + usize::from(info.alpha);
        let planes = if planar { stored_bands } else { 1 };
        ChunkRows {
            path: path.to_path_buf(),
            tiff,
            sample_type: info.sample_type,
            width: info.width,
            height: info.height,
            chunk_width,
            chunk_height,
            stored_bands,
            alpha: info.alpha,
            planar,
            chunks: vec![Vec::new(); across * planes],
            chunk_row: None,
            line: Vec::new(),
            stored: Vec::new(),
        }
    }

    fn load(&mut self, chunk_row: u32) -> Result<()> {
        let first = chunk_row * self.chunk_height;
        let last = first.saturating_add(self.chunk_height).min(self.height) - 1;
        let refuse = |cause: String| {
            Error::input(
                &self.path,
                format!("cannot read rows {first} to {last}: {cause}"),
            )
        };
        let across = self.width.div_ceil(self.chunk_width);
        let down = self.height.div_ceil(self.chunk_height);
        for (index, bytes) in (0u32..).zip(&mut self.chunks) {
            let (plane, column) = (index / across, index % across);
            let chunk = (plane * down + chunk_row) * across + column;
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
        self.chunk_row = Some(chunk_row);
        Ok(())
    }

    /// Puts one row of all stored bands together from its chunks.
    fn gather(&mut self, row_in_chunk: usize, stored: &mut [f64]) -> Option<()> {
        let across = self.width.div_ceil(self.chunk_width) as usize;
        let chunk_bands = if self.planar { 1 } else { self.stored_bands };
        for (index, bytes) in self.chunks.iter().enumerate() {
            let (plane, column) = (index / across, index % across);
            let first = column * self.chunk_width as usize;
            let columns = (self.width as usize - first).min(self.chunk_width as usize);
            let length = columns * chunk_bands;
            let row_bytes = length * self.sample_type.size();
            let bytes = bytes.get(row_in_chunk * row_bytes..(row_in_chunk + 1) * row_bytes)?;
            self.line.resize(length, 0.0);
            decode(self.sample_type, ByteOrder::NATIVE, bytes, &mut self.line);
            let target = stored.get_mut(first * self.stored_bands..)?;
            if chunk_bands == self.stored_bands {
                target.get_mut(..length)?.copy_from_slice(&self.line);
            } else {
                let target = target.iter_mut().skip(plane).step_by(self.stored_bands);
                for (target, &number) in target.zip(&self.line) {
                    *target = number;
                }
            }
        }
        Some(())
    }
}

impl RowReader for ChunkRows {
    fn read_row(&mut self, row: u32, samples: &mut [f64]) -> Result<()> {
        let chunk_row = row / self.chunk_height;
        if self.chunk_row != Some(chunk_row) {
            self.load(chunk_row)?;
        }
        let row_in_chunk = (row % self.chunk_height) as usize;
        let short = "chunk too short";
        let refuse = |path: &Path, cause: &str| {
            Error::input(path, format!("cannot read row {row}: {cause}"))
        };
        if !self.alpha {
            let gathered = self.gather(row_in_chunk, samples);
            return gathered.ok_or_else(|| refuse(&self.path, short));
        }
        let mut stored = std::mem::take(&mut self.stored);
        stored.resize(self.width as usize * self.stored_bands, 0.0);
        self.gather(row_in_chunk, &mut stored)
            .ok_or_else(|| refuse(&self.path, short))?;
        without_alpha(&stored, self.sample_type.greatest(), samples)
            .map_err(|cause| refuse(&self.path, &cause))?;
        self.stored = stored;
        Ok(())
    }
}
