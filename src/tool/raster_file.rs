//! Writes a raster as a GeoTIFF file.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use tempfile::NamedTempFile;
use tiff::encoder::compression::{CompressionAlgorithm, Deflate};
use tiff::encoder::{
    DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard, TiffValue,
};
use tiff::tags::{Tag, Type};
use tiff::{Directory, TiffError};

use crate::build::source::geokeys;
use crate::build::source::samples::stored_value;
use crate::geo::{RasterInfo, Registration, SampleType};
use crate::{Error, Result};

/// Bytes of samples in a strip, about.
const STRIP_BYTES: usize = 1 << 18;

/// From this many bytes of samples on the file is a BigTIFF; leaves room for the tags below 4 GiB.
const BIG_TIFF_BYTES: u64 = 4_200_000_000;

/// Most bands of a file: red, green, blue and alpha.
const MOST_BANDS: usize = 4;

/// Writes `info.height` rows as a GeoTIFF of deflated strips, under a temporary name that is renamed at the
/// end; colours as interleaved red, green and blue. `rows` fills whole rows,
/// `[column * info.bands + band]`, the first of which has the given number, from the top, each once.
/// A void is NaN in all bands and is stored as `info.nodata`, and with `info.alpha` as alpha 0
/// (where all else has the type's greatest value).
///
/// # Errors
///
/// [`Error::Io`]; [`Error::Argument`], with column and row, for a sample that the type cannot hold,
/// for a void where an integer raster has neither a usable nodata value nor alpha, and for a valid
/// sample that equals the nodata value in all bands; and whatever `rows` returns.
pub fn write_geotiff(
    path: &Path,
    info: &RasterInfo,
    rows: impl FnMut(u32, &mut [f64]) -> Result<()>,
) -> Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut file = create_beside(folder).map_err(Error::io(path, "cannot create"))?;
    let bytes = (row_bytes(info) as u64).saturating_mul(u64::from(info.height));
    if bytes >= BIG_TIFF_BYTES {
        write_image::<TiffKindBig>(path, file.as_file_mut(), info, rows)?;
    } else {
        write_image::<TiffKindStandard>(path, file.as_file_mut(), info, rows)?;
    }
    file.persist(path)
        .map_err(|error| Error::io(path, "cannot rename to")(error.error))?;
    Ok(())
}

fn create_beside(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".kmb-").suffix(".tif");
    #[cfg(unix)]
    {
        // A temporary file is private by default; this one becomes an ordinary one.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

fn write_image<K: TiffKind>(
    path: &Path,
    file: &mut File,
    info: &RasterInfo,
    rows: impl FnMut(u32, &mut [f64]) -> Result<()>,
) -> Result<()> {
    let failed = |error| cannot_write(path, error);
    let mut buffered = BufWriter::with_capacity(1 << 20, file);
    {
        let mut tiff = TiffEncoder::<_, K>::new_generic(&mut buffered).map_err(failed)?;
        let mut image = Image {
            path,
            directory: tiff.image_directory().map_err(failed)?,
        };
        image.write_strips(info, rows)?;
        image.write_shape(info).map_err(failed)?;
        image.write_values(info).map_err(failed)?;
        if info.georeferenced {
            image.write_georeference(info).map_err(failed)?;
        }
        image.align().map_err(failed)?;
        image.directory.finish().map_err(failed)?;
    }
    buffered.flush().map_err(Error::io(path, "cannot write"))
}

fn cannot_write(path: &Path, error: TiffError) -> Error {
    let source = match error {
        TiffError::IoError(source) => source,
        other => std::io::Error::other(other),
    };
    Error::io(path, "cannot write")(source)
}

type TiffResult = std::result::Result<(), TiffError>;

/// One image directory in the making.
struct Image<'a, W: Write + std::io::Seek, K: TiffKind> {
    path: &'a Path,
    directory: DirectoryEncoder<'a, W, K>,
}

