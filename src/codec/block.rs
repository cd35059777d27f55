//! The block of one diamond: its void mask, then its coefficients (`docs/format.md`).

use super::draft::{Content, Draft};
use super::symbols::{Known, Task};
use super::{Fit, LevelModel, Matrix, Model, Outline, Refined, SymbolCoder, Trace, Trainer, mask};
use crate::entropy::bits::{BitReader, BitWriter};
use crate::entropy::{self, gamma};
use crate::transform::adaptive::Weights;
use crate::transform::{Coefficients, Synthesis, Target, Transform, Validity};

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
    /// One for each component.
    transforms: Vec<Box<dyn Transform>>,
    /// Code each component's coefficients in contexts; without them they are quadtrees of gamma codes.
    symbols: Option<Vec<SymbolCoder>>,
    /// What blocks are decoded by.
    model: Option<Model>,
}

impl BlockCodec {
    /// A codec for diamonds of `cells` cells, with the transform of each component; `has_voids` says whether
    /// any sample of the whole raster is void, so that rasters without any spend nothing on masks. Coefficients
    /// are quadtrees of gamma codes.
    pub fn new(cells: usize, has_voids: bool, transforms: Vec<Box<dyn Transform>>) -> BlockCodec {
        BlockCodec {
            cells,
            has_voids,
            unit: usize::from(block_length_unit(cells)),
            transforms,
            symbols: None,
            model: None,
        }
    }

    /// The same with coefficients coded in contexts, by one coder for each component.
    pub fn with_symbols(self, symbols: Vec<SymbolCoder>) -> BlockCodec {
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

    /// What blocks are decoded by.
    pub fn model(&self) -> Option<&Model> {
        self.model.as_ref()
    }

    /// How many matrices of coefficients a diamond has, of all components.
    pub fn matrices(&self) -> usize {
        self.transforms.iter().map(|own| own.matrices()).sum()
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
        let (content, is_zero, synthesis) = match &self.symbols {
            Some(symbols) => {
                let (trace, synthesis) = self.trace(symbols, weights, &validity, vertices, target);
                let is_zero = trace.is_zero();
                (Content::Symbols(trace), is_zero, synthesis)
            }
            None => {
                let coefficients = self.analyse(&validity, vertices, target);
                let bytes = self.gamma(&validity, &coefficients);
                let synthesis = self.synthesise(&validity, vertices, &coefficients);
                let is_zero = coefficients.iter().all(Coefficients::are_zero);
                (Content::Bytes(bytes), is_zero, synthesis)
            }
        };
        let refined = gather(synthesis, vertices, coded.clone());
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

    /// The coefficients that lead to `target` in contexts, and what they come back as.
    fn trace(
        &self,
        symbols: &[SymbolCoder],
        weights: &[Weights],
        validity: &Validity,
        vertices: &Matrix,
        target: Target,
    ) -> (Trace, Vec<Synthesis>) {
        let (mut trace, mut known) = (Trace::default(), Before::default());
        let mut all = Vec::with_capacity(self.transforms.len());
        for (component, part) in self.parts(vertices, target).enumerate() {
            let (transform, coder) = (&self.transforms[component], &symbols[component]);
            let step = coder.step();
            if coder.is_adaptive() && !transform.is_filtering() {
                let task = known.task(0, component, validity.centres, part.own);
                let weights = &weights[task.matrix];
                let (centres, kept) =
                    coder.trace_centres(weights, &task, part.target.centres, &mut trace);
                known.add(0, kept, step);
                all.push(Synthesis {
                    vertices: None,
                    centres,
                });
                continue;
            }
            let coefficients = transform.analyse(validity, part.own, part.target);
            for_each_matrix(
                &**transform,
                validity,
                &coefficients,
                |kind, coded, entries| {
                    let task = known.task(kind, component, coded, part.own);
                    let kept =
                        coder.trace_coefficients(&weights[task.matrix], &task, entries, &mut trace);
                    known.add(kind, kept, step);
                },
            );
            all.push(transform.synthesise(validity, part.own, &coefficients));
        }
        (trace, all)
    }

    /// A diamond's components one by one.
    fn parts<'a>(
        &self,
        vertices: &'a Matrix,
        target: Target<'a>,
    ) -> impl Iterator<Item = Part<'a>> {
        let own = self.components(vertices);
        let side = self.cells + 1;
        let next = target.vertices.chunks_exact(side * side);
        let centres = target.centres.chunks_exact(self.cells * self.cells);
        own.zip(next.zip(centres))
            .map(|(own, (vertices, centres))| Part {
                own,
                target: Target { vertices, centres },
            })
    }

