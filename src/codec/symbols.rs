//! The coefficients of a block in contexts: what the trained predictor and the rANS coder make of a
//! diamond's matrices, row by row.

use super::model::LevelModel;
use super::trace::{Trace, UNCODED};
use super::training::{Fit, Trainer};
use crate::entropy::rans::Decoder;
use crate::transform::Quantiser;
use crate::transform::adaptive::{
    COMPANIONS, CONTEXTS, Outlook, Quarters, Surroundings, WEIGHT_BITS, Weights, Workspace,
};
use std::cell::RefCell;

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

/// What prediction left of coefficients that are known.
pub(super) struct Known {
    /// N^2.
    pub residuals: Vec<i32>,
    /// Units that one is worth.
    pub step: i32,
}

/// What every block of a repository has in common, for one of the components.
#[derive(Clone)]
pub struct SymbolCoder {
    cells: usize,
    quantiser: Quantiser,
    adaptive: bool,
    /// Residuals are coded as seen from the side that rounding took the prediction to.
    turns: bool,
    vectors: bool,
}

impl SymbolCoder {
    /// For diamonds of `cells` cells. With `adaptive` the trained predictor comes before the quantiser, or, where
    /// levels are filtered, after it; else coefficients of the transform are coded. `vectors` allows what the
    /// processor has, to the same result.
    pub fn new(cells: usize, quantiser: Quantiser, adaptive: bool, vectors: bool) -> SymbolCoder {
        SymbolCoder {
            cells,
            quantiser,
            adaptive,
            turns: false,
            vectors,
        }
    }

    /// The same for a component of colours, whose small residuals gain from what rounding took from their
    /// predictions: where it is negative they change their sign, so that they are more often positive.
    pub fn of_colours(self) -> SymbolCoder {
        SymbolCoder {
            turns: true,
            ..self
        }
    }

    /// Whether the trained predictor is used.
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

    /// The centres that a block leads to by trained prediction; `None` stands for residuals all zero.
    /// `kept`, if it is given, gets the residuals.
    pub(super) fn decode_centres(
        &self,
        model: &LevelModel,
        task: &Task,
        mut decoder: Option<&mut Decoder>,
        mut kept: Option<&mut Vec<i32>>,
    ) -> Box<[i32]> {
        let mut centres = vec![0; self.cells * self.cells].into_boxed_slice();
        let weights = model.weights(task.matrix);
        self.surround(task.vertices, |surroundings, outlook| {
            if let (Some(decoder), None) = (&mut decoder, &kept)
                && self.decode_wave(surroundings, weights, task, decoder, &mut centres)
            {
                return;
            }
            let walk = (surroundings, outlook);
            self.walk_centres(
                walk,
                task,
                weights,
                &mut centres,
                |row, outlook, centres| {
                    if let Some(decoder) = &mut decoder {
                        own_contexts(&mut outlook.contexts, task, row, Some(model));
                        decoder.decode(&outlook.contexts, centres);
                        if self.turns {
                            turn(centres, &outlook.fractions);
                        }
                    }
                    if let Some(kept) = &mut kept {
                        kept.extend_from_slice(centres);
                    }
                    self.quantiser
                        .reconstruct_row(&outlook.predictions, centres);
                },
            );
        });
        centres
    }

    /// Adds what trained prediction leaves of the centres of `target`; gives what they come back as, and the
    /// residuals.
    pub(super) fn trace_centres(
        &self,
        weights: &Weights,
        task: &Task,
        target: &[i32],
        trace: &mut Trace,
    ) -> (Box<[i32]>, Vec<i32>) {
        let cells = self.cells;
        let mut centres = vec![0; cells * cells].into_boxed_slice();
        let mut kept = Vec::with_capacity(cells * cells);
        self.surround(task.vertices, |surroundings, outlook| {
            let walk = (surroundings, outlook);
            self.walk_centres(
                walk,
                task,
                weights,
                &mut centres,
                |row, outlook, centres| {
                    own_contexts(&mut outlook.contexts, task, row, None);
                    let places = row * cells..(row + 1) * cells;
                    let coded = task.coded.map(|coded| &coded[places.clone()]);
                    let target = &target[places];
                    self.quantiser
                        .quantise_row(target, &outlook.predictions, coded, centres);
                    trace.add_row(outlook, centres, self.turns);
                    kept.extend_from_slice(centres);
                    self.quantiser
                        .reconstruct_row(&outlook.predictions, centres);
                },
            );
        });
        (centres, kept)
    }

