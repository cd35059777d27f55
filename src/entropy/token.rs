//! Coefficients as symbols of one byte, with raw bits for what a symbol leaves open.
//!
//! Symbols 0 to 30 are the coefficients 0, -1, 1, ..., -15, 15. Beyond, a magnitude's symbol gives its
//! bit length, the two bits below its highest, and its sign; the bits below those are raw.

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
}
