//! The coefficients of a block in contexts: what the trained predictor and the rANS coder make of a
//! diamond's matrices, row by row.

use super::BlockError;
use super::model::LevelModel;
use super::training::{Fit, Trainer};
use crate::entropy::rans;
use crate::transform::adaptive::{CONTEXTS, Outlook, Surroundings, Weights, Workspace};
use crate::transform::{Coefficients, Quantiser, Validity};
use std::cell::RefCell;

/// The context of an entry without a coefficient.
const UNCODED: u8 = u8::MAX;

/// The coefficients of a diamond with the context of each, matrix after matrix.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Trace {
    /// Context of each entry among those of all matrices; [`UNCODED`] where it has no coefficient.
    contexts: Vec<u8>,
    /// N^2 for each matrix.
    coefficients: Vec<i32>,
}

impl Trace {
    /// Whether all coefficients are 0.
    pub fn is_zero(&self) -> bool {
        self.coefficients
            .iter()
            .all(|&coefficient| coefficient == 0)
    }

    /// Coefficients with their contexts; those without any are passed over.
    pub fn coded(&self) -> impl Iterator<Item = (usize, i32)> + '_ {
        let entries = self.contexts.iter().zip(&self.coefficients);
        let coded = entries.filter(|(context, _)| **context != UNCODED);
        coded.map(|(&context, &coefficient)| (usize::from(context), coefficient))
    }

    /// The trace as bytes; with `before` bytes before them they are a multiple of `multiple`.
    pub(super) fn to_bytes(&self, model: &LevelModel, multiple: usize, before: usize) -> Vec<u8> {
        let tables = model.tables();
        let sure = tables.sure_context();
        let contexts: Vec<u8> = self
            .contexts
            .iter()
            .map(|&context| context.min(sure))
            .collect();
        let mut bytes = rans::encode(tables, &contexts, &self.coefficients, 0);
        let short = (before + bytes.len()).next_multiple_of(multiple) - before - bytes.len();
        if short > 0 {
            bytes = rans::encode(tables, &contexts, &self.coefficients, bytes.len() + short);
        }
        bytes
    }
}

/// What every block of a repository has in common.
#[derive(Clone)]
pub struct SymbolCoder {
    cells: usize,
    quantiser: Quantiser,
    adaptive: bool,
    vectors: bool,
}

impl SymbolCoder {
    /// For diamonds of `cells` cells. With `adaptive` the trained predictor comes before the quantiser, else
    /// coefficients of the transform are coded. `vectors` allows what the processor has, to the same result.
    pub fn new(cells: usize, quantiser: Quantiser, adaptive: bool, vectors: bool) -> SymbolCoder {
        SymbolCoder {
            cells,
            quantiser,
            adaptive,
            vectors,
        }
    }

    /// Whether centres are predicted here.
    pub fn is_adaptive(&self) -> bool {
        self.adaptive
    }

    /// The centres that a block leads to by trained prediction; `None` stands for coefficients all zero.
    pub(super) fn decode_centres(
        &self,
        model: &LevelModel,
        validity: &Validity,
        vertices: &[i32],
        bytes: Option<&[u8]>,
    ) -> Result<Box<[i32]>, BlockError> {
        let (cells, mut scratch) = (self.cells, Vec::new());
        let mut decoder = bytes.map(|bytes| self.decoder(model, bytes, &mut scratch));
        let mut centres = vec![0; cells * cells].into_boxed_slice();
        let weights = model.weights(0);
        self.walk_centres(vertices, weights, &mut centres, |row, outlook, centres| {
            if let Some(decoder) = &mut decoder {
                hide(&mut outlook.contexts, validity.centres, row, model);
                decoder.decode(&outlook.contexts, centres);
            }
            self.quantiser
                .reconstruct_row(&outlook.predictions, centres);
        });
        if let Some(decoder) = decoder {
            decoder.finish()?;
        }
        Ok(centres)
    }

    /// Trained prediction of the centres of `target`, and what they come back as.
    pub(super) fn trace_centres(
        &self,
        weights: &Weights,
        validity: &Validity,
        vertices: &[i32],
        target: &[i32],
    ) -> (Trace, Box<[i32]>) {
        let cells = self.cells;
        let [low, high] = self.quantiser.range();
        let mut trace = Trace::default();
        let mut centres = vec![0; cells * cells].into_boxed_slice();
        self.walk_centres(vertices, weights, &mut centres, |row, outlook, centres| {
            let start = row * cells;
            for (i, centre) in centres.iter_mut().enumerate() {
                let prediction = outlook.predictions[i].clamp(low, high);
                let is_coded = validity.centres.is_none_or(|coded| coded[start + i] != 0);
                let (context, coefficient) = if is_coded {
                    let sample = target[start + i];
                    (
                        outlook.contexts[i],
                        self.quantiser.quantise(sample, prediction),
                    )
                } else {
                    (UNCODED, 0)
                };
                trace.contexts.push(context);
                trace.coefficients.push(coefficient);
                *centre = coefficient;
            }
            self.quantiser
                .reconstruct_row(&outlook.predictions, centres);
        });
        (trace, centres)
    }