    /// Shows a trainer the centres of `target`; gives their residuals.
    pub(super) fn show_centres(
        &self,
        trainer: &Trainer,
        fit: &mut Fit,
        task: &Task,
        target: &[i32],
    ) -> Vec<i32> {
        let (cells, [low, high]) = (self.cells, self.quantiser.range());
        let mut residuals = vec![0; cells * cells];
        let mut row = vec![0; cells];
        self.surround(task.vertices, |surroundings, outlook| {
            let quarters = surroundings.quarters();
            let step = f64::from(self.step()) * quarters.unit;
            let mut sights = vec![Default::default(); cells];
            for (j, residuals) in residuals.chunks_exact_mut(cells).enumerate() {
                let company = self.foresee(surroundings, task, j, trainer.weights(), outlook);
                let places = j * cells..(j + 1) * cells;
                let coded = task.coded.map(|coded| &coded[places.clone()]);
                let target = &target[places];
                self.quantiser
                    .quantise_row(target, &outlook.predictions, coded, residuals);
                row.copy_from_slice(residuals);
                self.quantiser
                    .reconstruct_row(&outlook.predictions, &mut row);
                surroundings.look_around(trainer.weights(), &mut sights);
                for (i, sight) in sights.iter().enumerate() {
                    let prediction = outlook.predictions[i];
                    if coded.is_some_and(|coded| coded[i] == 0) {
                        row[i] = prediction.clamp(low, high);
                        continue;
                    }
                    let place = quarters.of(target[i]);
                    let from_order_two = place - f64::from(sight.0.order_two);
                    let misses = [from_order_two, place - quarters.of(prediction)];
                    trainer.see(fit, sight, misses, company.told(i, quarters), step);
                }
                surroundings.complete(&row);
            }
        });
        fit.settle();
        residuals
    }

    /// The coefficients of a matrix of a block, and what prediction left of them.
    pub(super) fn decode_coefficients(
        &self,
        model: &LevelModel,
        task: &Task,
        mut decoder: Option<&mut Decoder>,
    ) -> (Box<[i32]>, Vec<i32>) {
        let mut residuals = vec![0; self.cells * self.cells];
        if decoder.is_none() && !self.adaptive && task.companions.is_empty() {
            return (residuals.clone().into(), residuals);
        }
        let mut entries = vec![0; self.cells * self.cells].into_boxed_slice();
        let weights = model.weights(task.matrix);
        self.walk_coefficients(task, weights, &mut entries, |row, outlook, entries| {
            own_contexts(&mut outlook.contexts, task, row, Some(model));
            let start = row * self.cells;
            let residuals = &mut residuals[start..start + self.cells];
            if let Some(decoder) = &mut decoder {
                decoder.decode(&outlook.contexts, residuals);
                if self.turns {
                    turn(residuals, &outlook.fractions);
                }
            }
            for (i, (entry, &residual)) in entries.iter_mut().zip(&*residuals).enumerate() {
                if task.coded.is_none_or(|coded| coded[start + i] != 0) {
                    *entry = residual.wrapping_add(outlook.predictions[i]);
                }
            }
        });
        (entries, residuals)
    }

