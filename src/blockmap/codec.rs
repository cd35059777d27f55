//! A BlockMap as few bytes, without loss: planes of prediction errors, compressed by Zstandard.

use super::layout::{BlockMap, WALL_COLUMNS};
use crate::{Error, Result};

/// The form of the bytes that this library writes.
const FORM: u8 = 1;
/// Form, log2 of K, log2 of the slices, flags, four floats.
const HEADER_LENGTH: usize = 4 + 4 * 4;
const HAS_16_BITS: u8 = 1;
/// Zstandard's: beyond it bakes get slower than files get smaller.
const LEVEL: i32 = 12;
/// The row begins without one above it.
const RESTART: u8 = 0;

/// How a value is foreseen from the ones before it in its plane.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Predictor {
    /// By 0.
    Zero = 0,
    /// By the one to the left.
    Left = 1,
    /// By the one above.
    Above = 2,
    /// By left + above - their corner, at least the smaller and at most the greater of the two.
    Gradient = 3,
}

const PREDICTORS: [Predictor; 4] = [
    Predictor::Zero,
    Predictor::Left,
    Predictor::Above,
    Predictor::Gradient,
];

/// One channel of a part of the image.
struct Plane {
    columns: std::ops::Range<usize>,
    rows: Vec<usize>,
    channel: usize,
    /// Rows after which one begins anew.
    period: usize,
    /// Whether green is taken from it.
    is_relative: bool,
}

/// All planes of a block, in the order of the bytes; wall columns come before them.
fn planes(side: usize, slices: usize) -> Vec<Plane> {
    let all: Vec<usize> = (0..side).collect();
    let slice_rows = side / slices;
    let is_normal = |row: &usize| row % slice_rows == slice_rows - 1;
    let normals: Vec<usize> = all.iter().copied().filter(is_normal).collect();
    let colours: Vec<usize> = all.iter().copied().filter(|row| !is_normal(row)).collect();
    let plane = |columns: std::ops::Range<usize>, rows: &[usize], channel, period| Plane {
        columns,
        rows: rows.to_vec(),
        channel,
        period,
        is_relative: false,
    };
    let walls = 2 * side..2 * side + WALL_COLUMNS;
    let shape = [0, 2, 3].map(|channel| plane(0..side, &all, channel, side));
    let roofs = [1, 0, 2, 3].map(|channel| Plane {
        is_relative: matches!(channel, 0 | 2),
        ..plane(side..2 * side, &all, channel, side)
    });
    let sides = [1, 0, 2, 3].map(|channel| Plane {
        is_relative: matches!(channel, 0 | 2),
        ..plane(walls.clone(), &colours, channel, slice_rows - 1)
    });
    let facing = [0, 1, 2, 3].map(|channel| plane(walls.clone(), &normals, channel, 1));
    shape
        .into_iter()
        .chain(roofs)
        .chain(sides)
        .chain(facing)
        .collect()
}

/// The bytes of a block, but for its place.
///
/// # Errors
///
/// [`Error::Argument`] where Zstandard fails.
pub fn encode(map: &BlockMap) -> Result<Vec<u8>> {
    let flags = if map.low_heights.is_some() {
        HAS_16_BITS
    } else {
        0
    };
    let logs = [map.side_texels, map.slices].map(|count| count.ilog2() as u8);
    let mut bytes = vec![FORM, logs[0], logs[1], flags];
    for number in [map.heights[0], map.heights[1], map.exposure, map.roof_slope] {
        bytes.extend(number.to_le_bytes());
    }
    let mut plain = Vec::with_capacity(map.image.len());
    plain.extend(map.low_heights.iter().flatten());
    put_columns(map, &mut plain);
    for plane in planes(map.side_texels, map.slices) {
        let values = plane.read(map);
        let errors = PREDICTORS.map(|predictor| {
            let errors = differences(&values, plane.columns.len(), plane.period, predictor);
            (cost(&errors), predictor, errors)
        });
        if let Some((_, predictor, errors)) = errors.into_iter().min_by_key(|(cost, ..)| *cost) {
            plain.push(predictor as u8);
            plain.extend(errors);
        }
    }
    let compressed = zstd::bulk::compress(&plain, LEVEL)
        .map_err(|error| Error::Argument(format!("a block cannot be compressed: {error}")))?;
    bytes.extend(compressed);
    Ok(bytes)
}

