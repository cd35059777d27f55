//! The coefficients of a diamond before their entropy code.

use super::model::LevelModel;
use super::symbols::turn;
use crate::entropy::rans;
use crate::entropy::token::Tokens;
use crate::transform::adaptive::Outlook;

/// The context of an entry without a coefficient.
pub(super) const UNCODED: u8 = u8::MAX;

/// The coefficients of a diamond with the context of each, matrix after matrix.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Trace {
    /// Context of each entry among those of all matrices; [`UNCODED`] where it has no coefficient.
    contexts: Vec<u8>,
    /// N^2 coefficients for each matrix.
    tokens: Tokens,
}

impl Trace {
    /// Adds a row of coefficients, 0 where there is none.
    pub(super) fn add_row(&mut self, outlook: &Outlook, coefficients: &[i32], turns: bool) {
        if turns {
            let mut turned = coefficients.to_vec();
            turn(&mut turned, &outlook.fractions);
            self.tokens.extend(&turned);
        } else {
            self.tokens.extend(coefficients);
        }
        self.contexts.extend_from_slice(&outlook.contexts);
    }

    /// Contexts and coefficients as they are in memory.
    pub(super) fn as_bytes(&self) -> Vec<u8> {
        let raw = bytemuck::cast_slice(&self.tokens.raw);
        let count = self.contexts.len().to_ne_bytes();
        [&count[..], &self.contexts, &self.tokens.symbols, raw].concat()
    }

    /// The trace that has these bytes.
    pub(super) fn of_bytes(bytes: &[u8]) -> Trace {
        let (count, rest) = bytes.split_at(size_of::<usize>());
        let count = usize::from_ne_bytes(std::array::from_fn(|index| count[index]));
        let (contexts, rest) = rest.split_at(count);
        let (symbols, raw) = rest.split_at(count);
        Trace {
            contexts: contexts.to_vec(),
            tokens: Tokens {
                symbols: symbols.to_vec(),
                raw: bytemuck::pod_collect_to_vec(raw),
            },
        }
    }

    /// Whether all coefficients are 0.
    pub fn is_zero(&self) -> bool {
        self.tokens.symbols.iter().all(|&symbol| symbol == 0)
    }

    /// Coefficients with their contexts; those without any are passed over.
    pub fn coded(&self) -> impl Iterator<Item = (usize, i32)> + '_ {
        let entries = self.contexts.iter().zip(self.tokens.coefficients());
        let coded = entries.filter(|(context, _)| **context != UNCODED);
        coded.map(|(&context, coefficient)| (usize::from(context), coefficient))
    }

    /// Symbols of coefficients with their contexts.
    pub(super) fn coded_symbols(&self) -> impl Iterator<Item = (usize, u8)> + '_ {
        let entries = self.contexts.iter().zip(&self.tokens.symbols);
        let coded = entries.filter(|(context, _)| **context != UNCODED);
        coded.map(|(&context, &symbol)| (usize::from(context), symbol))
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
        let encode = |least| rans::encode_tokens(tables, &contexts, &self.tokens, least);
        let mut bytes = encode(0);
        let short = (before + bytes.len()).next_multiple_of(multiple) - before - bytes.len();
        if short > 0 {
            bytes = encode(bytes.len() + short);
        }
        bytes
    }
}