impl<W: Write + std::io::Seek, K: TiffKind> Image<'_, W, K> {
    /// Pads the file to a multiple of four bytes, on which values and directories should begin.
    fn align(&mut self) -> TiffResult {
        let offset = self.directory.write_data(&[0u8; 0][..])?;
        let padding = [0u8; 3];
        self.directory
            .write_data(&padding[..(offset.wrapping_neg() % 4) as usize])?;
        Ok(())
    }

    fn tag<T: TiffValue>(&mut self, tag: Tag, value: T) -> TiffResult {
        self.align()?;
        self.directory.write_tag(tag, value)
    }

    fn text(&mut self, tag: u16, bytes: &[u8]) -> TiffResult {
        self.align()?;
        let entry = self.directory.write_entry_bytes(Type::ASCII, bytes)?;
        let mut directory = Directory::empty();
        directory.extend([(Tag::Unknown(tag), entry)]);
        self.directory.extend_from(&directory);
        Ok(())
    }

    fn write_strips(
        &mut self,
        info: &RasterInfo,
        mut rows: impl FnMut(u32, &mut [f64]) -> Result<()>,
    ) -> Result<()> {
        let path = self.path;
        let failed = |error| cannot_write(path, error);
        let encoder = SampleEncoder::new(info);
        let rows_per_strip = rows_per_strip(info);
        let row_length = info.row_length();
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        let (mut samples, mut bytes, mut packed) = (Vec::new(), Vec::new(), Vec::new());
        for first in (0..info.height).step_by(rows_per_strip as usize) {
            let count = rows_per_strip.min(info.height - first) as usize;
            samples.resize(count * row_length, 0.0);
            rows(first, &mut samples)?;
            bytes.clear();
            for (row, line) in (first..).zip(samples.chunks_exact(row_length)) {
                encoder.encode(row, line, &mut bytes)?;
            }
            packed.clear();
            Deflate::default()
                .write_to(&mut packed, &bytes)
                .map_err(Error::io(path, "cannot write"))?;
            self.align().map_err(failed)?;
            let offset = self
                .directory
                .write_data(packed.as_slice())
                .map_err(failed)?;
            offsets.push(K::convert_offset(offset).map_err(failed)?);
            counts.push(K::convert_offset(packed.len() as u64).map_err(failed)?);
        }
        self.tag(Tag::StripOffsets, K::convert_slice(&offsets))
            .map_err(failed)?;
        self.tag(Tag::StripByteCounts, K::convert_slice(&counts))
            .map_err(failed)
    }

    fn write_shape(&mut self, info: &RasterInfo) -> TiffResult {
        const ADOBE_DEFLATE: u16 = 8;
        const BLACK_IS_ZERO: u16 = 1;
        const RED_GREEN_BLUE: u16 = 2;
        const UNASSOCIATED_ALPHA: u16 = 2;
        let format: u16 = match info.sample_type {
            SampleType::U8 | SampleType::U16 | SampleType::U32 => 1,
            SampleType::I8 | SampleType::I16 | SampleType::I32 => 2,
            SampleType::F32 | SampleType::F64 => 3,
        };
        let predictor: u16 = if info.sample_type.is_integer() { 2 } else { 1 };
        self.tag(Tag::ImageWidth, info.width)?;
        self.tag(Tag::ImageLength, info.height)?;
        let bands = stored_bands(info);
        let bits = vec![8 * info.sample_type.size() as u16; bands];
        let colours = if info.bands == 1 {
            BLACK_IS_ZERO
        } else {
            RED_GREEN_BLUE
        };
        self.tag(Tag::BitsPerSample, bits.as_slice())?;
        self.tag(Tag::Compression, ADOBE_DEFLATE)?;
        self.tag(Tag::PhotometricInterpretation, colours)?;
        self.tag(Tag::SamplesPerPixel, bands as u16)?;
        if info.alpha {
            self.tag(Tag::ExtraSamples, UNASSOCIATED_ALPHA)?;
        }
        self.tag(Tag::RowsPerStrip, rows_per_strip(info))?;
        self.tag(Tag::PlanarConfiguration, 1u16)?;
        self.tag(Tag::Predictor, predictor)?;
        self.tag(Tag::SampleFormat, vec![format; bands].as_slice())
    }

    /// Nodata, scale, offset and units.
    fn write_values(&mut self, info: &RasterInfo) -> TiffResult {
        if let Some(nodata) = info.nodata {
            self.text(geokeys::GDAL_NODATA, &terminated(&shortest(nodata)))?;
        }
        let plain = info.value_scale == 1.0 && info.value_offset == 0.0 && info.units.is_empty();
        let kept = info
            .metadata
            .get(&geokeys::metadata_key(geokeys::GDAL_METADATA));
        match kept {
            Some(bytes) => self.text(geokeys::GDAL_METADATA, bytes),
            None if plain => Ok(()),
            None => self.text(geokeys::GDAL_METADATA, &terminated(&gdal_metadata(info))),
        }
    }

    fn write_georeference(&mut self, info: &RasterInfo) -> TiffResult {
        let g = &info.geotransform;
        if g[1] > 0.0 && g[5] < 0.0 && g[2] == 0.0 && g[4] == 0.0 {
            let tiepoint = [0.0, 0.0, 0.0, g[0], g[3], 0.0];
            self.tag(Tag::ModelPixelScaleTag, &[g[1], -g[5], 0.0][..])?;
            self.tag(Tag::ModelTiepointTag, &tiepoint[..])?;
        } else {
            let mut matrix = [0.0; 16];
            matrix[..4].copy_from_slice(&[g[1], g[2], 0.0, g[0]]);
            matrix[4..8].copy_from_slice(&[g[4], g[5], 0.0, g[3]]);
            matrix[15] = 1.0;
            self.tag(Tag::ModelTransformationTag, &matrix[..])?;
        }
        let kept = |tag| info.metadata.get(&geokeys::metadata_key(tag));
        let Some(directory) = kept(geokeys::GEO_KEY_DIRECTORY) else {
            let (directory, ascii) = geo_keys(info);
            self.tag(Tag::GeoKeyDirectoryTag, directory.as_slice())?;
            return if ascii.is_empty() {
                Ok(())
            } else {
                self.text(geokeys::GEO_ASCII_PARAMS, &terminated(&ascii))
            };
        };
        let directory: Vec<u16> = directory
            .as_chunks()
            .0
            .iter()
            .map(|&bytes| u16::from_le_bytes(bytes))
            .collect();
        self.tag(Tag::GeoKeyDirectoryTag, directory.as_slice())?;
        if let Some(bytes) = kept(geokeys::GEO_DOUBLE_PARAMS) {
            let doubles: Vec<f64> = bytes
                .as_chunks()
                .0
                .iter()
                .map(|&bytes| f64::from_le_bytes(bytes))
                .collect();
            self.tag(Tag::GeoDoubleParamsTag, doubles.as_slice())?;
        }
        if let Some(bytes) = kept(geokeys::GEO_ASCII_PARAMS) {
            self.text(geokeys::GEO_ASCII_PARAMS, bytes)?;
        }
        Ok(())
    }
}

