//! Coefficients as symbols of one byte, with raw bits for what a symbol leaves open.
//!
//! Symbols 0 to 30 are the coefficients 0, -1, 1, ..., -15, 15. Beyond, a magnitude's symbol gives its
//! bit length, the two bits below its highest, and its sign; the bits below those are raw.

use crate::vectors::widened;

/// Symbols that there are. The last one stands for any coefficient, all of whose bits are raw.
pub const SYMBOLS: usize = 256;
/// The symbol of any coefficient at all.
pub const ESCAPE: u8 = 255;
/// The first symbol that raw bits may follow.
pub const FIRST_RAW: u8 = 31;
/// Largest magnitude of a coefficient whose symbol comes before.
pub const LARGEST_SMALL: i32 = 15;

/// A coefficient's symbol, its raw bits and their count.
#[inline]
pub fn split(coefficient: i32) -> (u8, u32, u32) {
    let magnitude = coefficient.unsigned_abs();
    if magnitude < 16 {
        return (((coefficient << 1) ^ (coefficient >> 31)) as u8, 0, 0);
    }
    let raw = magnitude.ilog2() - 2;
    let bucket = 4 * (raw - 2) + (magnitude >> raw & 3);
    let symbol = u32::from(FIRST_RAW) + 2 * bucket + u32::from(coefficient < 0);
    (symbol as u8, magnitude & ((1 << raw) - 1), raw)
}

/// How many raw bits follow a symbol.
#[inline]
pub fn raw_bits(symbol: u8) -> u32 {
    match symbol {
        ..FIRST_RAW => 0,
        ESCAPE => 32,
        _ => u32::from(symbol - FIRST_RAW) / 8 + 2,
    }
}

/// The coefficient of a symbol below [`FIRST_RAW`]; others give numbers beyond [`LARGEST_SMALL`].
#[inline(always)]
pub fn small(symbol: u8) -> i32 {
    let symbol = i32::from(symbol);
    (symbol >> 1) ^ -(symbol & 1)
}

/// The coefficient of a symbol and its raw bits.
#[inline]
pub fn join(symbol: u8, raw: u32) -> i32 {
    match symbol {
        ..FIRST_RAW => small(symbol),
        ESCAPE => raw as i32,
        _ => {
            let bucket = u32::from(symbol - FIRST_RAW) / 2;
            let magnitude = (4 + bucket % 4) << raw_bits(symbol) | raw;
            let sign = -i32::from((symbol - FIRST_RAW) & 1 != 0);
            (magnitude as i32 ^ sign).wrapping_sub(sign)
        }
    }
}

/// Coefficients as their symbols, and the raw bits of those that have some.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tokens {
    /// One for each coefficient; never [`ESCAPE`].
    pub symbols: Vec<u8>,
    /// For each symbol from [`FIRST_RAW`] on, in order.
    pub raw: Vec<u32>,
}

impl Tokens {
    /// Adds some coefficients.
    pub fn extend(&mut self, coefficients: &[i32]) {
        let start = self.symbols.len();
        self.symbols.resize(start + coefficients.len(), 0);
        if split_small(coefficients, &mut self.symbols[start..]) {
            return;
        }
        for (own, &coefficient) in self.symbols[start..].iter_mut().zip(coefficients) {
            let (symbol, raw, count) = split(coefficient);
            *own = symbol;
            if count > 0 {
                self.raw.push(raw);
            }
        }
    }

    /// The coefficients.
    pub fn coefficients(&self) -> impl Iterator<Item = i32> + '_ {
        let mut raw = self.raw.iter();
        self.symbols.iter().map(move |&symbol| {
            let has_raw = symbol >= FIRST_RAW;
            let bits = if has_raw { raw.next() } else { None };
            join(symbol, bits.copied().unwrap_or(0))
        })
    }
}

widened! {
    /// Symbols of coefficients that are all small; whether they are.
    fn split_small(coefficients: &[i32], symbols: &mut [u8]) -> bool {
        let mut greatest = 0;
        for (symbol, &coefficient) in symbols.iter_mut().zip(coefficients) {
            let own = (coefficient << 1) ^ (coefficient >> 31);
            greatest = greatest.max(own as u32);
            *symbol = own as u8;
        }
        greatest < u32::from(FIRST_RAW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coefficient_comes_back_from_its_symbol() {
        let edges = (0..32).flat_map(|bit| {
            let power = 1i64 << bit;
            [power - 1, power, power + 1, -power - 1, -power, -power + 1]
        });
        let all = (-5000..5000).chain(edges).chain([i64::from(i32::MAX)]);
        for value in all {
            let coefficient = value as i32;
            let (symbol, raw, count) = split(coefficient);
            assert_eq!(raw_bits(symbol), count, "{coefficient}");
            assert_eq!(join(symbol, raw), coefficient);
            assert_ne!(symbol, ESCAPE);
        }
    }
    #[test]
    fn coefficients_come_back_from_their_tokens() {
        let small: Vec<i32> = (-15..16).chain([-16]).collect();
        let mixed = [3, 17, 0, -1 << 20, 15, 16, i32::MIN, i32::MAX];
        let mut tokens = Tokens::default();
        tokens.extend(&small[..31]);
        assert!(tokens.raw.is_empty());
        tokens.extend(&small);
        tokens.extend(&mixed);
        let all = [&small[..31], &small, &mixed].concat();
        assert_eq!(tokens.coefficients().collect::<Vec<_>>(), all);
        let symbols: Vec<u8> = all.iter().map(|&own| split(own).0).collect();
        assert_eq!(tokens.symbols, symbols);
    }
}