    /// The vertices of each component.
    fn components<'a>(&self, vertices: &'a Matrix) -> std::slice::ChunksExact<'a, i32> {
        let side = self.cells + 1;
        vertices.values.chunks_exact(side * side)
    }

    fn analyse(&self, validity: &Validity, vertices: &Matrix, target: Target) -> Vec<Coefficients> {
        let parts = self.parts(vertices, target).zip(&self.transforms);
        parts
            .map(|(part, transform)| transform.analyse(validity, part.own, part.target))
            .collect()
    }

    fn synthesise(
        &self,
        validity: &Validity,
        vertices: &Matrix,
        coefficients: &[Coefficients],
    ) -> Vec<Synthesis> {
        let own = self.components(vertices).zip(&self.transforms);
        own.zip(coefficients)
            .map(|((own, transform), coefficients)| {
                transform.synthesise(validity, own, coefficients)
            })
            .collect()
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
        let mut known = Before::default();
        for (component, part) in self.parts(vertices, target).enumerate() {
            let (transform, coder) = (&self.transforms[component], &symbols[component]);
            let step = coder.step();
            if coder.is_adaptive() && !transform.is_filtering() {
                let task = known.task(0, component, validity.centres, part.own);
                let (trainer, fit) = (&trainers[task.matrix], &mut fits[task.matrix]);
                let shown = coder.show_centres(trainer, fit, &task, part.target.centres);
                known.add(0, shown, step);
                continue;
            }
            let coefficients = transform.analyse(&validity, part.own, part.target);
            for_each_matrix(
                &**transform,
                &validity,
                &coefficients,
                |kind, coded, entries| {
                    let task = known.task(kind, component, coded, part.own);
                    let (trainer, fit) = (&trainers[task.matrix], &mut fits[task.matrix]);
                    let shown = coder.show_coefficients(trainer, fit, &task, entries);
                    known.add(kind, shown, step);
                },
            );
        }
    }

    fn encode_mask(&self, vertices: &Matrix, outline: &Outline, voids: Option<&[u8]>) -> Vec<u8> {
        let mut bytes = Vec::new();
        if self.has_voids {
            match voids {
                Some(voids) if voids.contains(&1) => {
                    let (valid, codable) = (vertices.valid.as_deref(), outline.codable.as_deref());
                    let mask = mask::encode(self.cells, valid, codable, voids);
                    // A mask may be coded in no byte at all; 0 says that there is none.
                    mask::write_length(mask.len() + 1, &mut bytes);
                    bytes.extend(mask);
                }
                _ => mask::write_length(0, &mut bytes),
            }
        }
        bytes
    }

    fn gamma(&self, validity: &Validity, coefficients: &[Coefficients]) -> Vec<u8> {
        let mut bits = BitWriter::new();
        for (transform, coefficients) in self.transforms.iter().zip(coefficients) {
            for_each_matrix(&**transform, validity, coefficients, |_, coded, entries| {
                gamma::encode(entries, self.cells, coded, &mut bits);
            });
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
        let synthesis = match (&self.symbols, &self.model) {
            (Some(symbols), Some(model)) => {
                let model = model.level(outline.level);
                self.decode_symbols(symbols, model, &validity, vertices, rest)?
            }
            _ => {
                let coefficients = self.decode_gamma(&validity, rest)?;
                self.synthesise(&validity, vertices, &coefficients)
            }
        };
        Ok(gather(synthesis, vertices, coded))
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
        let coefficients = self.analyse(&validity, vertices, target);
        let synthesis = self.synthesise(&validity, vertices, &coefficients);
        gather(synthesis, vertices, coded)
    }

    /// What coefficients in contexts lead to; those of `None` are all zero.
    fn decode_symbols(
        &self,
        symbols: &[SymbolCoder],
        model: &LevelModel,
        validity: &Validity,
        vertices: &Matrix,
        bytes: Option<&[u8]>,
    ) -> Result<Vec<Synthesis>, BlockError> {
        let (mut scratch, mut known) = (Vec::new(), Before::default());
        let mut decoder = match (symbols.first(), bytes) {
            (Some(coder), Some(bytes)) => Some(coder.decoder(model, bytes, &mut scratch)),
            _ => None,
        };
        let mut all = Vec::with_capacity(symbols.len());
        let parts = symbols.iter().zip(&self.transforms);
        for (component, (own, (coder, transform))) in
            self.components(vertices).zip(parts).enumerate()
        {
            let is_last = component + 1 == symbols.len();
            if coder.is_adaptive() && !transform.is_filtering() {
                let task = known.task(0, component, validity.centres, own);
                let mut kept = (!is_last).then(Vec::new);
                let centres = coder.decode_centres(model, &task, decoder.as_mut(), kept.as_mut());
                known.add(0, kept.unwrap_or_default(), coder.step());
                all.push(Synthesis {
                    vertices: None,
                    centres,
                });
                continue;
            }
            let mut decode = |kind: usize, coded: Option<&[u8]>| {
                let task = known.task(kind, component, coded, own);
                let (entries, kept) = coder.decode_coefficients(model, &task, decoder.as_mut());
                known.add(kind, kept, coder.step());
                entries
            };
            let centres = decode(0, validity.centres);
            let inner = transform.coded_vertices(validity);
            let inner = inner.map(|coded| decode(1, Some(&coded)));
            let coefficients = Coefficients {
                centres,
                vertices: inner,
            };
            all.push(transform.synthesise(validity, own, &coefficients));
        }
        if let Some(decoder) = decoder {
            decoder.finish()?;
        }
        Ok(all)
    }

    /// The coefficients of each component in gamma codes; all zero for the empty block.
    fn decode_gamma(
        &self,
        validity: &Validity,
        bytes: Option<&[u8]>,
    ) -> Result<Vec<Coefficients>, BlockError> {
        let zeros = || vec![0; self.cells * self.cells].into_boxed_slice();
        let mut bits = BitReader::new(bytes.unwrap_or_default());
        let mut all = Vec::with_capacity(self.transforms.len());
        for transform in &self.transforms {
            let coded_vertices = transform.coded_vertices(validity);
            let mut coefficients = Coefficients {
                centres: zeros(),
                vertices: coded_vertices.is_some().then(zeros),
            };
            if bytes.is_some() {
                let side = self.cells;
                gamma::decode(&mut bits, side, validity.centres, &mut coefficients.centres)?;
                if let Some(inner) = &mut coefficients.vertices {
                    gamma::decode(&mut bits, side, coded_vertices.as_deref(), inner)?;
                }
            }
            all.push(coefficients);
        }
        let used = bits.position().div_ceil(8);
        let surplus = bytes
            .and_then(|bytes| bytes.get(used..))
            .unwrap_or_default();
        if surplus.len() >= self.unit || surplus.iter().any(|&byte| byte != 0) {
            return Err(BlockError::Surplus);
        }
        Ok(all)
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
        let (length, rest) = mask::read_length(block).ok_or(BlockError::Mask)?;
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

/// One component of a diamond: its vertices, and what the next level should be.
struct Part<'a> {
    own: &'a [i32],
    target: Target<'a>,
}

/// The matrices of the components that are known already, by kind: of centres, and of vertices.
#[derive(Default)]
struct Before([Vec<Known>; 2]);

impl Before {
    /// A matrix of this kind of the next component.
    fn task<'a>(
        &'a self,
        kind: usize,
        component: usize,
        coded: Option<&'a [u8]>,
        vertices: &'a [i32],
    ) -> Task<'a> {
        // Matrices of one kind are as many in every component.
        let kinds = 1 + usize::from(kind == 1 || !self.0[1].is_empty());
        Task {
            matrix: component * kinds + kind,
            coded,
            vertices,
            companions: &self.0[kind],
            beside: self.0[0].last().filter(|_| kind == 1),
        }
    }

    fn add(&mut self, kind: usize, residuals: Vec<i32>, step: i32) {
        self.0[kind].push(Known { residuals, step });
    }
}

