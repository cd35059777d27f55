//! The decoder's inner loop in AVX2: eight symbols a step, with the results of the portable one.

use super::frequency::PRECISION;
use super::rans::{COEFFICIENT_AT, OFFSET_AT};
use super::token::LARGEST_SMALL;
use std::arch::x86_64::*;

/// Where the lanes of a block are.
pub(crate) struct Lanes<'a> {
    /// 2048 for each context.
    pub slots: &'a [u32],
    /// The block, and at least 16 zeros.
    pub bytes: &'a [u8],
    /// How many lanes there are: 2, 4 or 8.
    pub count: usize,
    pub states: [u32; 8],
    /// Next word.
    pub position: usize,
}

impl Lanes<'_> {
    /// Whether there are slots for the first so many contexts.
    pub(crate) fn has_contexts(&self, count: usize) -> bool {
        self.slots.len() >> PRECISION >= count
    }
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

/// Decodes as many symbols of eight lanes as there are contexts, as the coefficients that they would be if all
/// were small, and returns whether some are not.
///
/// # Panics
/// Without [`available`]; if contexts and coefficients are not as many, and a multiple of 8; if there are fewer
/// than 2048 slots for some context, or fewer bytes than 16.
pub(super) fn decode(lanes: &mut Lanes, contexts: &[u8], coefficients: &mut [i32]) -> bool {
    let last = contexts.iter().fold(0, |last, &context| last.max(context));
    assert!(available() && lanes.bytes.len() >= 16 && contexts.len() == coefficients.len());
    assert!(contexts.len().is_multiple_of(8) && lanes.slots.len() >> PRECISION > usize::from(last));
    // SAFETY: the assertions.
    unsafe { decode_lanes(lanes, contexts, coefficients) }
}

/// # Safety
/// As the assertions of [`decode`].
#[target_feature(enable = "avx2,popcnt")]
unsafe fn decode_lanes(lanes: &mut Lanes, contexts: &[u8], coefficients: &mut [i32]) -> bool {
    let mut greatest = _mm256_setzero_si256();
    let mut run = Run::new(lanes);
    for start in (0..contexts.len()).step_by(8) {
        // SAFETY: there are eight contexts and coefficients from `start` on.
        unsafe {
            let eight = run.eight::<8, 0>(contexts.as_ptr().add(start));
            _mm256_storeu_si256(coefficients.as_mut_ptr().add(start).cast(), eight);
            greatest = _mm256_max_epi32(greatest, _mm256_abs_epi32(eight));
        }
    }
    run.end::<8>(lanes);
    let raw = _mm256_cmpgt_epi32(greatest, _mm256_set1_epi32(LARGEST_SMALL));
    _mm256_testz_si256(raw, raw) == 0
}

/// The lanes of a block while symbols are decoded eight at a time.
pub(crate) struct Run<'a> {
    slots: &'a [u32],
    bytes: &'a [u8],
    position: usize,
    /// Of eight lanes.
    vector: __m256i,
    /// Of fewer.
    states: [u32; 4],
}

