//! The block of one diamond: its void mask, then its coefficients (`docs/format.md`).

use super::{Matrix, Outline, Refined, mask};
use crate::entropy::bits::{BitReader, BitWriter};
use crate::entropy::{self, gamma};
use crate::transform::{Coefficients, Target, Transform, Validity};

/// One byte an entry of a matrix: 1 or 0.
type Mask = Box<[u8]>;

/// Why a block's bytes cannot be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BlockError {
    /// The coefficients are not what their coder writes.
    #[error(transparent)]
    Coefficients(#[from] entropy::Error),
    /// Bytes follow the last coefficient.
    #[error("it goes on after its last coefficient")]
    Surplus,
    /// The void mask's length runs beyond the block.
    #[error("its void mask is longer than the block")]
    Mask,
}

/// Codes what refining a diamond gives, in the knowledge of its vertices.
pub struct BlockCodec {
    cells: usize,
    has_voids: bool,
    /// Most zero bytes that may follow a block, to fill the file's unit of length.
    padding: usize,
    transform: Box<dyn Transform>,
}

impl BlockCodec {
    /// A codec for diamonds of `cells` cells; `has_voids` says whether any sample of the whole raster
    /// is void, so that rasters without any spend nothing on masks.
    pub fn new(cells: usize, has_voids: bool, transform: Box<dyn Transform>) -> BlockCodec {
        BlockCodec {
            cells,
            has_voids,
            padding: usize::from(block_length_unit(cells)) - 1,
            transform,
        }
    }

    /// What makes coefficients of heights.
    pub fn transform(&self) -> &dyn Transform {
        &*self.transform
    }

    /// Bytes that lead from a diamond's decoded vertices to its heights on the next level, in units.
    ///
    /// `voids` (N^2) holds 1 where a codable centre has no data. The empty block stands for
    /// coefficients all zero, and voids exactly where [`all_void_by_default`] says.
    pub fn encode(
        &self,
        vertices: &Matrix,
        outline: &Outline,
        target: Target,
        voids: Option<&[u8]>,
    ) -> Vec<u8> {
        let coded = coded_centres(outline, voids);
        let validity = validity(vertices, outline, &coded);
        let coefficients = self.transform.analyse(&validity, &vertices.values, target);
        let all_void = coded.as_ref().is_some_and(|coded| !coded.contains(&1));
        let by_default = self.has_voids && all_void_by_default(vertices);
        let uniform = voids.is_none_or(|voids| !voids.contains(&1)) || all_void;
        let zero = coefficients.are_zero();
        if zero && uniform && (voids.is_some() && all_void) == by_default {
            return Vec::new();
        }
        let mut bytes = Vec::new();
        if self.has_voids {
            match voids {
                Some(voids) if voids.contains(&1) => {
                    let (valid, codable) = (vertices.valid.as_deref(), outline.codable.as_deref());
                    let mask = mask::encode(self.cells, valid, codable, voids);
                    // A mask may be coded in no byte at all; 0 says that there is none.
                    write_length(mask.len() + 1, &mut bytes);
                    bytes.extend(mask);
                }
                _ => write_length(0, &mut bytes),
            }
        }
        let mut bits = BitWriter::new();
        gamma::encode(
            &coefficients.centres,
            self.cells,
            coded.as_deref(),
            &mut bits,
        );
        if let Some(inner) = &coefficients.vertices {
            let coded = self.transform.coded_vertices(&validity);
            gamma::encode(inner, self.cells, coded.as_deref(), &mut bits);
        }
        bytes.extend(bits.into_bytes());
        bytes
    }

    /// The heights on the next level that a block leads to.
    ///
    /// # Errors
    ///
    /// [`BlockError`] when the bytes are not a block of this codec; bytes that are damaged in another way
    /// give other heights, never undefined ones.
    pub fn decode(
        &self,
        vertices: &Matrix,
        outline: &Outline,
        block: &[u8],
    ) -> Result<Refined, BlockError> {
        let (voids, rest) = if block.is_empty() {
            let all_void = self.has_voids && all_void_by_default(vertices);
            let voids = all_void.then(|| vec![1; self.cells * self.cells].into_boxed_slice());
            (voids, None)
        } else {
            let (voids, rest) = self.decode_mask(vertices, outline, block)?;
            (voids, Some(rest))
        };
        let coded = coded_centres(outline, voids.as_deref());
        let coefficients = self.decode_coefficients(&validity(vertices, outline, &coded), rest)?;
        Ok(self.refine(vertices, outline, coded, &coefficients))
    }

    /// What [`decode`](Self::decode) gives for the block that [`encode`](Self::encode) makes of the same.
    pub fn preview(
        &self,
        vertices: &Matrix,
        outline: &Outline,
        target: Target,
        voids: Option<&[u8]>,
    ) -> Refined {
        let coded = coded_centres(outline, voids);
        let validity = validity(vertices, outline, &coded);
        let coefficients = self.transform.analyse(&validity, &vertices.values, target);
        self.refine(vertices, outline, coded, &coefficients)
    }

