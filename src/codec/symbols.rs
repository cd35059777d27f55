//! The coefficients of a block in contexts: what the trained predictor and the rANS coder make of a
//! diamond's matrices, row by row.

use super::model::LevelModel;
use super::training::{Fit, Trainer};
use crate::entropy::rans::{self, Decoder};
use crate::transform::Quantiser;
use crate::transform::adaptive::{
    COMPANIONS, CONTEXTS, Outlook, Surroundings, WEIGHT_BITS, Weights, surroundings,
};

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

    /// The coefficients of the matrix added last, of a diamond of `cells` cells.
    pub(super) fn last(&self, cells: usize) -> Vec<i32> {
        let start = self.coefficients.len() - cells * cells;
        self.coefficients[start..].to_vec()
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

/// A matrix of a diamond that is coded, and what is known before it.
#[derive(Clone, Copy)]
pub(super) struct Task<'a> {
    /// Its number among those of all components.
    pub matrix: usize,
    /// N^2: 1 where it has a coefficient; `None` when it has all.
    pub coded: Option<&'a [u8]>,
    /// (N+1)^2: the component's vertices.
    pub vertices: &'a [i32],
    /// The matrices of the components before, of the same kind: they tell of its coefficients.
    pub companions: &'a [Known],
    /// The component's own matrix before: its sizes tell of those here.
    pub beside: Option<&'a Known>,
}

/// Coefficients that are known.
pub(super) struct Known {
    /// N^2, as they were coded.
    pub coefficients: Vec<i32>,
    /// Units that one is worth.
    pub step: i32,
}

