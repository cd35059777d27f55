//! How often each symbol comes in a context, in 2048ths, and the bytes of such tables.

use super::binary::{BinaryDecoder, BinaryEncoder, Probability};
use super::token::{ESCAPE, SYMBOLS};

/// Bits of a frequency.
pub const PRECISION: u32 = 11;
/// What the frequencies of a context add up to.
pub const SLOTS: usize = 1 << PRECISION;
/// Bits below its highest that a coarse frequency keeps.
const COARSE_BITS: u32 = 3;

/// The frequencies of all symbols in one context. They add up to 2048, and the escape has at least 1, so
/// that every coefficient can be coded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frequencies(Box<[u16; SYMBOLS]>);

/// How often each symbol was seen.
pub type Counts = [u32; SYMBOLS];

impl Frequencies {
    /// One symbol for sure; nothing else can be coded.
    pub fn certain(symbol: u8) -> Frequencies {
        let mut all = [0; SYMBOLS];
        all[usize::from(symbol)] = SLOTS as u16;
        Frequencies(Box::new(all))
    }

    /// Frequencies like `counts`; `coarse` ones cost fewer bytes.
    pub fn like(counts: &Counts, coarse: bool) -> Frequencies {
        let mut counts: Vec<u64> = counts.iter().map(|&count| u64::from(count)).collect();
        counts[usize::from(ESCAPE)] = counts[usize::from(ESCAPE)].max(1);
        let total: u64 = counts.iter().sum();
        let mode = mode(&counts);
        let mut all = [0u16; SYMBOLS];
        let mut others = 0;
        for (symbol, &count) in counts.iter().enumerate() {
            if count > 0 && symbol != mode {
                let exact = (2 * count * SLOTS as u64 + total) / (2 * total);
                let exact = exact.clamp(1, SLOTS as u64 / 2) as u16;
                all[symbol] = if coarse { round(exact) } else { exact };
                others += usize::from(all[symbol]);
            }
        }
        // Roundings may leave the most frequent symbol less than a fair share: the others pay for it.
        while others >= SLOTS {
            let largest = (0..SYMBOLS)
                .max_by_key(|&symbol| (all[symbol], symbol))
                .unwrap_or(0);
            let less = if coarse {
                round_down(all[largest] - 1)
            } else {
                all[largest] - 1
            };
            others -= usize::from(all[largest] - less);
            all[largest] = less;
        }
        all[mode] = (SLOTS - others) as u16;
        Frequencies(Box::new(all))
    }

    /// Symbols that can come, ascending, with their frequencies.
    pub fn iter(&self) -> impl Iterator<Item = (u8, u16)> + '_ {
        let all = self.0.iter().enumerate();
        all.filter(|(_, frequency)| **frequency > 0)
            .map(|(symbol, &frequency)| (symbol as u8, frequency))
    }

    /// Bits of `counts` symbols coded so, in 2^-16 bits; without what is raw.
    pub fn cost(&self, counts: &Counts) -> u64 {
        let escape = u64::from(PRECISION + 32) << 16;
        let bits = |(&count, &frequency): (&u32, &u16)| match (count, frequency) {
            (0, _) => 0,
            (_, 0) => u64::from(count) * escape,
            _ => u64::from(count) * u64::from((PRECISION << 16) - log2(u32::from(frequency))),
        };
        counts.iter().zip(self.0.iter()).map(bits).sum()
    }
}

/// The most frequent symbol; the first of several.
fn mode(counts: &[u64]) -> usize {
    let best = (0..counts.len()).rev().max_by_key(|&symbol| counts[symbol]);
    best.unwrap_or(0)
}

/// A frequency rounded to its four highest bits.
fn round(frequency: u16) -> u16 {
    let shift = (frequency.max(1).ilog2()).saturating_sub(COARSE_BITS);
    round_down(frequency + ((1 << shift) >> 1))
}

fn round_down(frequency: u16) -> u16 {
    let shift = (frequency.max(1).ilog2()).saturating_sub(COARSE_BITS);
    frequency >> shift << shift
}

/// log2 of a number from 1 up, in 2^-16, by squaring: the same on every machine.
pub fn log2(number: u32) -> u32 {
    let whole = number.ilog2();
    let mut mantissa = u64::from(number) << (31 - whole);
    let mut fraction = 0;
    for _ in 0..16 {
        mantissa = (mantissa * mantissa) >> 31;
        fraction <<= 1;
        if mantissa >> 32 != 0 {
            fraction |= 1;
            mantissa >>= 1;
        }
    }
    whole << 16 | fraction
}

/// Adaptive probabilities of the numbers that tables are written in. One model serves all the tables of a
/// file, in order.
pub struct TableModel {
    coarse: Probability,
    symbol: [Probability; SYMBOLS],
    /// Of the bit length of a frequency, by the mean length of the two symbols before.
    length: [[Probability; PRECISION as usize + 2]; PRECISION as usize + 2],
    leading: [Probability; PRECISION as usize + 2],
}

