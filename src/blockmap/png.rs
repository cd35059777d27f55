//! One BlockMap as a PNG image, for other programs.
//!
//! Red, green, blue and alpha of 8 bits, exactly as in the layout, but the northernmost row first: a map with north at the top, and
//! walls that stand upright. What is not in the image is text, by its keyword: `Corner`, `Side`, `Heights`, `Slices`, `Exposure`,
//! `Roof slope`, numbers in decimal parted by spaces; and of 16-bit heights `Low heights`, two hexadecimal digits a texel, the
//! northernmost row first.

use super::layout::{BlockMap, image_bytes};
use crate::{Error, Result};
use ::png::{BitDepth, ColorType, Compression, Decoder, Encoder, Limits, Transformations};
use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufReader, BufWriter, Write as _};
use std::path::Path;
use std::str::FromStr;

const CORNER: &str = "Corner";
const SIDE: &str = "Side";
const HEIGHTS: &str = "Heights";
const SLICES: &str = "Slices";
const EXPOSURE: &str = "Exposure";
const ROOF_SLOPE: &str = "Roof slope";
const LOW_HEIGHTS: &str = "Low heights";
/// Most bytes that a reader holds beside the image.
const MOST_BYTES: usize = 1 << 20;

/// Writes a block as a PNG image.
///
/// # Errors
///
/// [`Error::Argument`] for a block that [`read_png`] would refuse; [`Error::Io`].
pub fn write_png(map: &BlockMap, path: &Path) -> Result<()> {
    check(map).map_err(Error::Argument)?;
    let failed = |error: ::png::EncodingError| match error {
        ::png::EncodingError::IoError(error) => Error::io(path, "cannot write")(error),
        other => Error::Argument(other.to_string()),
    };
    let file = File::create(path).map_err(Error::io(path, "cannot create"))?;
    let mut file = BufWriter::new(file);
    let mut encoder = Encoder::new(&mut file, map.width() as u32, map.side_texels as u32);
    encoder.set_color(ColorType::Rgba);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::High);
    let [west, south] = map.corner;
    let [low, high] = map.heights;
    for (keyword, text) in [
        (CORNER, format!("{west} {south}")),
        (SIDE, map.side.to_string()),
        (HEIGHTS, format!("{low} {high}")),
        (SLICES, map.slices.to_string()),
        (EXPOSURE, map.exposure.to_string()),
        (ROOF_SLOPE, map.roof_slope.to_string()),
    ] {
        encoder
            .add_text_chunk(keyword.to_owned(), text)
            .map_err(failed)?;
    }
    if let Some(plane) = &map.low_heights {
        let mut digits = String::with_capacity(2 * plane.len());
        for byte in plane.chunks_exact(map.side_texels).rev().flatten() {
            // A string takes whatever is written into it.
            let _ = write!(digits, "{byte:02x}");
        }
        encoder
            .add_ztxt_chunk(LOW_HEIGHTS.to_owned(), digits)
            .map_err(failed)?;
    }
    let rows = map.image.chunks_exact(4 * map.width()).rev();
    let image: Vec<u8> = rows.flatten().copied().collect();
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&image).map_err(failed)?;
    writer.finish().map_err(failed)?;
    file.flush().map_err(Error::io(path, "cannot write"))
}

