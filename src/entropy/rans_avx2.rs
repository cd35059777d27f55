//! The decoder's inner loop in AVX2: eight lanes a step, with the results of the portable one.

use super::frequency::PRECISION;
use std::arch::x86_64::*;

/// Where eight lanes are.
pub(super) struct Lanes {
    pub states: [u32; 8],
    pub position: usize,
}

/// For each set of lanes that take in a word: which of the next words goes to which lane.
static WORD_OF_LANE: [[u8; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut set = 0;
    while set < 256 {
        let (mut lane, mut word) = (0, 0);
        while lane < 8 {
            table[set][lane] = word;
            word += (set >> lane & 1) as u8;
            lane += 1;
        }
        set += 1;
    }
    table
};

/// Whether the processor has what [`decode`] needs.
pub(super) fn available() -> bool {
    std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("popcnt")
}

/// Decodes as many symbols as there are contexts, as the coefficients that they would be if all were small, and
/// returns the greatest. Beyond `bytes` less 16 words are 0.
///
/// # Panics
/// Without [`available`]; if contexts and coefficients are not as many, and a multiple of 8; if `slots` has fewer than
/// 2048 entries for some context, or `bytes` fewer than 16.
pub(super) fn decode(
    lanes: &mut Lanes,
    slots: &[u32],
    bytes: &[u8],
    contexts: &[u8],
    coefficients: &mut [i32],
) -> i32 {
    let last = contexts.iter().fold(0, |last, &context| last.max(context));
    assert!(available() && bytes.len() >= 16 && contexts.len() == coefficients.len());
    assert!(contexts.len().is_multiple_of(8) && slots.len() >> PRECISION > usize::from(last));
    // SAFETY: the assertions.
    unsafe { decode_lanes(lanes, slots, bytes, contexts, coefficients) }
}

/// # Safety
/// The processor has AVX2; `contexts` and `coefficients` have the same length, a multiple of 8; `slots` has
/// 2048 entries for every context; `bytes` has at least 16, the last 16 of them zeros.
#[target_feature(enable = "avx2,popcnt")]
unsafe fn decode_lanes(
    lanes: &mut Lanes,
    slots: &[u32],
    bytes: &[u8],
    contexts: &[u8],
    coefficients: &mut [i32],
) -> i32 {
    let last = bytes.len() - 16;
    let low_bits = _mm256_set1_epi32((1 << PRECISION) - 1);
    let one = _mm256_set1_epi32(1);
    let byte = _mm256_set1_epi32(255);
    let mut greatest = _mm256_setzero_si256();
    // SAFETY: loads of contexts and stores of coefficients stay within slices of equal length, a multiple of 8;
    // a gather's index is a context times 2048 plus 11 bits; words are read at most 16 bytes before the
    // end of `bytes`.
    unsafe {
        let mut states = _mm256_loadu_si256(lanes.states.as_ptr().cast());
        for start in (0..contexts.len()).step_by(8) {
            let context = _mm_loadl_epi64(contexts.as_ptr().add(start).cast());
            let table = _mm256_slli_epi32::<{ PRECISION as i32 }>(_mm256_cvtepu8_epi32(context));
            let index = _mm256_or_si256(table, _mm256_and_si256(states, low_bits));
            let entry = _mm256_i32gather_epi32::<4>(slots.as_ptr().cast(), index);
            let symbol = _mm256_and_si256(entry, byte);
            let sign = _mm256_sub_epi32(_mm256_setzero_si256(), _mm256_and_si256(symbol, one));
            let coefficient = _mm256_xor_si256(_mm256_srli_epi32::<1>(symbol), sign);
            _mm256_storeu_si256(coefficients.as_mut_ptr().add(start).cast(), coefficient);
            greatest = _mm256_max_epi32(greatest, symbol);
            let frequency = _mm256_add_epi32(
                _mm256_and_si256(_mm256_srli_epi32::<8>(entry), low_bits),
                one,
            );
            let quotient = _mm256_srli_epi32::<{ PRECISION as i32 }>(states);
            states = _mm256_add_epi32(
                _mm256_mullo_epi32(frequency, quotient),
                _mm256_srli_epi32::<19>(entry),
            );
            // States are below 2^27: the signed comparison is right.
            let needy = _mm256_cmpgt_epi32(_mm256_set1_epi32(1 << PRECISION), states);
            let set = _mm256_movemask_ps(_mm256_castsi256_ps(needy)) as usize;
            let words = _mm_loadu_si128(bytes.as_ptr().add(lanes.position.min(last)).cast());
            let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(WORD_OF_LANE[set].as_ptr().cast()));
            let word = _mm256_permutevar8x32_epi32(_mm256_cvtepu16_epi32(words), order);
            let filled = _mm256_or_si256(_mm256_slli_epi32::<16>(states), word);
            states = _mm256_blendv_epi8(states, filled, needy);
            lanes.position += 2 * set.count_ones() as usize;
        }
        _mm256_storeu_si256(lanes.states.as_mut_ptr().cast(), states);
        let half = _mm_max_epi32(
            _mm256_castsi256_si128(greatest),
            _mm256_extracti128_si256::<1>(greatest),
        );
        let pair = _mm_max_epi32(half, _mm_shuffle_epi32::<0b01_00_11_10>(half));
        _mm_cvtsi128_si32(_mm_max_epi32(
            pair,
            _mm_shuffle_epi32::<0b10_11_00_01>(pair),
        ))
    }
}
