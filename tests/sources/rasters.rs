//! Random rasters, small writers for the formats, and what reading back gives.

use std::path::{Path, PathBuf};

use kimberlite::build::source::{RasterSource, SourceOptions, open};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use proptest::prelude::*;

/// A raster in memory; voids are NaN.
#[derive(Clone, Debug)]
pub struct Raster {
    pub info: RasterInfo,
    pub samples: Vec<f64>,
}

impl Raster {
    pub fn width(&self) -> usize {
        self.info.width as usize
    }

    /// The samples as a file stores them: voids are the nodata value, or NaN.
    pub fn stored(&self) -> impl Iterator<Item = f64> + '_ {
        let void = self.info.nodata.unwrap_or(f64::NAN);
        self.samples
            .iter()
            .map(move |&sample| if sample.is_nan() { void } else { sample })
    }

    /// All samples as bytes of their type.
    pub fn bytes(&self, big: bool) -> Vec<u8> {
        self.stored()
            .flat_map(|sample| sample_bytes(self.info.sample_type, sample, big))
            .collect()
    }

    pub fn copy_rows(&self, first: u32, rows: &mut [f64]) -> kimberlite::Result<()> {
        let start = first as usize * self.info.row_length();
        rows.copy_from_slice(&self.samples[start..start + rows.len()]);
        Ok(())
    }

    #[track_caller]
    pub fn assert_same_samples(&self, read: &[f64]) {
        assert_eq!(self.samples.len(), read.len());
        for (index, (a, b)) in self.samples.iter().zip(read).enumerate() {
            let same = a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
            assert!(same, "sample {index}: {a} became {b}");
        }
    }
}

pub fn sample_bytes(sample_type: SampleType, sample: f64, big: bool) -> Vec<u8> {
    let mut bytes = match sample_type {
        SampleType::U8 => (sample as u8).to_le_bytes().to_vec(),
        SampleType::I8 => (sample as i8).to_le_bytes().to_vec(),
        SampleType::U16 => (sample as u16).to_le_bytes().to_vec(),
        SampleType::I16 => (sample as i16).to_le_bytes().to_vec(),
        SampleType::U32 => (sample as u32).to_le_bytes().to_vec(),
        SampleType::I32 => (sample as i32).to_le_bytes().to_vec(),
        SampleType::F32 => (sample as f32).to_le_bytes().to_vec(),
        SampleType::F64 => sample.to_le_bytes().to_vec(),
    };
    if big {
        bytes.reverse();
    }
    bytes
}

/// The valid sample that some random bits stand for, over the whole range of the type, or NaN.
fn sample_of(sample_type: SampleType, bits: u64) -> f64 {
    let sample = match sample_type {
        SampleType::U8 => f64::from(bits as u8),
        SampleType::I8 => f64::from(bits as i8),
        SampleType::U16 => f64::from(bits as u16),
        SampleType::I16 => f64::from(bits as i16),
        SampleType::U32 => f64::from(bits as u32),
        SampleType::I32 => f64::from(bits as i32),
        SampleType::F32 => f64::from(f32::from_bits(bits as u32)),
        SampleType::F64 => f64::from_bits(bits),
    };
    if sample.is_infinite() { 0.5 } else { sample }
}

fn usual_nodata(sample_type: SampleType) -> f64 {
    match sample_type {
        SampleType::U8 => 255.0,
        SampleType::I8 => -128.0,
        SampleType::U16 => 65535.0,
        SampleType::I16 => -32768.0,
        SampleType::U32 => 4294967295.0,
        SampleType::I32 => -2147483648.0,
        SampleType::F32 | SampleType::F64 => -9999.0,
    }
}

/// Rasters of one of `types`, without a georeference; one sample in eight is void where the type or a
/// nodata value allows it.
pub fn rasters(types: &'static [SampleType], with_nodata: bool) -> impl Strategy<Value = Raster> {
    (prop::sample::select(types), 1u32..30, 1u32..30)
        .prop_flat_map(|(sample_type, width, height)| {
            let bits = prop::collection::vec(any::<u64>(), (width * height) as usize);
            (Just(RasterInfo::new(width, height, sample_type)), bits)
        })
        .prop_map(move |(mut info, bits)| {
            let kind = info.sample_type;
            info.nodata = with_nodata.then(|| usual_nodata(kind));
            let voids = with_nodata || !kind.is_integer();
            let samples = bits
                .iter()
                .map(|&bits| match sample_of(kind, bits) {
                    _ if voids && bits >> 61 == 0 => f64::NAN,
                    sample if Some(sample) == info.nodata => f64::NAN,
                    sample => sample,
                })
                .collect();
            Raster { info, samples }
        })
}

/// A georeference with numbers that are not round.
pub fn georeferenced(mut info: RasterInfo, registration: Registration) -> RasterInfo {
    info.geotransform = [1000.1, 0.3, 0.0, 2000.7, 0.0, -0.7];
    info.georeferenced = true;
    info.registration = registration;
    info
}

/// All rows of a source, in bands of several rows.
pub fn read_all(source: &mut dyn RasterSource) -> kimberlite::Result<Vec<f64>> {
    let (row_length, height) = (source.info().row_length(), source.info().height as usize);
    let mut samples = vec![0.0; row_length * height];
    samples
        .chunks_mut(3 * row_length)
        .try_for_each(|band| source.read_rows(band))?;
    Ok(samples)
}

