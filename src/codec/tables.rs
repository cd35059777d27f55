//! From how often symbols came to the tables that they are coded by.

use super::model::LevelModel;
use super::trace::Trace;
use crate::entropy::frequency::{Counts, Frequencies};
use crate::entropy::token::SYMBOLS;
use crate::transform::adaptive::CONTEXTS;

/// How often each symbol came in each context of the matrices of some diamonds.
pub struct Census {
    contexts: Vec<Counts>,
}

/// Bits that a table is taken to cost, and each of its symbols, when contexts are put together.
const TABLE_BITS: u64 = 12;
const SYMBOL_BITS_TIMES_TWO: u64 = 7;
/// Bits that exact frequencies cost more than coarse ones.
const EXACT_BITS: u64 = 60;

impl Census {
    /// Nothing seen yet, of diamonds with so many matrices.
    pub fn new(matrices: usize) -> Census {
        Census {
            contexts: vec![[0; SYMBOLS]; matrices * CONTEXTS],
        }
    }

    /// Counts the symbols of a diamond.
    pub fn add(&mut self, trace: &Trace) {
        for (context, symbol) in trace.coded_symbols() {
            self.contexts[context][usize::from(symbol)] += 1;
        }
    }

    /// Adds what another part counted.
    pub fn merge(&mut self, other: &Census) {
        for (own, other) in self.contexts.iter_mut().zip(&other.contexts) {
            let both = own.iter_mut().zip(other);
            both.for_each(|(own, other)| *own += other);
        }
    }

    /// What the counted symbols cost by a model's tables, in 2^-16 bits; without what is raw.
    pub fn cost(&self, model: &LevelModel) -> u64 {
        let tables = model.frequencies().zip(&self.contexts);
        tables.map(|(table, counts)| table.cost(counts)).sum()
    }

    /// Frequencies for each context of a matrix. Neighbours share them where that saves bytes.
    pub fn frequencies(&self, matrix: usize) -> Vec<Frequencies> {
        let own = &self.contexts[matrix * CONTEXTS..(matrix + 1) * CONTEXTS];
        let mut runs: Vec<Run> = (0..CONTEXTS)
            .filter(|&context| own[context].iter().any(|&count| count > 0))
            .map(|context| Run::new(context, own[context]))
            .collect();
        while let Some(place) = best_merge(&runs) {
            let next = runs.remove(place + 1);
            runs[place] = runs[place].with(&next);
        }
        let tables: Vec<Frequencies> = runs.iter().map(Run::frequencies).collect();
        let table_of = |context: usize| {
            let place = runs
                .iter()
                .rposition(|run| run.first <= context)
                .unwrap_or(0);
            let nothing = || Frequencies::like(&[0; SYMBOLS], true);
            tables.get(place).cloned().unwrap_or_else(nothing)
        };
        (0..CONTEXTS).map(table_of).collect()
    }
}

/// Neighbouring contexts that share a table.
struct Run {
    first: usize,
    counts: Counts,
    /// In 2^-16 bits, table included.
    cost: u64,
}

impl Run {
    fn new(first: usize, counts: Counts) -> Run {
        let symbols = counts.iter().filter(|&&count| count > 0).count() as u64;
        let table = TABLE_BITS + symbols * SYMBOL_BITS_TIMES_TWO / 2;
        Run {
            first,
            cost: Frequencies::like(&counts, true).cost(&counts) + (table << 16),
            counts,
        }
    }

    fn with(&self, next: &Run) -> Run {
        let mut counts = self.counts;
        for (own, other) in counts.iter_mut().zip(&next.counts) {
            *own += other;
        }
        Run::new(self.first, counts)
    }

    fn frequencies(&self) -> Frequencies {
        let [coarse, exact] = [true, false].map(|coarse| Frequencies::like(&self.counts, coarse));
        if exact.cost(&self.counts) + (EXACT_BITS << 16) < coarse.cost(&self.counts) {
            exact
        } else {
            coarse
        }
    }
}

/// The run that saves most by taking in its neighbour, if one does.
fn best_merge(runs: &[Run]) -> Option<usize> {
    let saved = |place: usize| {
        let pair = &runs[place..place + 2];
        (pair[0].cost + pair[1].cost).checked_sub(pair[0].with(&pair[1]).cost)
    };
    let merges = (0..runs.len().saturating_sub(1)).filter_map(|place| Some((saved(place)?, place)));
    merges
        .max_by_key(|&(saved, place)| (saved, std::cmp::Reverse(place)))
        .map(|(_, place)| place)
}