impl Default for TableModel {
    fn default() -> TableModel {
        let half = Probability::default();
        TableModel {
            coarse: half,
            symbol: [half; SYMBOLS],
            length: [[half; PRECISION as usize + 2]; PRECISION as usize + 2],
            leading: [half; PRECISION as usize + 2],
        }
    }
}

/// What a model of tables is driven by: an encoder that is told the numbers, or a decoder that tells them.
pub trait Decisions {
    /// Passes one decision; a decoder ignores what it is told.
    fn decide(&mut self, told: bool, probability: &mut Probability) -> bool;

    /// The low `count` bits of a number, high to low, all equally likely.
    fn bits(&mut self, told: u32, count: u32) -> u32 {
        (0..count).rev().fold(0, |number, bit| {
            let half = &mut Probability::default();
            number << 1 | u32::from(self.decide(told >> bit & 1 != 0, half))
        })
    }
}

impl Decisions for BinaryEncoder {
    fn decide(&mut self, told: bool, probability: &mut Probability) -> bool {
        self.encode(told, probability);
        told
    }
}

impl Decisions for BinaryDecoder<'_> {
    fn decide(&mut self, _: bool, probability: &mut Probability) -> bool {
        self.decode(probability)
    }
}

impl TableModel {
    /// Writes a table.
    pub fn encode(&mut self, encoder: &mut BinaryEncoder, table: &Frequencies) {
        self.pass(encoder, &table.0);
    }

    /// Reads a table; `None` where its frequencies cannot be.
    pub fn decode(&mut self, decoder: &mut BinaryDecoder) -> Option<Frequencies> {
        let mut all = self.pass(decoder, &[0; SYMBOLS]);
        let mode = all.iter().position(|&frequency| frequency == u16::MAX)?;
        all[mode] = 0;
        let others: usize = all.iter().copied().map(usize::from).sum();
        all[mode] = SLOTS.checked_sub(others).filter(|&rest| rest > 0)? as u16;
        (all[usize::from(ESCAPE)] > 0).then(|| Frequencies(Box::new(all)))
    }

    /// Every number of a table in order. A decoder's most frequent symbol has the frequency `u16::MAX`.
    fn pass(&mut self, coder: &mut impl Decisions, told: &[u16; SYMBOLS]) -> [u16; SYMBOLS] {
        let counts: Vec<u64> = told.iter().map(|&frequency| u64::from(frequency)).collect();
        let mode = self.pass_symbol(coder, mode(&counts));
        let regular = usize::from(ESCAPE);
        let last = told[..regular].iter().rposition(|&frequency| frequency > 0);
        let end = self.pass_symbol(coder, last.map_or(0, |last| last + 1));
        let is_coarse = |&frequency: &u16| round_down(frequency) == frequency;
        let told_coarse = (0..SYMBOLS).all(|s| s == mode || is_coarse(&told[s]));
        let coarse = coder.decide(told_coarse, &mut self.coarse);
        let mut all = [0; SYMBOLS];
        let mut lengths = [PRECISION as usize; 2];
        for symbol in (0..end.min(regular)).chain([regular]) {
            if symbol == mode {
                all[symbol] = u16::MAX;
                lengths = [PRECISION as usize, lengths[0]];
                continue;
            }
            all[symbol] = self.pass_frequency(coder, told[symbol], coarse, &mut lengths);
        }
        all[mode.min(regular)] = u16::MAX;
        all
    }

    fn pass_frequency(
        &mut self,
        coder: &mut impl Decisions,
        told: u16,
        coarse: bool,
        lengths: &mut [usize; 2],
    ) -> u16 {
        let told_length = (u16::BITS - told.leading_zeros()) as usize;
        let probabilities = &mut self.length[(lengths[0] + lengths[1]).div_ceil(2)];
        let mut length = 0;
        while length <= PRECISION as usize
            && coder.decide(length < told_length, &mut probabilities[length])
        {
            length += 1;
        }
        *lengths = [length, lengths[0]];
        if length < 2 {
            return length as u16;
        }
        let below = length as u32 - 1;
        let kept = if coarse {
            below.min(COARSE_BITS)
        } else {
            below
        };
        let told_bits = u32::from(told) >> (below - kept);
        let first = coder.decide(told_bits >> (kept - 1) & 1 != 0, &mut self.leading[length]);
        let rest = coder.bits(told_bits & ((1 << (kept - 1)) - 1), kept - 1);
        let bits = 1 << kept | u32::from(first) << (kept - 1) | rest;
        (bits << (below - kept)) as u16
    }

    /// A symbol or the number of them, as eight decisions down a tree.
    fn pass_symbol(&mut self, coder: &mut impl Decisions, told: usize) -> usize {
        let mut node = 1;
        for bit in (0..8).rev() {
            let decision = coder.decide(told >> bit & 1 != 0, &mut self.symbol[node]);
            node = node << 1 | usize::from(decision);
        }
        node & 255
    }
}
