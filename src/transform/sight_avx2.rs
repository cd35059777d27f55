//! What is known of the centres of a row, each centre's numbers together, in AVX2.

use super::adaptive::{ACTIVITIES, FEATURES, ROW_RIM, Sight, UNIT_ACTIVITY};
use super::adaptive_avx2::{
    LANES, Totals, activities, around, features, load, packed, shape, store_halves, sum,
};
use super::rows_avx2::{Place, Rows};
use std::arch::x86_64::*;

/// `Neighbourhood::look` of every centre of a row, and its activity by the weights.
///
/// # Safety
/// The processor has AVX2; the row is in the matrix.
///
/// # Panics
/// If there is no room for all centres.
#[target_feature(enable = "avx2")]
pub(super) unsafe fn look_around(rows: &Rows, row: usize, sights: &mut [(Sight, i32)]) {
    for (number, sights) in sights[..rows.cells].chunks_exact_mut(LANES).enumerate() {
        let start = number * LANES;
        let at = Place {
            is_first_row: row == 0,
            start,
            first: row * rows.stride + start,
        };
        // SAFETY: `start` and fifteen more are centres of the row, which has a rim of two and the slack.
        let (shape, features, known, beside) = unsafe {
            let around = around(rows, at);
            let shape = shape(&around);
            let features = features::<false>(rows, &shape, at);
            let known = activities::<false>(rows, &around, &shape, at);
            let companion = |side: usize| load(rows.companion.add(at.start + side));
            let beside = sum([companion(ROW_RIM - 1), companion(ROW_RIM + 1)]);
            (shape, features, known, beside)
        };
        let zero = _mm256_setzero_si256();
        let mut parts = [zero; LANES];
        for (parts, known) in parts.as_chunks_mut::<2>().0.iter_mut().zip(known) {
            *parts = known;
        }
        parts[ACTIVITIES - 2] = beside;
        parts[ACTIVITIES - 1] = _mm256_set1_epi16(UNIT_ACTIVITY as i16);
        let totals = activity(rows, &parts);
        let order_two = words(shape.order_two);
        let order_four = words(shape.order_four);
        for (i, (sight, own)) in sights.iter_mut().enumerate() {
            sight.order_two = i32::from(order_two[i]);
            sight.order_four = i32::from(order_four[i]);
            *own = totals[i].max(0);
        }
        let features = features.as_flattened();
        for half in [0, 8] {
            let by_centre = transpose(std::array::from_fn(|place| features[half + place]));
            for ((sight, _), eight) in sights.iter_mut().zip(by_centre) {
                sight.features[half..half + 8].copy_from_slice(&eight);
            }
            let by_centre = transpose(std::array::from_fn(|place| parts[half + place]));
            for ((sight, _), eight) in sights.iter_mut().zip(by_centre) {
                let own = &mut sight.activities[half..(half + 8).min(ACTIVITIES)];
                own.copy_from_slice(&eight[..own.len()]);
            }
        }
    }
}

/// The weighted sums of the parts of sixteen activities, wrapping.
#[inline]
#[target_feature(enable = "avx2")]
fn activity(rows: &Rows, parts: &[__m256i; LANES]) -> [i32; LANES] {
    let mut activity = Totals {
        low: _mm256_setzero_si256(),
        high: _mm256_setzero_si256(),
    };
    let pairs = parts.as_chunks::<2>().0.iter();
    for ([one, other], weights) in pairs.zip(&rows.weights.activity) {
        let pair = _mm256_set1_epi32(packed(*weights));
        activity.add(*one, *other, pair, pair);
    }
    let mut totals = [0; LANES];
    // SAFETY: there is room for sixteen.
    unsafe { store_halves(totals.as_mut_ptr(), activity.low, activity.high) };
    totals
}

#[inline]
#[target_feature(enable = "avx2")]
fn words(vector: __m256i) -> [i16; LANES] {
    let mut words = [0; LANES];
    // SAFETY: sixteen words are 32 bytes.
    unsafe { _mm256_storeu_si256(words.as_mut_ptr().cast(), vector) };
    words
}

/// Eight numbers of each of sixteen centres, from vectors of one number each.
#[inline]
#[target_feature(enable = "avx2")]
fn transpose(numbers: [__m256i; FEATURES / 2]) -> [[i32; 8]; LANES] {
    let [a, b, c, d, e, f, g, h] = numbers;
    let pairs = |one, other| {
        [
            _mm256_unpacklo_epi16(one, other),
            _mm256_unpackhi_epi16(one, other),
        ]
    };
    let fours = |one, other| {
        [
            _mm256_unpacklo_epi32(one, other),
            _mm256_unpackhi_epi32(one, other),
        ]
    };
    let [ab, cd, ef, gh] = [pairs(a, b), pairs(c, d), pairs(e, f), pairs(g, h)];
    let mut all = [[0; 8]; LANES];
    for quarter in 0..2 {
        let first = fours(ab[quarter], cd[quarter]);
        let second = fours(ef[quarter], gh[quarter]);
        for half in 0..2 {
            let eights = [
                _mm256_unpacklo_epi64(first[half], second[half]),
                _mm256_unpackhi_epi64(first[half], second[half]),
            ];
            for (place, eight) in eights.into_iter().enumerate() {
                // The lower halves are of the first eight centres.
                let centre = 4 * quarter + 2 * half + place;
                let low = _mm256_cvtepi16_epi32(_mm256_castsi256_si128(eight));
                let high = _mm256_cvtepi16_epi32(_mm256_extracti128_si256::<1>(eight));
                // SAFETY: eight numbers are 32 bytes.
                unsafe {
                    _mm256_storeu_si256(all[centre].as_mut_ptr().cast(), low);
                    _mm256_storeu_si256(all[centre + 8].as_mut_ptr().cast(), high);
                }
            }
        }
    }
    all
}