/// Calls `visit` with the kind of each of a component's matrices, which entries are coded, and the entries.
fn for_each_matrix(
    transform: &dyn Transform,
    validity: &Validity,
    coefficients: &Coefficients,
    mut visit: impl FnMut(usize, Option<&[u8]>, &[i32]),
) {
    visit(0, validity.centres, &coefficients.centres);
    if let Some(inner) = &coefficients.vertices {
        visit(1, transform.coded_vertices(validity).as_deref(), inner);
    }
}

/// All components on the next level, in one.
fn gather(components: Vec<Synthesis>, vertices: &Matrix, coded: Option<Mask>) -> Refined {
    let filtered = components.iter().any(|own| own.vertices.is_some());
    let mut centres: Vec<Box<[i32]>> = Vec::with_capacity(components.len());
    let mut next: Vec<Box<[i32]>> = Vec::new();
    for own in components {
        centres.push(own.centres);
        next.extend(own.vertices);
    }
    let centres = joined(centres);
    Refined {
        vertices: filtered.then(|| Matrix {
            values: joined(next),
            valid: vertices.valid.clone(),
        }),
        centres: match coded {
            Some(valid) => Matrix::new(centres, valid),
            None => Matrix {
                values: centres,
                valid: None,
            },
        },
    }
}

fn joined(mut parts: Vec<Box<[i32]>>) -> Box<[i32]> {
    match parts.len() {
        1 => parts.remove(0),
        _ => parts.concat().into(),
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