    /// Shows a trainer the centres of `target`.
    pub(super) fn show_centres(
        &self,
        trainer: &Trainer,
        fit: &mut Fit,
        validity: &Validity,
        vertices: &[i32],
        target: &[i32],
    ) {
        let (cells, [low, high]) = (self.cells, self.quantiser.range());
        let mut row = vec![0; cells];
        self.surround(vertices, |surroundings, outlook| {
            let step = surroundings.quarters(self.quantiser.step()) - surroundings.quarters(0);
            for (j, target) in target.chunks_exact(cells).enumerate() {
                surroundings.foresee(trainer.weights(), outlook);
                for (i, centre) in row.iter_mut().enumerate() {
                    let prediction = outlook.predictions[i].clamp(low, high);
                    *centre = prediction;
                    if validity
                        .centres
                        .is_none_or(|coded| coded[j * cells + i] != 0)
                    {
                        let coefficient = self.quantiser.quantise(target[i], prediction);
                        *centre = self.quantiser.reconstruct(coefficient, prediction);
                        let (sight, activity) = surroundings.sight(i, trainer.weights());
                        let place = surroundings.quarters(target[i]);
                        let predicted = surroundings.quarters(outlook.predictions[i]);
                        let misses = [place - f64::from(sight.order_two), place - predicted];
                        trainer.see(fit, &sight, activity, misses, step);
                    }
                }
                surroundings.complete(&row);
            }
        });
    }

    /// The coefficients of a block, all zero for `None`; those of the vertices where `coded_vertices` is.
    pub(super) fn decode_coefficients(
        &self,
        model: &LevelModel,
        validity: &Validity,
        coded_vertices: Option<&[u8]>,
        vertices: &[i32],
        bytes: Option<&[u8]>,
    ) -> Result<Coefficients, BlockError> {
        let zeros = || vec![0; self.cells * self.cells].into_boxed_slice();
        let (mut centres, mut inner) = (zeros(), coded_vertices.map(|_| zeros()));
        if let Some(bytes) = bytes {
            let mut scratch = Vec::new();
            let mut decoder = self.decoder(model, bytes, &mut scratch);
            let mut decode =
                |matrix: usize, coded: Option<&[u8]>, companion, entries: &mut [i32]| {
                    let weights = model.weights(matrix);
                    self.walk_coefficients(
                        vertices,
                        weights,
                        companion,
                        entries,
                        |row, contexts, entries| {
                            for context in contexts.iter_mut() {
                                *context += (matrix * CONTEXTS) as u8;
                            }
                            hide(contexts, coded, row, model);
                            decoder.decode(contexts, entries);
                        },
                    );
                };
            decode(0, validity.centres, None, &mut centres);
            if let Some(inner) = &mut inner {
                decode(1, coded_vertices, Some(&centres[..]), inner);
            }
            decoder.finish()?;
        }
        Ok(Coefficients {
            centres,
            vertices: inner,
        })
    }

