//! The block of one diamond: its void mask, then its coefficients (`docs/format.md`).

use super::{Fit, LevelModel, Matrix, Model, Outline, Refined, SymbolCoder, Trace, Trainer, mask};
use crate::entropy::bits::{BitReader, BitWriter};
use crate::entropy::{self, gamma};
use crate::transform::adaptive::Weights;
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
    /// Bytes that a block's length is a multiple of.
    unit: usize,
    transform: Box<dyn Transform>,
    /// Codes coefficients in contexts; without it they are a quadtree of gamma codes.
    symbols: Option<SymbolCoder>,
    /// What blocks are decoded by.
    model: Option<Model>,
}

/// A block but for its entropy code.
#[derive(Clone, Debug)]
pub struct Draft {
    /// All is as the empty block says.
    is_default: bool,
    /// The void mask.
    head: Vec<u8>,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Bytes(Vec<u8>),
    Symbols(Trace),
}

impl Draft {
    /// The coefficients in contexts, if that is how they are coded and there are any.
    pub fn trace(&self) -> Option<&Trace> {
        match &self.content {
            Content::Symbols(trace) if !self.is_default => Some(trace),
            _ => None,
        }
    }
}

impl BlockCodec {
    /// A codec for diamonds of `cells` cells; `has_voids` says whether any sample of the whole raster
    /// is void, so that rasters without any spend nothing on masks. Coefficients are a quadtree of gamma
    /// codes.
    pub fn new(cells: usize, has_voids: bool, transform: Box<dyn Transform>) -> BlockCodec {
        BlockCodec {
            cells,
            has_voids,
            unit: usize::from(block_length_unit(cells)),
            transform,
            symbols: None,
            model: None,
        }
    }

    /// The same with coefficients coded in contexts.
    pub fn with_symbols(self, symbols: SymbolCoder) -> BlockCodec {
        BlockCodec {
            symbols: Some(symbols),
            ..self
        }
    }

    /// The same, able to decode what the model codes.
    pub fn with_model(self, model: Model) -> BlockCodec {
        BlockCodec {
            model: Some(model),
            ..self
        }
    }

    /// Decodes what another model codes from now on.
    pub fn set_model(&mut self, model: Model) {
        self.model = Some(model);
    }

    /// What makes coefficients of heights.
    pub fn transform(&self) -> &dyn Transform {
        &*self.transform
    }

    /// What blocks are decoded by.
    pub fn model(&self) -> Option<&Model> {
        self.model.as_ref()
    }

    /// How many matrices of coefficients a diamond has.
    pub fn matrices(&self) -> usize {
        self.transform.matrices()
    }

    /// What leads from a diamond's decoded vertices to its heights on the next level, in units, and the
    /// heights as they will be decoded.
    ///
    /// `voids` (N^2) holds 1 where a codable centre has no data. `weights` are those of each matrix; gamma
    /// codes have no use for them. The empty block stands for coefficients all zero, and voids exactly
    /// where [`all_void_by_default`] says.
    pub fn draft(
        &self,
        weights: &[Weights],
        vertices: &Matrix,
        outline: &Outline,
        target: Target,
        voids: Option<&[u8]>,
    ) -> (Draft, Refined) {
        let coded = coded_centres(outline, voids);
        let validity = validity(vertices, outline, &coded);
        let (content, refined, is_zero) = match &self.symbols {
            Some(symbols) if symbols.is_adaptive() => {
                let (trace, centres) =
                    symbols.trace_centres(&weights[0], &validity, &vertices.values, target.centres);
                let is_zero = trace.is_zero();
                let centres = centre_matrix(centres, coded.clone());
                let refined = Refined {
                    vertices: None,
                    centres,
                };
                (Content::Symbols(trace), refined, is_zero)
            }
            symbols => {
                let coefficients = self.transform.analyse(&validity, &vertices.values, target);
                let inner = self.transform.coded_vertices(&validity);
                let content = match symbols {
                    Some(symbols) => Content::Symbols(symbols.trace_coefficients(
                        weights,
                        &validity,
                        inner.as_deref(),
                        &vertices.values,
                        &coefficients,
                    )),
                    None => Content::Bytes(self.gamma(&validity, inner.as_deref(), &coefficients)),
                };
                let refined = self.refine(vertices, outline, coded.clone(), &coefficients);
                (content, refined, coefficients.are_zero())
            }
        };
        let all_void = coded.as_ref().is_some_and(|coded| !coded.contains(&1));
        let by_default = self.has_voids && all_void_by_default(vertices);
        let uniform = voids.is_none_or(|voids| !voids.contains(&1)) || all_void;
        let draft = Draft {
            is_default: is_zero && uniform && (voids.is_some() && all_void) == by_default,
            head: self.encode_mask(vertices, outline, voids),
            content,
        };
        (draft, refined)
    }

