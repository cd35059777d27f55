//! The block of one diamond: its void mask, then its coefficients (`docs/format.md`).

use super::{Matrix, mask};
use crate::entropy::bits::{BitReader, BitWriter};
use crate::entropy::{self, gamma};
use crate::transform::Transform;

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

/// Codes the N^2 centres of a diamond in the knowledge of its vertices.
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

    /// Bytes for the samples (N^2, in units) of a diamond.
    ///
    /// `codable` is [`codable_centres`](super::codable_centres); `voids` holds 1 where a codable
    /// centre has no data. The empty block stands for residuals all zero, and voids exactly where
    /// [`all_void_by_default`] says.
    pub fn encode(
        &self,
        vertices: &Matrix,
        codable: Option<&[u8]>,
        samples: &[i32],
        voids: Option<&[u8]>,
    ) -> Vec<u8> {
        let coded = coded_centres(codable, voids);
        let mut coefficients = vec![0; self.cells * self.cells];
        let mask = coded.as_deref();
        self.transform
            .analyse(&vertices.values, samples, mask, &mut coefficients);
        let zero = coefficients.iter().all(|&coefficient| coefficient == 0);
        let all_void = coded.as_ref().is_some_and(|coded| !coded.contains(&1));
        let by_default = self.has_voids && all_void_by_default(vertices);
        let uniform = voids.is_none_or(|voids| !voids.contains(&1)) || all_void;
        if zero && uniform && (voids.is_some() && all_void) == by_default {
            return Vec::new();
        }
        let mut bytes = Vec::new();
        if self.has_voids {
            match voids {
                Some(voids) if voids.contains(&1) => {
                    let mask = mask::encode(self.cells, vertices.valid.as_deref(), codable, voids);
                    // A mask may be coded in no byte at all; 0 says that there is none.
                    write_length(mask.len() + 1, &mut bytes);
                    bytes.extend(mask);
                }
                _ => write_length(0, &mut bytes),
            }
        }
        let mut bits = BitWriter::new();
        gamma::encode(&coefficients, self.cells, mask, &mut bits);
        bytes.extend(bits.into_bytes());
        bytes
    }

    /// The centre matrix (N^2) of a block.
    ///
    /// # Errors
    ///
    /// [`BlockError`] when the bytes are not a block of this codec; bytes that are damaged in another way
    /// give other heights, never undefined ones.
    pub fn decode(
        &self,
        vertices: &Matrix,
        codable: Option<&[u8]>,
        block: &[u8],
    ) -> Result<Matrix, BlockError> {
        let mut centres = vec![0; self.cells * self.cells].into_boxed_slice();
        let mut coefficients = vec![0; self.cells * self.cells];
        let voids = if block.is_empty() {
            let all_void = self.has_voids && all_void_by_default(vertices);
            all_void.then(|| vec![1; coefficients.len()].into_boxed_slice())
        } else {
            let (voids, rest) = self.decode_mask(vertices, codable, block)?;
            let coded = coded_centres(codable, voids.as_deref());
            let mut bits = BitReader::new(rest);
            gamma::decode(&mut bits, self.cells, coded.as_deref(), &mut coefficients)?;
            let used = bits.position().div_ceil(8);
            let surplus = rest.get(used..).unwrap_or_default();
            if surplus.len() > self.padding || surplus.iter().any(|&byte| byte != 0) {
                return Err(BlockError::Surplus);
            }
            voids
        };
        self.transform
            .synthesise(&vertices.values, &coefficients, &mut centres);
        Ok(match coded_centres(codable, voids.as_deref()) {
            Some(valid) => Matrix::new(centres, valid),
            None => Matrix {
                values: centres,
                valid: None,
            },
        })
    }

    /// The void mask at the start of a block, and the rest of the block.
    fn decode_mask<'a>(
        &self,
        vertices: &Matrix,
        codable: Option<&[u8]>,
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
        let valid = vertices.valid.as_deref();
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

/// 1 where a centre has a residual: codable and not void; `None` when all have.
fn coded_centres(codable: Option<&[u8]>, voids: Option<&[u8]>) -> Option<Mask> {
    match (codable, voids) {
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