/// The block of [`encode`]d bytes, at a place. Bytes behind them that are 0 are padding.
///
/// # Errors
///
/// What is wrong with the bytes.
pub fn decode(
    bytes: &[u8],
    (corner, side): ([f64; 2], f64),
) -> std::result::Result<BlockMap, String> {
    let Some((header, body)) = bytes.split_first_chunk::<HEADER_LENGTH>() else {
        return Err(format!("{} bytes of a block", bytes.len()));
    };
    let [form, side_log2, slices_log2, flags, ..] = *header;
    if form != FORM || !(5..=7).contains(&side_log2) || slices_log2 >= side_log2 || flags > 1 {
        return Err(format!(
            "an impossible block: form {form}, 2^{side_log2} texels, 2^{slices_log2} slices, flags {flags}"
        ));
    }
    let side_texels = 1 << side_log2;
    let mut map = BlockMap::new(side_texels, corner, side).map_err(|error| error.to_string())?;
    map.slices = 1 << slices_log2;
    let float = |index: usize| {
        let first = 4 + 4 * index;
        f32::from_le_bytes([
            header[first],
            header[first + 1],
            header[first + 2],
            header[first + 3],
        ])
    };
    let numbers = [0, 1, 2, 3].map(float);
    if numbers.iter().any(|number| !number.is_finite()) || numbers[0] > numbers[1] {
        return Err(format!("impossible heights or steps {numbers:?}"));
    }
    [map.heights[0], map.heights[1], map.exposure, map.roof_slope] = numbers;
    let has_16_bits = flags & HAS_16_BITS != 0;
    let planes = planes(side_texels, map.slices);
    let low = if has_16_bits {
        side_texels * side_texels
    } else {
        0
    };
    let length = low + map.image.len() + planes.len();
    let frame = zstd::zstd_safe::find_frame_compressed_size(body)
        .map_err(|_| "its Zstandard frame is broken".to_owned())?;
    let plain = zstd::bulk::decompress(&body[..frame], length)
        .map_err(|error| format!("it cannot be decompressed: {error}"))?;
    if plain.len() != length {
        return Err(format!(
            "it decompresses to {} bytes instead of {length}",
            plain.len()
        ));
    }
    let (low, rest) = plain.split_at(low);
    map.low_heights = has_16_bits.then(|| low.to_vec());
    let (columns, mut rest) = rest.split_at(side_texels * side_texels);
    take_columns(&mut map, columns);
    for plane in planes {
        let count = plane.rows.len() * plane.columns.len();
        let (own, after) = rest.split_at(count + 1);
        rest = after;
        let Some(predictor) = PREDICTORS.get(usize::from(own[0])) else {
            return Err(format!("unknown predictor {}", own[0]));
        };
        let values = sums(&own[1..], plane.columns.len(), plane.period, *predictor);
        plane.write(&mut map, &values);
    }
    Ok(map)
}

/// Wall columns, of which most are one more than the one before in their slice: 0 for none, else 1 + the rest.
fn put_columns(map: &BlockMap, plain: &mut Vec<u8>) {
    let mut last = 0;
    for row in 0..map.side_texels {
        if row % map.slice_rows() == 0 {
            last = 0;
        }
        for column in 0..map.side_texels {
            let wall = i32::from(map.wall_column(column, row));
            let further = (wall - last - 1).rem_euclid(255) + 1;
            plain.push(if wall == 0 { 0 } else { further as u8 });
            last = if wall == 0 { last } else { wall };
        }
    }
}