    /// Adds what prediction leaves of the coefficients of a matrix, which it gives too.
    pub(super) fn trace_coefficients(
        &self,
        weights: &Weights,
        task: &Task,
        entries: &[i32],
        trace: &mut Trace,
    ) -> Vec<i32> {
        let mut own = entries.to_vec();
        let mut kept: Vec<i32> = Vec::with_capacity(entries.len());
        self.walk_coefficients(task, weights, &mut own, |row, outlook, entries| {
            own_contexts(&mut outlook.contexts, task, row, None);
            let start = kept.len();
            for (i, entry) in entries.iter().enumerate() {
                let residual = entry.wrapping_sub(outlook.predictions[i]);
                let is_coded = outlook.contexts[i] != UNCODED;
                kept.push(if is_coded { residual } else { 0 });
            }
            trace.add_row(outlook, &kept[start..], self.turns);
        });
        kept
    }

    /// Shows the trainer of a matrix its coefficients; gives what prediction leaves of them.
    pub(super) fn show_coefficients(
        &self,
        trainer: &Trainer,
        fit: &mut Fit,
        task: &Task,
        entries: &[i32],
    ) -> Vec<i32> {
        let cells = self.cells;
        let mut residuals = vec![0; cells * cells];
        self.surround(task.vertices, |surroundings, outlook| {
            let quarters = surroundings.quarters();
            let step = f64::from(self.step()) * quarters.unit;
            let mut sights = vec![Default::default(); cells];
            for (j, row) in entries.chunks_exact(cells).enumerate() {
                let weights = trainer.weights();
                let company = self.foresee_coefficients(surroundings, task, j, weights, outlook);
                surroundings.look_around(weights, &mut sights);
                for (i, &coefficient) in row.iter().enumerate() {
                    let index = j * cells + i;
                    if task.coded.is_none_or(|coded| coded[index] != 0) {
                        residuals[index] = coefficient.wrapping_sub(outlook.predictions[i]);
                        let misses = [coefficient, residuals[index]].map(|k| f64::from(k) * step);
                        let told = company.told(i, quarters);
                        trainer.see(fit, &sights[i], misses, told, step);
                    }
                }
                surroundings.complete_coefficients(row, self.step());
            }
        });
        fit.settle();
        residuals
    }

    /// Goes over the rows of centres that are predicted here. `visit` gets each row's number and outlook, and
    /// makes its heights.
    fn walk_centres(
        &self,
        (surroundings, outlook): (&mut dyn Surroundings, &mut Outlook),
        task: &Task,
        weights: &Weights,
        centres: &mut [i32],
        mut visit: impl FnMut(usize, &mut Outlook, &mut [i32]),
    ) {
        for (index, row) in centres.chunks_exact_mut(self.cells).enumerate() {
            self.foresee(surroundings, task, index, weights, outlook);
            visit(index, outlook, row);
            surroundings.complete(row);
        }
    }

    /// Decodes all centres at once, where vectors can; whether they could.
    #[cfg(target_arch = "x86_64")]
    fn decode_wave(
        &self,
        surroundings: &dyn Surroundings,
        weights: &Weights,
        task: &Task,
        decoder: &mut Decoder,
        centres: &mut [i32],
    ) -> bool {
        let is_plain = task.matrix == 0 && task.coded.is_none() && !self.turns;
        let Some(vertices) = surroundings.vertices().filter(|_| is_plain) else {
            return false;
        };
        super::wave_avx2::decode(vertices, weights, decoder, &self.quantiser, centres)
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn decode_wave(
        &self,
        _: &dyn Surroundings,
        _: &Weights,
        _: &Task,
        _: &mut Decoder,
        _: &mut [i32],
    ) -> bool {
        false
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
        self.surround(task.vertices, |surroundings, outlook| {
            for (index, row) in coefficients.chunks_exact_mut(self.cells).enumerate() {
                self.foresee_coefficients(surroundings, task, index, weights, outlook);
                visit(index, outlook, row);
                surroundings.complete_coefficients(row, self.step());
            }
        });
    }

    /// Contexts and predictions of a row of centres.
    fn foresee<'a>(
        &self,
        surroundings: &mut dyn Surroundings,
        task: &Task<'a>,
        row: usize,
        weights: &Weights,
        outlook: &mut Outlook,
    ) -> Company<'a> {
        let company = self.accompany(surroundings, task, row);
        if self.turns {
            surroundings.foresee_finely(weights, false, outlook);
            company.predict(weights, 1, outlook);
        } else {
            surroundings.foresee(weights, outlook);
        }
        company
    }

    /// Contexts and predictions of a row of coefficients, which are details where they are predicted by the
    /// trained predictor.
    fn foresee_coefficients<'a>(
        &self,
        surroundings: &mut dyn Surroundings,
        task: &Task<'a>,
        row: usize,
        weights: &Weights,
        outlook: &mut Outlook,
    ) -> Company<'a> {
        let company = self.accompany(surroundings, task, row);
        if self.adaptive {
            surroundings.foresee_finely(weights, true, outlook);
        } else {
            surroundings.foresee_contexts(weights, outlook);
            outlook.predictions.fill(0);
            outlook.fractions.fill(0);
        }
        company.predict(weights, self.step(), outlook);
        company
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
            residuals: &known.residuals[start..start + self.cells],
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
                for (size, &residual) in sizes.iter_mut().zip(row.residuals) {
                    let own = residual.unsigned_abs().saturating_mul(row.step as u32);
                    *size = size.saturating_add_unsigned(own);
                }
            }
            surroundings.accompany(&sizes, 1);
        } else if let Some(row) = known().next() {
            surroundings.accompany(row.residuals, row.step);
        }
        company
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

