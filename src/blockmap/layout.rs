//! One BlockMap: a city block as an image of fixed size (Di Benedetto's thesis, ch. 4.2.1).

use crate::{Error, Result};

/// Columns of the section of walls. Column 0 is not used: it stands for no wall.
pub const WALL_COLUMNS: usize = 256;
/// Bytes of a texel.
const TEXEL: usize = 4;

/// Heights, roofs and walls of a square of ground, on K x K texels.
///
/// The image has (2K + 256) x K texels of RGBA8, row by row; row 0 is the southernmost, column 0 the westernmost.
///
/// | columns | R | G | B | A |
/// |---|---|---|---|---|
/// | 0 to K - 1: shape | height | wall column, 0 for none | roof normal x | roof normal y |
/// | K to 2K - 1: roof and ground | red | green | blue | ambient occlusion |
/// | 2K to 2K + 255: walls | red | green | blue | ambient occlusion |
///
/// Rows are parted into as many equal slices as [`slices`](Self::slices) says, each with its own 255 columns of walls. The rows of a
/// slice's column are colours from the least to the greatest height, and in the last one the mean normal as a colour.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockMap {
    /// Texels along a side, K: 32, 64 or 128.
    pub side_texels: usize,
    /// Slices of the walls: a power of two, at most K / 2.
    pub slices: usize,
    /// West and south edge, in metres.
    pub corner: [f64; 2],
    /// Length of an edge, in metres.
    pub side: f64,
    /// Heights of the lowest and the highest code.
    pub heights: [f32; 2],
    /// A texel is exposed where it stands more than so many metres above one of its four neighbours.
    pub exposure: f32,
    /// Steepest roof, as rise over run: a ray that meets a step no steeper than this meets a roof.
    pub roof_slope: f32,
    /// `(2K + 256) * K * 4` bytes.
    pub image: Vec<u8>,
    /// The low bytes of 16-bit heights, `K * K`; without them heights have 8 bits.
    pub low_heights: Option<Vec<u8>>,
}

impl BlockMap {
    /// A flat, black block.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a side other than 32, 64 or 128.
    pub fn new(side_texels: usize, corner: [f64; 2], side: f64) -> Result<BlockMap> {
        if !matches!(side_texels, 32 | 64 | 128) {
            return Err(Error::Argument(format!(
                "a BlockMap of {side_texels} texels a side: 32, 64 or 128 are needed"
            )));
        }
        Ok(BlockMap {
            side_texels,
            slices: 1,
            corner,
            side,
            heights: [0.0; 2],
            exposure: 0.0,
            roof_slope: 0.0,
            image: vec![0; image_bytes(side_texels)],
            low_heights: None,
        })
    }

    /// Texels of a row of the image.
    pub fn width(&self) -> usize {
        2 * self.side_texels + WALL_COLUMNS
    }

    /// Metres along a texel.
    pub fn texel(&self) -> f64 {
        self.side / self.side_texels as f64
    }

    /// The texel of the image in this column and row.
    #[inline]
    pub fn at(&self, column: usize, row: usize) -> [u8; 4] {
        let first = TEXEL * (row * self.width() + column);
        let texel = &self.image[first..first + TEXEL];
        [texel[0], texel[1], texel[2], texel[3]]
    }

    /// Writes a texel of the image.
    pub fn set(&mut self, column: usize, row: usize, texel: [u8; 4]) {
        let first = TEXEL * (row * self.width() + column);
        self.image[first..first + TEXEL].copy_from_slice(&texel);
    }

    /// The code of a texel's height: 0 to [`top_code`](Self::top_code).
    pub fn height_code(&self, column: usize, row: usize) -> u16 {
        let high = self.image[TEXEL * (row * self.width() + column)];
        match &self.low_heights {
            Some(low) => u16::from_be_bytes([high, low[row * self.side_texels + column]]),
            None => u16::from(high),
        }
    }

    /// The greatest code of a height.
    pub fn top_code(&self) -> u16 {
        match self.low_heights {
            Some(_) => u16::MAX,
            None => u16::from(u8::MAX),
        }
    }