fn stored_bands(info: &RasterInfo) -> usize {
    usize::from(info.bands) + usize::from(info.alpha)
}

fn row_bytes(info: &RasterInfo) -> usize {
    info.width as usize * stored_bands(info) * info.sample_type.size()
}

fn rows_per_strip(info: &RasterInfo) -> u32 {
    (STRIP_BYTES / row_bytes(info).max(1)).clamp(1, info.height.max(1) as usize) as u32
}

fn terminated(text: &str) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.push(0);
    bytes
}

/// The shortest text that parses back to the same number.
fn shortest(number: f64) -> String {
    if number.is_nan() {
        return "nan".to_string();
    }
    let (plain, scientific) = (format!("{number}"), format!("{number:e}"));
    if scientific.len() < plain.len() {
        scientific
    } else {
        plain
    }
}

fn gdal_metadata(info: &RasterInfo) -> String {
    let units = info
        .units
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    let item = |name: &str, value: &str| {
        let role = name.to_ascii_lowercase();
        format!("  <Item name=\"{name}\" sample=\"0\" role=\"{role}\">{value}</Item>\n")
    };
    let mut items = item("OFFSET", &shortest(info.value_offset));
    items += &item("SCALE", &shortest(info.value_scale));
    if !units.is_empty() {
        items += &item("UNITTYPE", &units);
    }
    format!("<GDALMetadata>\n{items}</GDALMetadata>\n")
}