/// A row of a matrix that is known.
#[derive(Clone, Copy)]
struct Row<'a> {
    residuals: &'a [i32],
    step: i32,
}

impl Row<'_> {
    fn units(&self, i: usize) -> i64 {
        i64::from(self.residuals[i]) * i64::from(self.step)
    }
}

/// The same row of the components before.
struct Company<'a>([Option<Row<'a>>; COMPANIONS]);

impl Company<'_> {
    /// Moves predictions by what the components before tell, and turns them into coefficients that are worth
    /// `step` units; their fractions keep no more than their sign.
    fn predict(&self, weights: &Weights, step: i32, outlook: &mut Outlook) {
        if self.0[0].is_none() && step == 1 {
            return;
        }
        let unit = i64::from(step) << WEIGHT_BITS;
        let both = outlook.predictions.iter_mut().zip(&mut outlook.fractions);
        for (i, (prediction, fraction)) in both.enumerate() {
            let class = Weights::class(usize::from(outlook.contexts[i]));
            let rows = self.0.iter().zip(&weights.companions);
            let told = rows.fold(0, |sum, (row, weights)| {
                let units = row.map_or(0, |row| row.units(i));
                sum + units.clamp(-1 << 40, 1 << 40) * i64::from(weights[class])
            });
            let fine = (i64::from(*prediction) << WEIGHT_BITS) + i64::from(*fraction) + told;
            let coefficient = (fine + unit / 2).div_euclid(unit);
            let coefficient = coefficient.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
            *prediction = coefficient as i32;
            *fraction = (fine - coefficient * unit).signum() as i32;
        }
    }

    /// The entries of the components before, in quarters of a shifted unit.
    fn told(&self, i: usize, quarters: Quarters) -> [f64; COMPANIONS] {
        self.0
            .map(|row| row.map_or(0.0, |row| row.units(i) as f64 * quarters.unit))
    }
}

/// Changes the signs of the residuals whose predictions were rounded up.
pub(super) fn turn(residuals: &mut [i32], fractions: &[i32]) {
    for (residual, &fraction) in residuals.iter_mut().zip(fractions) {
        if fraction < 0 {
            *residual = residual.wrapping_neg();
        }
    }
}

/// Turns a row's contexts into those of its matrix, and gives entries that are not coded the one in which
/// nothing is: that of the model's tables, or [`UNCODED`].
fn own_contexts(contexts: &mut [u8], task: &Task, row: usize, model: Option<&LevelModel>) {
    if task.matrix > 0 {
        let first = (task.matrix * CONTEXTS) as u8;
        for context in contexts.iter_mut() {
            *context += first;
        }
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