    /// A texel's height in metres.
    pub fn height(&self, column: usize, row: usize) -> f32 {
        let [low, high] = self.heights;
        let share = f32::from(self.height_code(column, row)) / f32::from(self.top_code());
        low + share * (high - low)
    }

    /// All heights, row by row.
    pub fn height_field(&self) -> Vec<f32> {
        let side = self.side_texels;
        let texels = (0..side).flat_map(|row| (0..side).map(move |column| (column, row)));
        texels
            .map(|(column, row)| self.height(column, row))
            .collect()
    }

    /// Stores heights, row by row, and the range that they need.
    pub fn set_heights(&mut self, heights: &[f32], has_16_bits: bool) {
        let low = heights.iter().copied().fold(f32::INFINITY, f32::min);
        let high = heights.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        self.heights = [low, high];
        self.low_heights = has_16_bits.then(|| vec![0; heights.len()]);
        let top = f32::from(self.top_code());
        let scale = if high > low { top / (high - low) } else { 0.0 };
        for (index, height) in heights.iter().enumerate() {
            let (column, row) = (index % self.side_texels, index / self.side_texels);
            let code = ((height - low) * scale).round().clamp(0.0, top) as u16;
            let first = TEXEL * (row * self.width() + column);
            match &mut self.low_heights {
                Some(plane) => [self.image[first], plane[index]] = code.to_be_bytes(),
                None => self.image[first] = code as u8,
            }
        }
    }

    /// A texel's column of walls, 0 for none.
    #[inline]
    pub fn wall_column(&self, column: usize, row: usize) -> u8 {
        self.image[TEXEL * (row * self.width() + column) + 1]
    }

    /// The unit normal of a roof or of the ground, z upwards.
    #[inline]
    pub fn roof_normal(&self, column: usize, row: usize) -> [f32; 3] {
        let [_, _, x, y] = self.at(column, row);
        let (x, y) = (direction(x), direction(y));
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        [x, y, z]
    }

    /// Colour and ambient occlusion of a roof or of the ground.
    #[inline]
    pub fn roof(&self, column: usize, row: usize) -> [u8; 4] {
        self.at(self.side_texels + column, row)
    }

    /// Rows of a slice.
    pub fn slice_rows(&self) -> usize {
        self.side_texels / self.slices
    }

    /// Rows of a slice that hold colours of walls.
    pub fn wall_rows(&self) -> usize {
        self.slice_rows() - 1
    }

    /// Where in the image the wall of the texel in `row`, in a wall column, has its colour at a height.
    #[inline]
    pub fn wall_place(&self, row: usize, wall_column: u8, height: f32) -> [usize; 2] {
        let [low, high] = self.heights;
        let share = if high > low {
            (height - low) / (high - low)
        } else {
            0.0
        };
        let rows = self.wall_rows();
        let above = ((share * rows as f32).max(0.0) as usize).min(rows - 1);
        let first = row / self.slice_rows() * self.slice_rows();
        [
            2 * self.side_texels + usize::from(wall_column),
            first + above,
        ]
    }

    /// Where in the image the wall of the texel in `row`, in a wall column, has its normal.
    #[inline]
    pub fn wall_normal_place(&self, row: usize, wall_column: u8) -> [usize; 2] {
        let slice = row / self.slice_rows();
        [
            2 * self.side_texels + usize::from(wall_column),
            (slice + 1) * self.slice_rows() - 1,
        ]
    }

    /// The mean normal of a wall column.
    #[inline]
    pub fn wall_normal(&self, row: usize, wall_column: u8) -> [f32; 3] {
        let [column, row] = self.wall_normal_place(row, wall_column);
        let [x, y, z, _] = self.at(column, row);
        [direction(x), direction(y), direction(z)]
    }
}

/// Bytes of the image of a block.
pub fn image_bytes(side_texels: usize) -> usize {
    (2 * side_texels + WALL_COLUMNS) * side_texels * TEXEL
}

/// A component of a unit vector out of its byte: 0 is -1, 254 is 1, 127 is 0.
#[inline]
pub fn direction(byte: u8) -> f32 {
    (f32::from(byte) - 127.0) / 127.0
}

/// The byte of a component of a unit vector.
pub fn direction_byte(component: f32) -> u8 {
    (component * 127.0 + 127.0).round().clamp(0.0, 254.0) as u8
}