/// The key directory, and the text that it points to, from the reference system's name.
fn geo_keys(info: &RasterInfo) -> (Vec<u16>, String) {
    let (model, code_key, citation_key) = if info.geographic {
        (
            geokeys::MODEL_GEOGRAPHIC,
            geokeys::GEOGRAPHIC_TYPE,
            geokeys::GEOGRAPHIC_CITATION,
        )
    } else {
        (
            geokeys::MODEL_PROJECTED,
            geokeys::PROJECTED_TYPE,
            geokeys::PROJECTED_CITATION,
        )
    };
    let raster_type = match info.registration {
        Registration::Area => geokeys::RASTER_PIXEL_IS_AREA,
        Registration::Point => geokeys::RASTER_PIXEL_IS_POINT,
    };
    let mut keys: Vec<[u16; 4]> = Vec::new();
    let code = info
        .crs
        .strip_prefix("EPSG:")
        .and_then(|code| code.parse::<u16>().ok());
    let mut ascii = String::new();
    if code.is_some() || info.geographic || !info.crs.is_empty() {
        keys.push([geokeys::MODEL_TYPE, 0, 1, model]);
    }
    keys.push([geokeys::RASTER_TYPE, 0, 1, raster_type]);
    if let Some(code) = code {
        keys.push([code_key, 0, 1, code]);
    } else if !info.crs.is_empty() {
        ascii = format!("{}{}|", geokeys::WKT_PREFIX, info.crs);
        // A longer text than a key's count can say is cut off rather than lost altogether.
        let length = ascii.len().min(usize::from(u16::MAX)) as u16;
        keys.push([geokeys::CITATION, geokeys::GEO_ASCII_PARAMS, length, 0]);
        keys.push([code_key, 0, 1, geokeys::USER_DEFINED]);
        keys.push([citation_key, geokeys::GEO_ASCII_PARAMS, length, 0]);
    }
    let mut directory = vec![1, 1, 0, keys.len() as u16];
    directory.extend(keys.into_iter().flatten());
    (directory, ascii)
}

/// Turns rows of samples into the bytes of a strip.
struct SampleEncoder {
    sample_type: SampleType,
    bands: usize,
    alpha: bool,
    /// What stands for a void in every band.
    void: Option<f64>,
}

impl SampleEncoder {
    fn new(info: &RasterInfo) -> SampleEncoder {
        let nodata = info
            .nodata
            .and_then(|value| stored_value(value, info.sample_type));
        SampleEncoder {
            sample_type: info.sample_type,
            bands: usize::from(info.bands),
            alpha: info.alpha,
            void: nodata.or((!info.sample_type.is_integer()).then_some(f64::NAN)),
        }
    }