/// What every block of a repository has in common, for one of the components.
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

    /// What a coefficient is worth in units.
    pub(super) fn step(&self) -> i32 {
        self.quantiser.step()
    }

    /// A decoder of all matrices of a block, one after the other.
    pub(super) fn decoder<'a>(
        &self,
        model: &'a LevelModel,
        bytes: &[u8],
        scratch: &'a mut Vec<u8>,
    ) -> Decoder<'a> {
        Decoder::new(model.tables(), bytes, scratch, self.vectors)
    }

    /// The centres that a block leads to by trained prediction; `None` stands for coefficients all zero.
    /// `kept`, if it is given, gets the coefficients.
    pub(super) fn decode_centres(
        &self,
        model: &LevelModel,
        task: &Task,
        mut decoder: Option<&mut Decoder>,
        mut kept: Option<&mut Vec<i32>>,
    ) -> Box<[i32]> {
        let mut centres = vec![0; self.cells * self.cells].into_boxed_slice();
        let weights = model.weights(task.matrix);
        self.walk_centres(task, weights, &mut centres, |row, outlook, centres| {
            if let Some(decoder) = &mut decoder {
                own_contexts(&mut outlook.contexts, task, row, Some(model));
                decoder.decode(&outlook.contexts, centres);
                for (c, &f) in centres.iter_mut().zip(&outlook.fractions) { if f < 0 { *c = c.wrapping_neg(); } }
            }
            if let Some(kept) = &mut kept {
                kept.extend_from_slice(centres);
            }
            self.quantiser
                .reconstruct_row(&outlook.predictions, centres);
        });
        centres
    }

    /// Adds what trained prediction leaves of the centres of `target`, and gives what they come back as.
    pub(super) fn trace_centres(
        &self,
        weights: &Weights,
        task: &Task,
        target: &[i32],
        trace: &mut Trace,
    ) -> (Box<[i32]>, Vec<i32>) {
        let cells = self.cells;
        let mut kept = Vec::new();
        let [low, high] = self.quantiser.range();
        let mut centres = vec![0; cells * cells].into_boxed_slice();
        self.walk_centres(task, weights, &mut centres, |row, outlook, centres| {
            own_contexts(&mut outlook.contexts, task, row, None);
            let target = &target[row * cells..(row + 1) * cells];
            for (i, centre) in centres.iter_mut().enumerate() {
                if outlook.contexts[i] != UNCODED {
                    let prediction = outlook.predictions[i].clamp(low, high);
                    *centre = self.quantiser.quantise(target[i], prediction);
                }
            }
            trace.contexts.extend_from_slice(&outlook.contexts);
            kept.extend_from_slice(centres);
            trace.coefficients.extend(centres.iter().zip(&outlook.fractions).map(|(c, &f)| if f < 0 { c.wrapping_neg() } else { *c }));
            self.quantiser
                .reconstruct_row(&outlook.predictions, centres);
        });
        (centres, kept)
    }

    /// Shows a trainer the centres of `target`; gives their coefficients.
    pub(super) fn show_centres(
        &self,
        trainer: &Trainer,
        fit: &mut Fit,
        task: &Task,
        target: &[i32],
    ) -> Vec<i32> {
        let (cells, [low, high]) = (self.cells, self.quantiser.range());
        let mut surroundings = surroundings(cells, task.vertices, self.vectors);
        let step = surroundings.quarters(self.quantiser.step()) - surroundings.quarters(0);
        let mut outlook = Outlook::new(cells);
        let mut coefficients = vec![0; cells * cells];
        let mut row = vec![0; cells];
        for j in 0..cells {
            let company = self.accompany(&mut *surroundings, task, j);
            surroundings.foresee(trainer.weights(), &mut outlook);
            company.add_to(trainer.weights(), &mut outlook);
            for (i, centre) in row.iter_mut().enumerate() {
                let prediction = outlook.predictions[i].clamp(low, high);
                *centre = prediction;
                let index = j * cells + i;
                if task.coded.is_none_or(|coded| coded[index] != 0) {
                    let coefficient = self.quantiser.quantise(target[index], prediction);
                    coefficients[index] = coefficient;
                    *centre = self.quantiser.reconstruct(coefficient, prediction);
                    let (sight, activity) = surroundings.sight(i, trainer.weights());
                    let place = surroundings.quarters(target[index]);
                    let predicted = surroundings.quarters(outlook.predictions[i]);
                    let misses = [place - f64::from(sight.order_two), place - predicted];
                    let told = company.told(i, &*surroundings);
                    trainer.see(fit, &sight, activity, misses, told, step);
                }
            }
            surroundings.complete(&row, &outlook);
        }
        coefficients
    }

    /// The coefficients of a matrix of a block, all zero for `None`, and as they were coded.
    pub(super) fn decode_coefficients(
        &self,
        model: &LevelModel,
        task: &Task,
        decoder: Option<&mut Decoder>,
    ) -> (Box<[i32]>, Vec<i32>) {
        let mut coded = vec![0; self.cells * self.cells];
        let Some(decoder) = decoder else {
            return (coded.clone().into(), coded);
        };
        let mut entries = vec![0; self.cells * self.cells].into_boxed_slice();
        let weights = model.weights(task.matrix);
        self.walk_coefficients(task, weights, &mut entries, |row, outlook, entries| {
            own_contexts(&mut outlook.contexts, task, row, Some(model));
            let coded = &mut coded[row * self.cells..(row + 1) * self.cells];
            decoder.decode(&outlook.contexts, coded);
            for (i, (entry, coded)) in entries.iter_mut().zip(coded).enumerate() {
                let start = row * self.cells;
                if task.coded.is_none_or(|coded| coded[start + i] != 0) {
                    if outlook.fractions[i] < 0 { *coded = coded.wrapping_neg(); }
                    *entry = coded.wrapping_add(outlook.predictions[i]);
                }
            }
        });
        (entries, coded)
    }

    /// Adds the coefficients of a matrix with their contexts.
    pub(super) fn trace_coefficients(
        &self,
        weights: &Weights,
        task: &Task,
        entries: &[i32],
        trace: &mut Trace,
    ) -> Vec<i32> {
        let mut kept: Vec<i32> = Vec::new();
        let mut own = entries.to_vec();
        self.walk_coefficients(task, weights, &mut own, |row, outlook, entries| {
            own_contexts(&mut outlook.contexts, task, row, None);
            let contexts = outlook.contexts.iter();
            let coded = contexts.zip(&outlook.predictions).zip(entries);
            let coded = coded.map(|((&context, &prediction), entry)| match context {
                UNCODED => 0,
                _ => entry.wrapping_sub(prediction),
            });
            let start = kept.len();
            kept.extend(coded);
            trace.coefficients.extend(kept[start..].iter().zip(&outlook.fractions).map(|(c, &f)| if f < 0 { c.wrapping_neg() } else { *c }));
            trace.contexts.extend_from_slice(&outlook.contexts);
        });
        kept
    }

    /// Shows the trainer of a matrix its coefficients; gives what is coded of them.
    pub(super) fn show_coefficients(
        &self,
        trainer: &Trainer,
        fit: &mut Fit,
        task: &Task,
        entries: &[i32],
    ) -> Vec<i32> {
        let cells = self.cells;
        let mut surroundings = surroundings(cells, task.vertices, self.vectors);
        let step = surroundings.quarters(self.quantiser.step()) - surroundings.quarters(0);
        let mut outlook = Outlook::new(cells);
        let mut coded = Vec::with_capacity(cells * cells);
        for (j, row) in entries.chunks_exact(cells).enumerate() {
            let company = self.accompany(&mut *surroundings, task, j);
            self.foresee_coefficients(
                &mut *surroundings,
                task,
                j,
                &company,
                trainer.weights(),
                &mut outlook,
            );
            for (i, &coefficient) in row.iter().enumerate() {
                if task.coded.is_none_or(|coded| coded[j * cells + i] != 0) {
                    let (sight, activity) = surroundings.sight(i, trainer.weights());
                    let left = coefficient.wrapping_sub(outlook.predictions[i]);
                    let told = company.told(i, &*surroundings);
                    let misses = [f64::from(coefficient) * step, f64::from(left) * step];
                    trainer.see(fit, &sight, activity, misses, told, step);
                    coded.push(left);
                } else {
                    coded.push(0);
                }
            }
            surroundings.complete_coefficients(row, self.step());
        }
        coded
    }

    /// Goes over the rows of centres that are predicted here. `visit` gets each row's number and outlook, and
    /// makes its heights.
    fn walk_centres(
        &self,
        task: &Task,
        weights: &Weights,
        centres: &mut [i32],
        mut visit: impl FnMut(usize, &mut Outlook, &mut [i32]),
    ) {
        let mut surroundings = surroundings(self.cells, task.vertices, self.vectors);
        let mut outlook = Outlook::new(self.cells);
        for (index, row) in centres.chunks_exact_mut(self.cells).enumerate() {
            let company = self.accompany(&mut *surroundings, task, index);
            surroundings.foresee(weights, &mut outlook);
            company.add_to(weights, &mut outlook);
            visit(index, &mut outlook, row);
            surroundings.complete(row, &outlook);
        }
    }

    /// Goes over the rows of a matrix of coefficients. `visit` gets each row's number, and its contexts and
    /// predicted coefficients, and may make its coefficients.
    fn walk_coefficients(
        &self,
        task: &Task,
        weights: &Weights,
        coefficients: &mut [i32],
        mut visit: impl FnMut(usize, &mut Outlook, &mut [i32]),
    ) {
        let mut surroundings = surroundings(self.cells, task.vertices, self.vectors);
        let mut outlook = Outlook::new(self.cells);
        for (index, row) in coefficients.chunks_exact_mut(self.cells).enumerate() {
            let company = self.accompany(&mut *surroundings, task, index);
            self.foresee_coefficients(
                &mut *surroundings,
                task,
                index,
                &company,
                weights,
                &mut outlook,
            );
            visit(index, &mut outlook, row);
            surroundings.complete_coefficients(row, self.step());
        }
    }

    fn foresee_coefficients(
        &self,
        surroundings: &mut dyn Surroundings,
        task: &Task,
        row: usize,
        company: &Company,
        weights: &Weights,
        outlook: &mut Outlook,
    ) {
        if self.adaptive {
            surroundings.foresee_details(weights, outlook);
        } else {
            surroundings.foresee_contexts(weights, outlook);
            outlook.predictions.fill(0);
        }
        company.predict(weights, self.step(), outlook);
    }

    /// Tells the surroundings of what is known at the places of a row.
    fn accompany<'a>(
        &self,
        surroundings: &mut dyn Surroundings,
        task: &Task<'a>,
        row: usize,
    ) -> Company<'a> {
        let start = row * self.cells;
        let own = |known: &'a Known| Row {
            coefficients: &known.coefficients[start..start + self.cells],
            step: known.step,
        };
        let company = Company(std::array::from_fn(|place| {
            task.companions.get(place).map(own)
        }));
        let beside = task.beside.map(own);
        let known = || company.0.iter().flatten().chain(&beside);
        if known().count() > 1 {
            let mut sizes = vec![0i32; self.cells];
            for row in known() {
                for (size, &coefficient) in sizes.iter_mut().zip(row.coefficients) {
                    let own = coefficient.unsigned_abs().saturating_mul(row.step as u32);
                    *size = size.saturating_add_unsigned(own);
                }
            }
            surroundings.accompany(&sizes, 1);
        } else if let Some(row) = known().next() {
            surroundings.accompany(row.coefficients, row.step);
        }
        company
    }
}

