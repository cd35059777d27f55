//! Whole diamonds in AVX2: while symbols are decoded, which waits for memory most of the time, the centres after
//! theirs are foreseen.
//!
//! A centre is foreseen from the row above up to two columns on. With four sixteens in a row the last ones of the
//! row above have long been decoded when these are wanted.

use crate::entropy::rans::{Decoder, Lanes};
use crate::entropy::rans_avx2::Run;
use crate::entropy::token::LARGEST_SMALL;
use crate::transform::Quantiser;
use crate::transform::adaptive::{Aim, CONTEXTS, Vertices, Weights};
use crate::transform::rows_avx2::{Place, Room, Rows};
use std::arch::x86_64::*;

/// Centres that are decoded one after the other.
const UNIT: usize = 16;
/// Least number of cells that leaves time between centres and those that are foreseen from them.
const LEAST_CELLS: usize = 4 * UNIT;

/// Decodes the N^2 centres of a diamond, where it can be done here: all have coefficients, in contexts of the
/// first matrix, from the decoder's first symbol on, and the quantiser is plain.
pub(super) fn decode(
    vertices: Vertices,
    weights: &Weights,
    decoder: &mut Decoder,
    quantiser: &Quantiser,
    centres: &mut [i32],
) -> bool {
    let Some(lanes) = decoder.lanes() else {
        return false;
    };
    let cells = vertices.cells;
    if cells < LEAST_CELLS || !quantiser.is_plain() {
        return false;
    }
    assert!(lanes.has_contexts(CONTEXTS) && centres.len() == cells * cells);
    // SAFETY: a decoder gives its lanes where the processor has what they need; the assertion.
    unsafe {
        match lanes.count {
            8 => wave::<8>(vertices, weights, (decoder, lanes), quantiser, centres),
            4 => wave::<4>(vertices, weights, (decoder, lanes), quantiser, centres),
            _ => wave::<2>(vertices, weights, (decoder, lanes), quantiser, centres),
        }
    }
    true
}

/// # Safety
/// The processor has AVX2 and POPCNT; there are slots for all contexts, and as many centres as the vertices have
/// between them.
#[target_feature(enable = "avx2,popcnt")]
unsafe fn wave<const COUNT: usize>(
    vertices: Vertices,
    weights: &Weights,
    (decoder, mut lanes): (&mut Decoder, Lanes),
    quantiser: &Quantiser,
    centres: &mut [i32],
) {
    let mut run = Run::new(&lanes);
    let mut room = Room::new();
    let rows = Rows::alone(vertices, weights, &mut room);
    let mut at = Place::start();
    let last = centres.len() / UNIT - 1;
    // SAFETY: places are in the matrix; contexts are below [`CONTEXTS`].
    unsafe {
        let view = rows.look::<true, 0>(at);
        rows.predict::<true, 0>(at, &view, Aim::Centres);
        for (index, unit) in centres.chunks_exact_mut(UNIT).enumerate() {
            // After the last ones some are foreseen to no effect.
            let next = if index < last {
                at.next(&rows)
            } else {
                Place::start()
            };
            let contexts = rows.contexts(at);
            let first = run.eight::<COUNT, 1>(contexts);
            let view = rows.look::<true, COUNT>(next);
            let second = run.eight::<COUNT, 2>(contexts.add(8));
            rows.predict::<true, COUNT>(next, &view, Aim::Centres);
            let coefficients = store([first, second], decoder, unit);
            let heights = heights(rows.predictions(at), coefficients, quantiser, unit);
            rows.complete(at, heights);
            at = next;
        }
    }
    run.end::<COUNT>(&mut lanes);
    decoder.set_lanes(&lanes, centres.len());
}

/// Sixteen coefficients, with the raw bits of those that are not small.
///
/// # Safety
/// The processor has AVX2; the unit has sixteen entries.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn store(small: [__m256i; 2], decoder: &mut Decoder, unit: &mut [i32]) -> [__m256i; 2] {
    let sizes = _mm256_abs_epi16(_mm256_packs_epi32(small[0], small[1]));
    let raw = _mm256_cmpgt_epi16(sizes, _mm256_set1_epi16(LARGEST_SMALL as i16));
    if _mm256_testz_si256(raw, raw) != 0 {
        return small;
    }
    // SAFETY: the unit has sixteen entries.
    unsafe {
        let pointer = unit.as_mut_ptr().cast::<__m256i>();
        _mm256_storeu_si256(pointer, small[0]);
        _mm256_storeu_si256(pointer.add(1), small[1]);
        decoder.join_raw(unit);
        [
            _mm256_loadu_si256(pointer),
            _mm256_loadu_si256(pointer.add(1)),
        ]
    }
}

/// Stores the heights of sixteen centres, as [`Quantiser::reconstruct_row`] makes them.
///
/// # Safety
/// The processor has AVX2; the unit has sixteen entries.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn heights(
    predictions: [__m256i; 2],
    coefficients: [__m256i; 2],
    quantiser: &Quantiser,
    unit: &mut [i32],
) -> [__m256i; 2] {
    let step = _mm256_set1_epi32(quantiser.step());
    let [low, high] = quantiser.range().map(|end| _mm256_set1_epi32(end));
    let clamp = |value| _mm256_min_epi32(_mm256_max_epi32(value, low), high);
    let height = |place: usize| {
        let offset = _mm256_mullo_epi32(coefficients[place], step);
        clamp(_mm256_add_epi32(clamp(predictions[place]), offset))
    };
    let heights = [height(0), height(1)];
    // SAFETY: the unit has sixteen entries.
    unsafe {
        let pointer = unit.as_mut_ptr().cast::<__m256i>();
        _mm256_storeu_si256(pointer, heights[0]);
        _mm256_storeu_si256(pointer.add(1), heights[1]);
    }
    heights
}