impl<'a> Run<'a> {
    /// # Panics
    /// If there are fewer bytes than 16.
    #[inline]
    #[target_feature(enable = "avx2,popcnt")]
    pub(crate) fn new(lanes: &Lanes<'a>) -> Run<'a> {
        assert!(lanes.bytes.len() >= 16);
        let [a, b, c, d, ..] = lanes.states;
        Run {
            slots: lanes.slots,
            bytes: lanes.bytes,
            position: lanes.position,
            // SAFETY: there are eight states.
            vector: unsafe { _mm256_loadu_si256(lanes.states.as_ptr().cast()) },
            states: [a, b, c, d],
        }
    }

    /// Says where the `COUNT` lanes are.
    #[inline]
    #[target_feature(enable = "avx2,popcnt")]
    pub(crate) fn end<const COUNT: usize>(self, lanes: &mut Lanes) {
        lanes.position = self.position;
        if COUNT < 8 {
            lanes.states[..COUNT].copy_from_slice(&self.states[..COUNT]);
            return;
        }
        // SAFETY: there are eight states.
        unsafe { _mm256_storeu_si256(lanes.states.as_mut_ptr().cast(), self.vector) };
    }

    /// The next eight symbols of `COUNT` lanes, as the coefficients that they would be if all were small. `CALLER`
    /// is a number of the place that calls: a function that is called from one place alone is part of it.
    ///
    /// # Safety
    /// There are eight contexts, and 2048 slots for each of them.
    #[inline]
    #[target_feature(enable = "avx2,popcnt")]
    pub(crate) unsafe fn eight<const COUNT: usize, const CALLER: usize>(
        &mut self,
        contexts: *const u8,
    ) -> __m256i {
        // SAFETY: the caller's.
        unsafe {
            if COUNT == 8 {
                self.vector(contexts)
            } else {
                self.scalars::<COUNT, CALLER>(contexts)
            }
        }
    }

    #[inline]
    #[target_feature(enable = "avx2,popcnt")]
    unsafe fn vector(&mut self, contexts: *const u8) -> __m256i {
        let last = self.bytes.len() - 16;
        let low_bits = _mm256_set1_epi32((1 << PRECISION) - 1);
        let frequency_bits = _mm256_set1_epi32((2 << PRECISION) - 1);
        let states = self.vector;
        // SAFETY: a gather's index is a context times 2048 plus 11 bits; words are read at most 16 bytes before
        // the end of `bytes`.
        unsafe {
            let context = _mm_loadl_epi64(contexts.cast());
            let table = _mm256_slli_epi32::<{ PRECISION as i32 }>(_mm256_cvtepu8_epi32(context));
            let index = _mm256_or_si256(table, _mm256_and_si256(states, low_bits));
            let entry = _mm256_i32gather_epi32::<4>(self.slots.as_ptr().cast(), index);
            let frequency = _mm256_and_si256(entry, frequency_bits);
            let offset = _mm256_srli_epi32::<{ OFFSET_AT as i32 }>(entry);
            let quotient = _mm256_srli_epi32::<{ PRECISION as i32 }>(states);
            let states = _mm256_add_epi32(
                _mm256_mullo_epi32(frequency, quotient),
                _mm256_and_si256(offset, low_bits),
            );
            // States are below 2^27: the signed comparison is right.
            let needy = _mm256_cmpgt_epi32(_mm256_set1_epi32(1 << PRECISION), states);
            let set = _mm256_movemask_ps(_mm256_castsi256_ps(needy)) as usize;
            let words = _mm_loadu_si128(self.bytes.as_ptr().add(self.position.min(last)).cast());
            let order = _mm256_cvtepu8_epi32(_mm_loadl_epi64(WORD_OF_LANE[set].as_ptr().cast()));
            let word = _mm256_permutevar8x32_epi32(_mm256_cvtepu16_epi32(words), order);
            let filled = _mm256_or_si256(_mm256_slli_epi32::<16>(states), word);
            self.vector = _mm256_blendv_epi8(states, filled, needy);
            self.position += 2 * set.count_ones() as usize;
            _mm256_srai_epi32::<{ COEFFICIENT_AT as i32 }>(entry)
        }
    }

    #[inline]
    #[target_feature(enable = "avx2,popcnt")]
    unsafe fn scalars<const COUNT: usize, const CALLER: usize>(
        &mut self,
        contexts: *const u8,
    ) -> __m256i {
        let last = self.bytes.len() - 16;
        let mut coefficients = 0;
        for index in 0..8 {
            let state = self.states[index % COUNT];
            // SAFETY: an index is a context times 2048 plus 11 bits; words are read before the end of `bytes`.
            unsafe {
                let context = usize::from(*contexts.add(index)) << PRECISION;
                let slot = context | (state as usize & ((1 << PRECISION) - 1));
                let entry = *self.slots.as_ptr().add(slot);
                let frequency = entry & ((2 << PRECISION) - 1);
                let offset = entry >> OFFSET_AT & ((1 << PRECISION) - 1);
                let mut state = frequency * (state >> PRECISION) + offset;
                if state < 1 << PRECISION {
                    let word = self
                        .bytes
                        .as_ptr()
                        .add(self.position.min(last))
                        .cast::<u16>();
                    state = state << 16 | u32::from(word.read_unaligned());
                    self.position += 2;
                }
                self.states[index % COUNT] = state;
                coefficients |= u64::from(entry >> COEFFICIENT_AT) << (8 * index);
            }
        }
        _mm256_cvtepi8_epi32(_mm_cvtsi64_si128(coefficients as i64))
    }
}
