//! Most bytes that things can become.

use super::block_length_unit;

/// Bits of a decision of [`entropy::binary`](crate::entropy::binary): its probability is never below 63 / 2^16.
pub const DECISION_BITS: u64 = 11;
/// Bits of a number of 32 bits as its length, in decisions, and the bits below its highest.
pub const NUMBER_BITS: u64 = 33 * DECISION_BITS + 32;
/// Bits of a coefficient in contexts: the escape costs at most 11 and its coefficient 32; the
/// rounding of states adds less than one.
const IN_CONTEXTS_BITS: u64 = 44;
/// Bits of a coefficient as a gamma code, and of the up to seven quadrants that it alone may split.
const GAMMA_BITS: u64 = 65 + 7;
/// Lengths of masks, states of lanes, bytes begun, and padding.
const BLOCK_BYTES: u64 = 64;

/// Bits of one coefficient with its share of the block around it.
pub fn coefficient_bits(in_contexts: bool) -> u64 {
    if in_contexts {
        IN_CONTEXTS_BITS
    } else {
        GAMMA_BITS
    }
}

/// Bytes of `blocks` blocks of so many coefficients and so many decisions of void masks.
pub fn longest_blocks(blocks: u64, coefficients: u64, voids: u64, in_contexts: bool) -> u64 {
    let bits = coefficients.saturating_mul(coefficient_bits(in_contexts));
    let bits = bits.saturating_add(voids.saturating_mul(DECISION_BITS));
    (bits / 8).saturating_add(blocks.saturating_mul(BLOCK_BYTES))
}

/// Bytes of the block of a diamond of `cells` cells with so many matrices, void mask included.
pub fn longest_block(cells: usize, matrices: usize, in_contexts: bool) -> usize {
    let entries = (cells * cells) as u64;
    let longest = longest_blocks(1, entries * matrices as u64, entries, in_contexts);
    (longest as usize).next_multiple_of(usize::from(block_length_unit(cells)))
}