    fn refine(
        &self,
        vertices: &Matrix,
        outline: &Outline,
        coded: Option<Mask>,
        coefficients: &Coefficients,
    ) -> Refined {
        let heights = self.transform.synthesise(
            &validity(vertices, outline, &coded),
            &vertices.values,
            coefficients,
        );
        let centres = match coded {
            Some(valid) => Matrix::new(heights.centres, valid),
            None => Matrix {
                values: heights.centres,
                valid: None,
            },
        };
        let vertices = heights.vertices.map(|values| Matrix {
            values,
            valid: vertices.valid.clone(),
        });
        Refined { vertices, centres }
    }

    /// The coefficients in the bytes that end a block; all zero for the empty block.
    fn decode_coefficients(
        &self,
        validity: &Validity,
        bytes: Option<&[u8]>,
    ) -> Result<Coefficients, BlockError> {
        let zeros = || vec![0; self.cells * self.cells].into_boxed_slice();
        let coded_vertices = self.transform.coded_vertices(validity);
        let mut coefficients = Coefficients {
            centres: zeros(),
            vertices: coded_vertices.is_some().then(zeros),
        };
        let Some(bytes) = bytes else {
            return Ok(coefficients);
        };
        let (side, mut bits) = (self.cells, BitReader::new(bytes));
        gamma::decode(&mut bits, side, validity.centres, &mut coefficients.centres)?;
        if let Some(inner) = &mut coefficients.vertices {
            gamma::decode(&mut bits, side, coded_vertices.as_deref(), inner)?;
        }
        let used = bits.position().div_ceil(8);
        let surplus = bytes.get(used..).unwrap_or_default();
        if surplus.len() > self.padding || surplus.iter().any(|&byte| byte != 0) {
            return Err(BlockError::Surplus);
        }
        Ok(coefficients)
    }

    /// The void mask at the start of a block, and the rest of the block.
    fn decode_mask<'a>(
        &self,
        vertices: &Matrix,
        outline: &Outline,
        block: &'a [u8],
    ) -> Result<(Option<Mask>, &'a [u8]), BlockError> {
        if !self.has_voids {
            return Ok((None, block));
        }
        let (length, rest) = read_length(block).ok_or(BlockError::Mask)?;
        if length == 0 {
            return Ok((None, rest));
        }
        let (bytes, rest) = rest.split_at_checked(length - 1).ok_or(BlockError::Mask)?;
        let (valid, codable) = (vertices.valid.as_deref(), outline.codable.as_deref());
        Ok((Some(mask::decode(self.cells, valid, codable, bytes)), rest))
    }
}

/// Bytes that a block's length is a multiple of, so that every possible length fits 16 bits.
pub fn block_length_unit(cells: usize) -> u8 {
    if cells > 64 { 4 } else { 1 }
}

/// What the empty block means for voids: a diamond without any valid vertex is void throughout, any
/// other has no void.
fn all_void_by_default(vertices: &Matrix) -> bool {
    !vertices.any_valid()
}

/// 1 where a centre is coded, and so valid: codable and not void; `None` when all are.
fn coded_centres(outline: &Outline, voids: Option<&[u8]>) -> Option<Mask> {
    match (outline.codable.as_deref(), voids) {
        (None, None) => None,
        (Some(codable), None) => Some(codable.into()),
        (None, Some(voids)) => Some(voids.iter().map(|&void| 1 - void).collect()),
        (Some(codable), Some(voids)) => Some(
            codable
                .iter()
                .zip(voids)
                .map(|(&codable, &void)| codable & (1 - void))
                .collect(),
        ),
    }
}

fn validity<'a>(
    vertices: &'a Matrix,
    outline: &Outline,
    coded_centres: &'a Option<Mask>,
) -> Validity<'a> {
    Validity {
        vertices: vertices.valid.as_deref(),
        centres: coded_centres.as_deref(),
        absent: outline.absent,
    }
}

/// Seven bits a byte, low ones first; the high bit says that another byte follows.
fn write_length(mut length: usize, bytes: &mut Vec<u8>) {
    while length >= 128 {
        bytes.push(length as u8 | 128);
        length >>= 7;
    }
    bytes.push(length as u8);
}

/// A length of at most three bytes, and what follows it.
fn read_length(bytes: &[u8]) -> Option<(usize, &[u8])> {
    let mut length = 0;
    for (index, &byte) in bytes.iter().take(3).enumerate() {
        length |= usize::from(byte & 127) << (7 * index);
        if byte & 128 == 0 {
            return Some((length, &bytes[index + 1..]));
        }
    }
    None
}