/// Writes `bytes` under `name` in a folder that is gone when it is dropped.
pub fn in_folder(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

pub fn read_file(path: &Path, options: &SourceOptions) -> kimberlite::Result<Raster> {
    let mut source = open(path, options)?;
    let info = source.info().clone();
    Ok(Raster {
        info,
        samples: read_all(source.as_mut())?,
    })
}

/// What opening and reading a file says; fails if nothing is wrong.
#[track_caller]
pub fn message(path: &Path, options: &SourceOptions) -> String {
    let text = read_file(path, options)
        .expect_err("should have been refused")
        .to_string();
    assert!(!text.contains('\n'), "not one line: {text}");
    text
}

pub fn png(raster: &Raster) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, raster.info.width, raster.info.height);
    encoder.set_color(::png::ColorType::Grayscale);
    let depth = if raster.info.sample_type.size() == 1 {
        8
    } else {
        16
    };
    encoder.set_depth(::png::BitDepth::from_u8(depth).unwrap());
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&raster.bytes(true))
        .unwrap();
    bytes
}

pub fn ascii_grid(raster: &Raster, header: &str) -> String {
    let mut text = format!(
        "NCOLS {}\nnrows {}\n{header}",
        raster.info.width, raster.info.height
    );
    let stored: Vec<f64> = raster.stored().collect();
    for row in stored.chunks(raster.width()) {
        let tokens: Vec<String> = row
            .iter()
            .map(|sample| match raster.info.sample_type {
                SampleType::F64 => format!("{sample:?}"),
                _ => format!("{sample}"),
            })
            .collect();
        text += &tokens.join(" ");
        text += "\n";
    }
    text
}

/// An uncompressed TIFF without georeference, in strips of `rows` rows or square tiles of side `tile`.
pub fn plain_tiff(raster: &Raster, big: bool, rows: usize, tile: Option<usize>) -> Vec<u8> {
    let stored: Vec<f64> = raster.stored().collect();
    banded_tiff(&raster.info, &stored, 1, false, big, rows, tile)
}

/// The same of any number of bands, `[(row * width + column) * bands + band]`, interleaved or by plane.
pub fn banded_tiff(
    info: &RasterInfo,
    stored: &[f64],
    bands: usize,
    planar: bool,
    big: bool,
    rows: usize,
    tile: Option<usize>,
) -> Vec<u8> {
    let kind = info.sample_type;
    let (width, height) = (info.width as usize, info.height as usize);
    let (chunk_width, chunk_height) = tile.map_or((width, rows), |side| (side, side));
    let mut body = vec![0u8; 8];
    let (mut offsets, mut counts) = (Vec::new(), Vec::new());
    for plane in 0..if planar { bands } else { 1 } {
        for top in (0..height).step_by(chunk_height) {
            for left in (0..width).step_by(chunk_width) {
                offsets.push(body.len() as u32);
                let bottom = if tile.is_some() {
                    top + chunk_height
                } else {
                    height.min(top + rows)
                };
                for row in top..bottom {
                    for column in left..left + chunk_width {
                        let inside = row < height && column < width;
                        let which = if planar { plane..plane + 1 } else { 0..bands };
                        for band in which {
                            let index = (row * width + column) * bands + band;
                            let sample = if inside { stored[index] } else { 7.0 };
                            body.extend(sample_bytes(kind, sample, big));
                        }
                    }
                }
                counts.push(body.len() as u32 - offsets[offsets.len() - 1]);
            }
        }
    }
    let format = match kind {
        SampleType::U8 | SampleType::U16 | SampleType::U32 => 1,
        SampleType::I8 | SampleType::I16 | SampleType::I32 => 2,
        SampleType::F32 | SampleType::F64 => 3,
    };
    let one = |number: usize| vec![number as u32];
    let mut tags = vec![
        (256, one(width)),
        (257, one(height)),
        (258, vec![8 * kind.size() as u32; bands]),
        (259, one(1)),
        (262, one(if bands == 1 { 1 } else { 2 })),
        (277, one(bands)),
        (284, one(if planar { 2 } else { 1 })),
        (339, vec![format; bands]),
    ];
    if bands == 4 {
        tags.push((338, one(2)));
    }
    match tile {
        Some(side) => {
            tags.extend([
                (322, one(side)),
                (323, one(side)),
                (324, offsets),
                (325, counts),
            ]);
        }
        None => tags.extend([(273, offsets), (278, one(rows)), (279, counts)]),
    }
    tags.sort_by_key(|(tag, _)| *tag);
    finish_tiff(body, &tags, big)
}

/// The tags here that the reader takes as 16 bits only: planar configuration and extra samples.
const SHORT_TAGS: [u16; 2] = [284, 338];

/// Appends a directory of 32-bit values to a TIFF's body and fills in its header.
fn finish_tiff(mut body: Vec<u8>, tags: &[(u16, Vec<u32>)], big: bool) -> Vec<u8> {
    let short = |number: u16| {
        if big {
            number.to_be_bytes()
        } else {
            number.to_le_bytes()
        }
    };
    let long = |number: u32| {
        if big {
            number.to_be_bytes()
        } else {
            number.to_le_bytes()
        }
    };
    let mut directory = short(tags.len() as u16).to_vec();
    for (tag, values) in tags {
        directory.extend(short(*tag));
        if let (true, [value]) = (SHORT_TAGS.contains(tag), values.as_slice()) {
            directory.extend(short(3));
            directory.extend(long(1));
            directory.extend(short(*value as u16));
            directory.extend(short(0));
            continue;
        }
        directory.extend(short(4));
        directory.extend(long(values.len() as u32));
        match values.as_slice() {
            [value] => directory.extend(long(*value)),
            _ => {
                directory.extend(long(body.len() as u32));
                body.extend(values.iter().flat_map(|&value| long(value)));
            }
        }
    }
    directory.extend(long(0));
    let start = body.len() as u32;
    body[..2].copy_from_slice(if big { b"MM" } else { b"II" });
    body[2..4].copy_from_slice(&short(42));
    body[4..8].copy_from_slice(&long(start));
    body.extend(directory);
    body
}