/// A row of a matrix that is known.
#[derive(Clone, Copy)]
struct Row<'a> {
    coefficients: &'a [i32],
    step: i32,
}

impl Row<'_> {
    fn units(&self, i: usize) -> i64 {
        i64::from(self.coefficients[i]) * i64::from(self.step)
    }
}

/// The same row of the components before.
struct Company<'a>([Option<Row<'a>>; COMPANIONS]);

impl Company<'_> {
    /// What the components before tell of an entry of this context, in units, times 2^10.
    #[inline(always)]
    fn scaled(&self, i: usize, weights: &Weights, context: usize) -> i64 {
        let class = Weights::class(context);
        let rows = self.0.iter().zip(&weights.companions);
        rows.fold(0, |sum, (row, weights)| {
            let units = row.map_or(0, |row| row.units(i));
            sum + units.clamp(-1 << 40, 1 << 40) * i64::from(weights[class])
        })
    }

    /// Adds it to the predictions of centres.
    fn add_to(&self, weights: &Weights, outlook: &mut Outlook) {
        if self.0[0].is_none() {
            return;
        }
        let contexts = outlook.contexts.iter().enumerate();
        for ((i, &context), prediction) in contexts.zip(&mut outlook.predictions) {
            let scaled = self.scaled(i, weights, usize::from(context)) + i64::from(outlook.fractions[i]);
            let offset = (scaled + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS;
            outlook.fractions[i] = (scaled - (offset << WEIGHT_BITS)) as i32;
            let sum = i64::from(*prediction) + offset;
            *prediction = sum.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
        }
    }

    /// The prediction of a coefficient that is worth `step` units.
    fn coefficient(&self, i: usize, weights: &Weights, context: usize, own: i32, step: i32) -> i32 {
        let unit = i64::from(step) << WEIGHT_BITS;
        let scaled = self.scaled(i, weights, context) + i64::from(own);
        (scaled + unit / 2).div_euclid(unit) as i32
    }

    /// The predictions of coefficients from those of details in units.
    fn predict(&self, weights: &Weights, step: i32, outlook: &mut Outlook) {
        for (i, prediction) in outlook.predictions.iter_mut().enumerate() {
            let context = usize::from(outlook.contexts[i]);
            let own = *prediction;
            *prediction = self.coefficient(i, weights, context, own, step);
            let scaled = self.scaled(i, weights, context) + i64::from(own);
            outlook.fractions[i] = if scaled < i64::from(*prediction) * (i64::from(step) << WEIGHT_BITS) { -1 } else { 0 };
        }
    }

    /// The entries of the components before, in quarters of a shifted unit.
    fn told(&self, i: usize, surroundings: &dyn Surroundings) -> [f64; COMPANIONS] {
        let zero = surroundings.quarters(0);
        let unit = surroundings.quarters(1) - zero;
        self.0
            .map(|row| row.map_or(0.0, |row| row.units(i) as f64 * unit))
    }
}

/// Turns a row's contexts into those of its matrix, and gives entries that are not coded the one in which
/// nothing is: that of the model's tables, or [`UNCODED`].
fn own_contexts(contexts: &mut [u8], task: &Task, row: usize, model: Option<&LevelModel>) {
    for context in contexts.iter_mut() {
        *context += (task.matrix * CONTEXTS) as u8;
    }
    if let Some(coded) = task.coded {
        let none = model.map_or(UNCODED, |model| model.tables().sure_context());
        let coded = &coded[row * contexts.len()..];
        for (context, &coded) in contexts.iter_mut().zip(coded) {
            if coded == 0 {
                *context = none;
            }
        }
    }
}