    /// The contexts of coefficients. `weights` has those of each matrix.
    pub(super) fn trace_coefficients(
        &self,
        weights: &[Weights],
        validity: &Validity,
        coded_vertices: Option<&[u8]>,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Trace {
        let mut trace = Trace::default();
        for (matrix, coded, companion, entries) in matrices(coefficients, validity, coded_vertices)
        {
            let mut own = entries.to_vec();
            let visit = |row: usize, contexts: &mut [u8], _: &mut [i32]| {
                for (i, context) in contexts.iter_mut().enumerate() {
                    *context += (matrix * CONTEXTS) as u8;
                    if coded.is_some_and(|coded| coded[row * self.cells + i] == 0) {
                        *context = UNCODED;
                    }
                }
                trace.contexts.extend_from_slice(contexts);
            };
            self.walk_coefficients(vertices, &weights[matrix], companion, &mut own, visit);
            trace.coefficients.extend(own);
        }
        trace
    }

    /// Shows the trainer of each matrix its coefficients.
    pub(super) fn show_coefficients(
        &self,
        trainers: &[Trainer],
        fits: &mut [Fit],
        validity: &Validity,
        coded_vertices: Option<&[u8]>,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) {
        let cells = self.cells;
        for (matrix, coded, companion, entries) in matrices(coefficients, validity, coded_vertices)
        {
            let (trainer, fit) = (&trainers[matrix], &mut fits[matrix]);
            let own_step = self.quantiser.step();
            self.surround(vertices, |surroundings, _| {
                let step = surroundings.quarters(own_step) - surroundings.quarters(0);
                for (j, row) in entries.chunks_exact(cells).enumerate() {
                    if let Some(companion) = companion {
                        let row = &companion[j * cells..(j + 1) * cells];
                        surroundings.accompany(row, own_step);
                    }
                    for (i, &coefficient) in row.iter().enumerate() {
                        if coded.is_none_or(|coded| coded[j * cells + i] != 0) {
                            let (sight, activity) = surroundings.sight(i, trainer.weights());
                            let miss = f64::from(coefficient) * step;
                            trainer.see(fit, &sight, activity, [miss, miss], step);
                        }
                    }
                    surroundings.complete_coefficients(row, own_step);
                }
            });
        }
    }

    fn decoder<'a>(
        &self,
        model: &'a LevelModel,
        bytes: &[u8],
        scratch: &'a mut Vec<u8>,
    ) -> rans::Decoder<'a> {
        rans::Decoder::new(model.tables(), bytes, scratch, self.vectors)
    }

    /// Goes over the rows of centres that are predicted here. `visit` gets each row's number and outlook, and
    /// makes its heights.
    fn walk_centres(
        &self,
        vertices: &[i32],
        weights: &Weights,
        centres: &mut [i32],
        mut visit: impl FnMut(usize, &mut Outlook, &mut [i32]),
    ) {
        self.surround(vertices, |surroundings, outlook| {
            for (index, row) in centres.chunks_exact_mut(self.cells).enumerate() {
                surroundings.foresee(weights, outlook);
                visit(index, outlook, row);
                surroundings.complete(row);
            }
        });
    }

    /// Goes over the rows of a matrix of coefficients. `visit` gets each row's number and contexts, and may
    /// make its coefficients.
    fn walk_coefficients(
        &self,
        vertices: &[i32],
        weights: &Weights,
        companion: Option<&[i32]>,
        coefficients: &mut [i32],
        mut visit: impl FnMut(usize, &mut [u8], &mut [i32]),
    ) {
        let (cells, step) = (self.cells, self.quantiser.step());
        self.surround(vertices, |surroundings, outlook| {
            for (index, row) in coefficients.chunks_exact_mut(cells).enumerate() {
                if let Some(companion) = companion {
                    surroundings.accompany(&companion[index * cells..(index + 1) * cells], step);
                }
                surroundings.foresee_contexts(weights, outlook);
                visit(index, &mut outlook.contexts, row);
                surroundings.complete_coefficients(row, step);
            }
        });
    }

    /// Lets `work` go through the surroundings of a diamond, with an outlook of its width.
    fn surround<R>(
        &self,
        vertices: &[i32],
        work: impl FnOnce(&mut dyn Surroundings, &mut Outlook) -> R,
    ) -> R {
        thread_local! {
            /// Kept from diamond to diamond, since making room takes as long as a part of decoding.
            static ROOM: RefCell<(Workspace, Outlook)> = RefCell::default();
        }
        ROOM.with_borrow_mut(|(workspace, outlook)| {
            outlook.fit(self.cells);
            work(workspace.start(self.cells, vertices, self.vectors), outlook)
        })
    }
}

/// A matrix of coefficients: its number, which entries are coded, the matrix whose sizes tell of its own, and
/// its entries.
type MatrixOf<'a> = (usize, Option<&'a [u8]>, Option<&'a [i32]>, &'a [i32]);

/// The matrices of a diamond's coefficients.
fn matrices<'a>(
    coefficients: &'a Coefficients,
    validity: &Validity<'a>,
    coded_vertices: Option<&'a [u8]>,
) -> impl Iterator<Item = MatrixOf<'a>> {
    let centres = &coefficients.centres[..];
    let inner = coefficients.vertices.as_deref();
    let first = (0, validity.centres, None, centres);
    let second = inner.map(|inner| (1, coded_vertices, Some(centres), inner));
    std::iter::once(first).chain(second)
}

/// Gives the entries of a row that are not coded the context in which nothing is.
fn hide(contexts: &mut [u8], coded: Option<&[u8]>, row: usize, model: &LevelModel) {
    if let Some(coded) = coded {
        let coded = &coded[row * contexts.len()..];
        for (context, &coded) in contexts.iter_mut().zip(coded) {
            if coded == 0 {
                *context = model.tables().sure_context();
            }
        }
    }
}