    /// Appends one row in native byte order; integers as differences from their left neighbours.
    fn encode(&self, row: u32, samples: &[f64], bytes: &mut Vec<u8>) -> Result<()> {
        let mut left = [0.0; MOST_BANDS];
        for (column, sample) in samples.chunks_exact(self.bands).enumerate() {
            let mut stored = [0.0; MOST_BANDS];
            self.store(sample, &mut stored).ok_or_else(|| {
                let cause = self.refusal(sample);
                Error::Argument(format!("the sample at column {column}, row {row} {cause}"))
            })?;
            let bands = self.bands + usize::from(self.alpha);
            for (&number, left) in stored.iter().zip(&left).take(bands) {
                let difference = (number - left) as i64;
                match self.sample_type {
                    SampleType::U8 | SampleType::I8 => bytes.push(difference as u8),
                    SampleType::U16 | SampleType::I16 => {
                        bytes.extend_from_slice(&(difference as u16).to_ne_bytes());
                    }
                    SampleType::U32 | SampleType::I32 => {
                        bytes.extend_from_slice(&(difference as u32).to_ne_bytes());
                    }
                    SampleType::F32 => bytes.extend_from_slice(&(number as f32).to_ne_bytes()),
                    SampleType::F64 => bytes.extend_from_slice(&number.to_ne_bytes()),
                }
            }
            left = stored;
        }
        Ok(())
    }

    /// The numbers to store, exact in the sample type, if the sample has them.
    fn store(&self, sample: &[f64], stored: &mut [f64; MOST_BANDS]) -> Option<()> {
        let (bands, alpha) = stored.split_at_mut_checked(self.bands)?;
        if sample.iter().any(|number| number.is_nan()) {
            bands.fill(self.void.or(self.alpha.then_some(0.0))?);
            return Some(());
        }
        for (band, &number) in bands.iter_mut().zip(sample) {
            *band = stored_value(number, self.sample_type)?;
        }
        if bands.iter().all(|&number| Some(number) == self.void) {
            return None;
        }
        if let (true, Some(alpha)) = (self.alpha, alpha.first_mut()) {
            *alpha = self.sample_type.greatest();
        }
        Some(())
    }

    fn refusal(&self, sample: &[f64]) -> String {
        if sample.iter().any(|number| number.is_nan()) {
            return "is void, but there is no nodata value that the type can hold".to_string();
        }
        let beyond = |number: &&f64| stored_value(**number, self.sample_type).is_none();
        match (sample.iter().find(beyond), self.void) {
            (Some(number), _) => {
                format!("is {number}, which {} cannot hold", self.sample_type.name())
            }
            (None, void) => format!(
                "is valid, but equals the nodata value {}",
                void.unwrap_or(f64::NAN)
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::build::source::{SourceOptions, open};

    #[test]
    fn big_tiff_reads_back_like_any_other() {
        let mut info = RasterInfo::new(300, 500, SampleType::I16);
        info.nodata = Some(-9999.0);
        info.georeferenced = true;
        info.crs = "EPSG:32610".to_string();
        let rows = |first: u32, rows: &mut [f64]| {
            for (index, sample) in (first * 300..).zip(rows) {
                *sample = if index % 7 == 0 {
                    f64::NAN
                } else {
                    f64::from(index % 3001)
                };
            }
            Ok(())
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("big.tif");
        write_image::<TiffKindBig>(&path, &mut File::create(&path).unwrap(), &info, rows).unwrap();
        assert_eq!(std::fs::read(&path).unwrap()[2], 43);
        let mut source = open(&path, &SourceOptions::default()).unwrap();
        assert_eq!((source.info().width, source.info().height), (300, 500));
        assert_eq!(
            (source.info().crs.as_str(), source.info().nodata),
            ("EPSG:32610", info.nodata)
        );
        let (mut expected, mut read) = (vec![0.0; 150_000], vec![0.0; 150_000]);
        rows(0, &mut expected).unwrap();
        source.read_rows(&mut read).unwrap();
        assert!(
            expected
                .iter()
                .zip(&read)
                .all(|(a, b)| a == b || a.is_nan() && b.is_nan())
        );
    }
}
