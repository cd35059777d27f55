//! Images that are textures: PNG and JPEG, by their first bytes.

use std::io::Cursor;

use png::{ColorType, Decoder, Limits, Transformations};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::blockmap::Texture;

const PNG: [u8; 4] = [0x89, b'P', b'N', b'G'];
const JPEG: [u8; 3] = [0xff, 0xd8, 0xff];

/// The pixels of an image file, at most `most` bytes of red, green and blue; transparency is left out. An error is the
/// cause, in one line.
pub(super) fn decode(bytes: &[u8], most: usize) -> Result<Texture, String> {
    if bytes.starts_with(&PNG) {
        png(bytes, most)
    } else if bytes.starts_with(&JPEG) {
        jpeg(bytes, most)
    } else {
        Err("neither a PNG nor a JPEG image".to_string())
    }
}

fn allowed(width: u32, height: u32, most: usize) -> Result<(), String> {
    let bytes = 3 * u64::from(width) * u64::from(height);
    if bytes > most as u64 {
        return Err(format!(
            "{width} x {height} pixels are {bytes} bytes; {most} more are allowed"
        ));
    }
    Ok(())
}

fn png(bytes: &[u8], most: usize) -> Result<Texture, String> {
    let limits = Limits {
        bytes: most.max(1 << 16),
    };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), limits);
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let (width, height) = (reader.info().width, reader.info().height);
    allowed(width, height, most)?;
    let (colours, _) = reader.output_color_type();
    let size = reader.output_buffer_size().ok_or("too large")?;
    let mut samples = vec![0; size];
    reader
        .next_frame(&mut samples)
        .map_err(|error| error.to_string())?;
    let pixels = match colours {
        ColorType::Rgb => samples,
        ColorType::Rgba => without_last(&samples, 4, |pixel| [pixel[0], pixel[1], pixel[2]]),
        ColorType::Grayscale => without_last(&samples, 1, |pixel| [pixel[0]; 3]),
        ColorType::GrayscaleAlpha => without_last(&samples, 2, |pixel| [pixel[0]; 3]),
        ColorType::Indexed => return Err("a palette without colours".to_string()),
    };
    Texture::new(width, height, pixels).ok_or_else(|| "it has no pixels".to_string())
}

fn without_last(samples: &[u8], bands: usize, colour: impl Fn(&[u8]) -> [u8; 3]) -> Vec<u8> {
    samples.chunks_exact(bands).flat_map(colour).collect()
}

fn jpeg(bytes: &[u8], most: usize) -> Result<Texture, String> {
    // Without the vector kernels every machine decodes to the same samples.
    let settings = DecoderOptions::default()
        .set_use_unsafe(false)
        .set_strict_mode(true)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), settings);
    let one_line = |text: String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    decoder
        .decode_headers()
        .map_err(|error| one_line(error.to_string()))?;
    match decoder.input_colorspace() {
        Some(ColorSpace::YCbCr | ColorSpace::RGB | ColorSpace::Luma) => {}
        other => {
            let name = other.map_or("unknown".to_string(), |space| format!("{space:?}"));
            return Err(format!("{name} colours are not supported"));
        }
    }
    let size = decoder.info().ok_or("it has no size")?;
    let (width, height) = (u32::from(size.width), u32::from(size.height));
    allowed(width, height, most)?;
    let pixels = decoder
        .decode()
        .map_err(|error| one_line(error.to_string()))?;
    Texture::new(width, height, pixels).ok_or_else(|| "its pixels are not complete".to_string())
}