    /// The bytes of a draft; `model` is that of its level, and for coefficients in contexts only.
    ///
    /// # Panics
    /// If coefficients are in contexts and there is no model.
    pub fn finish(&self, draft: &Draft, model: Option<&LevelModel>) -> Vec<u8> {
        if draft.is_default {
            return Vec::new();
        }
        let mut bytes = draft.head.clone();
        match (&draft.content, model) {
            (Content::Bytes(content), _) => bytes.extend(content),
            (Content::Symbols(trace), Some(model)) => {
                bytes.extend(trace.to_bytes(model, self.unit, bytes.len()));
            }
            (Content::Symbols(_), None) => panic!("coefficients in contexts need a model"),
        }
        bytes
    }

    /// Shows the trainers of a diamond's matrices the coefficients that lead to `target`.
    pub fn show(
        &self,
        trainers: &[Trainer],
        fits: &mut [Fit],
        vertices: &Matrix,
        outline: &Outline,
        target: Target,
        voids: Option<&[u8]>,
    ) {
        let Some(symbols) = &self.symbols else { return };
        let coded = coded_centres(outline, voids);
        let validity = validity(vertices, outline, &coded);
        let own = &vertices.values;
        if symbols.is_adaptive() {
            symbols.show_centres(&trainers[0], &mut fits[0], &validity, own, target.centres);
            return;
        }
        let coefficients = self.transform.analyse(&validity, own, target);
        let inner = self.transform.coded_vertices(&validity);
        symbols.show_coefficients(
            trainers,
            fits,
            &validity,
            inner.as_deref(),
            own,
            &coefficients,
        );
    }

    fn encode_mask(&self, vertices: &Matrix, outline: &Outline, voids: Option<&[u8]>) -> Vec<u8> {
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
        bytes
    }

    fn gamma(
        &self,
        validity: &Validity,
        coded_vertices: Option<&[u8]>,
        coefficients: &Coefficients,
    ) -> Vec<u8> {
        let mut bits = BitWriter::new();
        gamma::encode(
            &coefficients.centres,
            self.cells,
            validity.centres,
            &mut bits,
        );
        if let Some(inner) = &coefficients.vertices {
            gamma::encode(inner, self.cells, coded_vertices, &mut bits);
        }
        bits.into_bytes()
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
        let validity = validity(vertices, outline, &coded);
        if let (Some(symbols), Some(model)) = (&self.symbols, &self.model)
            && symbols.is_adaptive()
        {
            let model = model.level(outline.level);
            let centres = symbols.decode_centres(model, &validity, &vertices.values, rest)?;
            return Ok(Refined {
                vertices: None,
                centres: centre_matrix(centres, coded),
            });
        }
        let coefficients =
            self.decode_coefficients(&validity, outline.level, &vertices.values, rest)?;
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
        let centres = centre_matrix(heights.centres, coded);
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
        level: u32,
        vertices: &[i32],
        bytes: Option<&[u8]>,
    ) -> Result<Coefficients, BlockError> {
        let zeros = || vec![0; self.cells * self.cells].into_boxed_slice();
        let coded_vertices = self.transform.coded_vertices(validity);
        if let (Some(symbols), Some(model)) = (&self.symbols, &self.model) {
            let (model, coded) = (model.level(level), coded_vertices.as_deref());
            return symbols.decode_coefficients(model, validity, coded, vertices, bytes);
        }
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
        if surplus.len() >= self.unit || surplus.iter().any(|&byte| byte != 0) {
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

fn centre_matrix(values: Box<[i32]>, coded: Option<Mask>) -> Matrix {
    match coded {
        Some(valid) => Matrix::new(values, valid),
        None => Matrix {
            values,
            valid: None,
        },
    }
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