fn take_columns(map: &mut BlockMap, codes: &[u8]) {
    let (side, rows) = (map.side_texels, map.slice_rows());
    let mut last = 0;
    for (index, &code) in codes.iter().enumerate() {
        let (column, row) = (index % side, index / side);
        if index % (side * rows) == 0 {
            last = 0;
        }
        if code != 0 {
            last = (last + i32::from(code) - 1).rem_euclid(255) + 1;
            map.set(column, row, [0, last as u8, 0, 0]);
        }
    }
}

impl Plane {
    fn read(&self, map: &BlockMap) -> Vec<u8> {
        let places = self
            .rows
            .iter()
            .flat_map(|&row| self.columns.clone().map(move |c| (c, row)));
        let value = |(column, row)| {
            let texel = map.at(column, row);
            let green = if self.is_relative { texel[1] } else { 0 };
            texel[self.channel].wrapping_sub(green)
        };
        places.map(value).collect()
    }

    /// Green comes before what is relative to it.
    fn write(&self, map: &mut BlockMap, values: &[u8]) {
        let width = self.columns.len();
        for (line, &row) in self.rows.iter().enumerate() {
            let first = 4 * (row * map.width() + self.columns.start);
            let texels = map.image[first..first + 4 * width].as_chunks_mut::<4>().0;
            for (texel, value) in texels.iter_mut().zip(&values[line * width..]) {
                let green = if self.is_relative { texel[1] } else { 0 };
                texel[self.channel] = value.wrapping_add(green);
            }
        }
    }
}

/// The value that is foreseen from the ones to the left, above, and at the corner between them.
fn foresee(predictor: Predictor, left: u8, above: u8, corner: u8) -> u8 {
    match predictor {
        Predictor::Zero => 0,
        Predictor::Left => left,
        Predictor::Above => above,
        Predictor::Gradient => {
            let (low, high) = (left.min(above), left.max(above));
            let plane = i16::from(left) + i16::from(above) - i16::from(corner);
            plane.clamp(i16::from(low), i16::from(high)) as u8
        }
    }
}

fn differences(values: &[u8], width: usize, period: usize, predictor: Predictor) -> Vec<u8> {
    let mut errors = Vec::with_capacity(values.len());
    let none = vec![RESTART; width];
    for (line, row) in values.chunks_exact(width).enumerate() {
        let restarts = line % period == 0;
        let above = if restarts {
            &none[..]
        } else {
            &values[(line - 1) * width..line * width]
        };
        let predictor = if restarts { Predictor::Left } else { predictor };
        let (mut left, mut corner) = (0, 0);
        for (&value, &above) in row.iter().zip(above) {
            errors.push(value.wrapping_sub(foresee(predictor, left, above, corner)));
            (left, corner) = (value, above);
        }
    }
    errors
}

fn sums(errors: &[u8], width: usize, period: usize, predictor: Predictor) -> Vec<u8> {
    let mut values = vec![0u8; errors.len()];
    let none = vec![RESTART; width];
    for (line, row) in errors.chunks_exact(width).enumerate() {
        let restarts = line % period == 0;
        let (before, own) = values.split_at_mut(line * width);
        let above = if restarts {
            &none[..]
        } else {
            &before[(line - 1) * width..]
        };
        let predictor = if restarts { Predictor::Left } else { predictor };
        let (mut left, mut corner) = (0, 0);
        for ((value, &error), &above) in own.iter_mut().zip(row).zip(above) {
            *value = error.wrapping_add(foresee(predictor, left, above, corner));
            (left, corner) = (*value, above);
        }
    }
    values
}

/// What errors would take, about: the sum of their sizes.
fn cost(errors: &[u8]) -> u64 {
    let size = |error: &u8| u64::from((*error as i8).unsigned_abs());
    errors.iter().map(size).sum()
}