/// Reads a block back from a PNG image.
///
/// # Errors
///
/// [`Error::Io`] where there is no such file; [`Error::Input`] for an image of another size or form, and where a text is missing or impossible.
pub fn read_png(path: &Path) -> Result<BlockMap> {
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    let wrong = |cause: String| Error::input(path, cause);
    let failed = |error: ::png::DecodingError| wrong(error.to_string());
    let limits = Limits { bytes: MOST_BYTES };
    let mut decoder = Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(failed)?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let form = (info.color_type, info.bit_depth);
    if form != (ColorType::Rgba, BitDepth::Eight) {
        return Err(wrong(format!("{form:?} instead of RGBA of 8 bits")));
    }
    let blank = BlockMap::new(height as usize, [0.0; 2], 1.0);
    let mut map = blank
        .ok()
        .filter(|map| map.width() == width as usize)
        .ok_or_else(|| {
            wrong(format!(
                "{width} x {height} pixels are not those of a BlockMap"
            ))
        })?;
    take_texts(&mut map, info).map_err(wrong)?;
    check(&map).map_err(wrong)?;
    let mut image = vec![0; image_bytes(map.side_texels)];
    if reader.output_buffer_size() != Some(image.len()) {
        return Err(wrong("an image of another size".to_owned()));
    }
    reader.next_frame(&mut image).map_err(failed)?;
    let rows = image.chunks_exact(4 * map.width()).rev();
    map.image = rows.flatten().copied().collect();
    Ok(map)
}

fn take_texts(map: &mut BlockMap, info: &::png::Info) -> std::result::Result<(), String> {
    let text = |keyword: &str| {
        let mut texts = info.uncompressed_latin1_text.iter();
        let found = texts.find(|text| text.keyword == keyword);
        found
            .map(|text| text.text.as_str())
            .ok_or_else(|| format!("it has no text `{keyword}`"))
    };
    map.corner = numbers(CORNER, text(CORNER)?)?;
    [map.side] = numbers(SIDE, text(SIDE)?)?;
    map.heights = numbers(HEIGHTS, text(HEIGHTS)?)?;
    [map.slices] = numbers(SLICES, text(SLICES)?)?;
    [map.exposure] = numbers(EXPOSURE, text(EXPOSURE)?)?;
    [map.roof_slope] = numbers(ROOF_SLOPE, text(ROOF_SLOPE)?)?;
    let mut compressed = info.compressed_latin1_text.iter();
    let Some(chunk) = compressed.find(|text| text.keyword == LOW_HEIGHTS) else {
        return Ok(());
    };
    let mut chunk = chunk.clone();
    chunk
        .decompress_text_with_limit(MOST_BYTES)
        .map_err(|error| format!("its text `{LOW_HEIGHTS}` is broken: {error}"))?;
    let digits = chunk.get_text().map_err(|error| error.to_string())?;
    let bytes = of_digits(&digits).filter(|bytes| bytes.len() == map.side_texels.pow(2));
    let Some(bytes) = bytes else {
        return Err(format!("its text `{LOW_HEIGHTS}` is no plane of heights"));
    };
    let rows = bytes.chunks_exact(map.side_texels).rev();
    map.low_heights = Some(rows.flatten().copied().collect());
    Ok(())
}

/// So many numbers, parted by spaces.
fn numbers<T: FromStr, const COUNT: usize>(
    keyword: &str,
    text: &str,
) -> std::result::Result<[T; COUNT], String> {
    let words = text.split(' ').map(str::parse);
    let numbers: Option<Vec<T>> = words.map(std::result::Result::ok).collect();
    let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| format!("impossible text `{keyword}`: `{text:.80}`"))
}

fn of_digits(text: &str) -> Option<Vec<u8>> {
    let digit = |byte: &u8| char::from(*byte).to_digit(16);
    let (pairs, []) = text.as_bytes().as_chunks::<2>() else {
        return None;
    };
    let byte = |[high, low]: &[u8; 2]| Some((digit(high)? << 4 | digit(low)?) as u8);
    pairs.iter().map(byte).collect()
}

/// What is impossible about a block.
fn check(map: &BlockMap) -> std::result::Result<(), String> {
    super::codec::check(map)?;
    let [west, south] = map.corner;
    let is_place = [west, south, map.side]
        .iter()
        .all(|number| number.is_finite());
    if !is_place || map.side <= 0.0 {
        return Err(format!("a square of {} m at {:?}", map.side, map.corner));
    }
    Ok(())
}
