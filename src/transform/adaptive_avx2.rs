//! What is known of centres, and their predictions, in AVX2: sixteen at a time, with the results of the portable
//! functions, whose names and order these follow.

use super::adaptive::{ACTIVITIES, Aim, CONTEXTS, FEATURES, ROW_RIM, WEIGHT_BITS, Weights};
use super::rows_avx2::{Place, Rows};
use std::arch::x86_64::*;

/// Centres of a vector.
pub(super) const LANES: usize = 16;

/// A sum of products for each of sixteen centres: 0 to 3 and 8 to 11 in one half, the others in the other, as
/// unpacking leaves them.
#[derive(Clone, Copy)]
pub(super) struct Totals {
    pub low: __m256i,
    pub high: __m256i,
}

impl Totals {
    /// Adds two numbers of each centre, weighted by a pair of weights in each 32 bits.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(super) fn add(&mut self, one: __m256i, other: __m256i, low: __m256i, high: __m256i) {
        let pairs = _mm256_unpacklo_epi16(one, other);
        self.low = _mm256_add_epi32(self.low, _mm256_madd_epi16(pairs, low));
        let pairs = _mm256_unpackhi_epi16(one, other);
        self.high = _mm256_add_epi32(self.high, _mm256_madd_epi16(pairs, high));
    }
}

/// Sixteen words.
///
/// # Safety
/// They may be read.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn load(words: *const i16) -> __m256i {
    // SAFETY: the caller's.
    unsafe { _mm256_loadu_si256(words.cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn clamp(value: __m256i, low: __m256i, high: __m256i) -> __m256i {
    _mm256_max_epi16(_mm256_min_epi16(value, high), low)
}

/// Sizes up to 32767.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn size(value: __m256i) -> __m256i {
    _mm256_min_epu16(_mm256_abs_epi16(value), _mm256_set1_epi16(i16::MAX))
}

#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn sum<const COUNT: usize>(terms: [__m256i; COUNT]) -> __m256i {
    let mut sum = terms[0];
    for &term in &terms[1..] {
        sum = _mm256_adds_epi16(sum, term);
    }
    sum
}

/// The 4 x 4 vertices around sixteen centres, by row and column.
type Around = [[__m256i; 4]; 4];

/// What several numbers of sixteen centres have in common.
pub(super) struct Shape {
    pub order_two: __m256i,
    pub order_four: __m256i,
    beside: __m256i,
    above_below: __m256i,
    ring: __m256i,
    diagonal: __m256i,
}

#[inline]
#[target_feature(enable = "avx2")]
fn add(a: __m256i, b: __m256i) -> __m256i {
    _mm256_add_epi16(a, b)
}

#[inline]
#[target_feature(enable = "avx2")]
fn less(a: __m256i, b: __m256i) -> __m256i {
    _mm256_subs_epi16(a, b)
}

#[inline]
#[target_feature(enable = "avx2")]
fn min(a: __m256i, b: __m256i) -> __m256i {
    _mm256_min_epi16(a, b)
}

#[inline]
#[target_feature(enable = "avx2")]
fn max(a: __m256i, b: __m256i) -> __m256i {
    _mm256_max_epi16(a, b)
}

#[inline]
#[target_feature(enable = "avx2")]
fn four_times(a: __m256i) -> __m256i {
    _mm256_slli_epi16::<2>(a)
}

/// # Safety
/// The place is in the matrix.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn around(own: &Rows, at: Place) -> Around {
    let row = |j: usize| {
        // SAFETY: three rows of vertices after the row at hand and three columns after the centres are there,
        // and the slack.
        std::array::from_fn(|column| unsafe {
            load(own.vertices.add(at.first + j * own.stride + column))
        })
    };
    [row(0), row(1), row(2), row(3)]
}

#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn shape(around: &Around) -> Shape {
    let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = *around;
    let order_two = add(add(a, b), add(d, e));
    let beside = less(add(add(r, t), add(s, u)), order_two);
    let above_below = less(add(add(p, q), add(v, w)), order_two);
    let ring = _mm256_adds_epi16(beside, above_below);
    Shape {
        order_two,
        order_four: less(_mm256_setzero_si256(), _mm256_srai_epi16::<3>(ring)),
        beside,
        above_below,
        ring,
        diagonal: less(add(a, e), add(b, d)),
    }
}

/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn features<const ALONE: bool>(
    own: &Rows,
    shape: &Shape,
    at: Place,
) -> [[__m256i; 2]; FEATURES / 2] {
    let zero = _mm256_setzero_si256();
    // SAFETY: the caller's; rows have a rim of two on either side and the slack.
    let (around, missed, twice) = unsafe {
        let missed: [__m256i; 5] =
            std::array::from_fn(|back| load(own.newest.add(at.start + back)));
        let older = own.older.add(at.start + ROW_RIM);
        let twice = load(older);
        if ALONE {
            _mm256_storeu_si256(older.cast(), missed[2]);
        }
        (around(own, at), missed, twice)
    };
    let [[c1, _, _, c2], [_, a, b, _], [_, d, e, _], [c3, _, _, c4]] = around;
    let (order_two, order_four, diagonal) = (shape.order_two, shape.order_four, shape.diagonal);
    let (low, high) = (min(min(a, b), min(d, e)), max(max(a, b), max(d, e)));
    let lowest = less(four_times(low), order_two);
    let highest = less(four_times(high), order_two);
    let (step, followed) = if at.is_first_row {
        (zero, zero)
    } else {
        // SAFETY: rows have a rim of two on either side and the slack.
        let above = unsafe { load(own.above.add(at.start + ROW_RIM)) };
        let centre = less(four_times(above), order_two);
        let one = less(four_times(max(min(a, b), min(d, e))), order_two);
        let other = less(four_times(min(max(a, b), max(d, e))), order_two);
        let step = clamp(centre, min(one, other), max(one, other));
        (step, clamp(centre, lowest, highest))
    };
    let corners = less(add(add(c1, c2), add(c3, c4)), order_two);
    let outer_diagonal = less(add(c1, c4), add(c2, c3));
    let steepness = _mm256_abs_epi16(diagonal);
    let slopes = [less(a, e), less(b, d)].map(|slope| _mm256_abs_epi16(slope));
    let steadier = _mm256_sign_epi16(diagonal, less(slopes[1], slopes[0]));
    let middle = less(order_two, _mm256_slli_epi16::<1>(add(low, high)));
    let median = clamp(order_four, less(zero, steepness), steepness);
    let held = clamp(order_four, lowest, highest);
    [
        [shape.beside, shape.above_below],
        [corners, diagonal],
        [outer_diagonal, missed[1]],
        [missed[2], missed[3]],
        [twice, middle],
        [steadier, median],
        [held, step],
        [followed, _mm256_adds_epi16(missed[0], missed[4])],
    ]
}

/// The activities but for the last pair, which companions and the constant part are.
///
/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn activities<const ALONE: bool>(
    own: &Rows,
    around: &Around,
    shape: &Shape,
    at: Place,
) -> [[__m256i; 2]; ACTIVITIES / 2 - 1] {
    let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = *around;
    let rise = |a, b| _mm256_abs_epi16(less(a, b));
    let rises = sum([
        rise(a, r),
        rise(d, t),
        rise(b, s),
        rise(e, u),
        rise(a, p),
        rise(b, q),
        rise(d, v),
        rise(e, w),
    ]);
    // Four relative heights fit: no bend is -32768.
    let bend = |bend| _mm256_abs_epi16(bend);
    let bends = sum([
        bend(less(add(r, s), add(a, b))),
        bend(less(add(t, u), add(d, e))),
        bend(less(add(p, v), add(a, d))),
        bend(less(add(q, w), add(b, e))),
    ]);
    // SAFETY: the caller's; rows have a rim of two on either side and the slack.
    let [near, beside, far, companion] = unsafe {
        if ALONE {
            kept_misses(own, at)
        } else {
            misses(own, at)
        }
    };
    [
        [rise(a, e), rise(b, d)],
        [_mm256_abs_epi16(shape.diagonal), size(shape.ring)],
        [rises, bends],
        [near, beside],
        [far, companion],
    ]
}

/// By how much centres of the rows before missed order 4, without a sign: the one above, those beside that, and
/// farther ones; and the companion.
///
/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn misses(own: &Rows, at: Place) -> [__m256i; 4] {
    // SAFETY: the caller's; rows have a rim of two on either side and the slack.
    unsafe {
        let missed = |back: usize| size(load(own.newest.add(at.start + back)));
        let twice = |back: usize| size(load(own.older.add(at.start + back)));
        let far = sum([twice(2), twice(1), twice(3), missed(0), missed(4)]);
        let companion = load(own.companion.add(at.start + ROW_RIM));
        [missed(2), sum([missed(1), missed(3)]), far, companion]
    }
}

/// The same from the sizes that are kept, where nothing is a companion. Saturated sums of what is not negative
/// are the same in any order.
///
/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn kept_misses(own: &Rows, at: Place) -> [__m256i; 4] {
    // SAFETY: the caller's; rows have a rim of two on either side and the slack.
    unsafe {
        let missed = |back: usize| load(own.sizes.add(at.start + back));
        let older = own.older_sizes.add(at.start);
        let far = sum([missed(0), missed(4), load(older)]);
        let (near, beside) = (missed(2), sum([missed(1), missed(3)]));
        _mm256_storeu_si256(older.cast(), _mm256_adds_epi16(near, beside));
        [near, beside, far, _mm256_setzero_si256()]
    }
}

/// Predictions from a base, and what rounding takes from them, of eight totals.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn round(total: __m256i, base: i32, aim: Aim) -> [__m256i; 2] {
    let base = _mm256_set1_epi32(base);
    if aim == Aim::Centres {
        let offset = _mm256_srai_epi32::<{ WEIGHT_BITS as i32 + 2 }>(total);
        return [_mm256_add_epi32(base, offset), _mm256_setzero_si256()];
    }
    let fine = _mm256_srai_epi32::<2>(total);
    let half = _mm256_set1_epi32(1 << (WEIGHT_BITS - 1));
    let offset = _mm256_srai_epi32::<{ WEIGHT_BITS as i32 }>(_mm256_add_epi32(fine, half));
    let whole = _mm256_slli_epi32::<{ WEIGHT_BITS as i32 }>(offset);
    [
        _mm256_add_epi32(base, offset),
        _mm256_sub_epi32(fine, whole),
    ]
}

/// Sixteen numbers in order, from halves as unpacking leaves them.
///
/// # Safety
/// There is room for sixteen.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) unsafe fn store_halves(numbers: *mut i32, low: __m256i, high: __m256i) {
    // SAFETY: the caller's.
    unsafe {
        let first = _mm256_permute2x128_si256::<0x20>(low, high);
        _mm256_storeu_si256(numbers.cast(), first);
        let second = _mm256_permute2x128_si256::<0x31>(low, high);
        _mm256_storeu_si256(numbers.add(8).cast(), second);
    }
}

/// Two weights in 32 bits.
pub(super) fn packed([one, other]: [i16; 2]) -> i32 {
    i32::from(one as u16) | i32::from(other) << 16
}

/// Contexts of sixteen activities, in 16 bits.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn context(activity: &Totals, weights: &Weights) -> __m256i {
    // Those of activities that are not positive are below 0 until they are clamped.
    let [low, high] = [activity.low, activity.high].map(|activity| {
        let bits = _mm256_castps_si256(_mm256_cvtepi32_ps(activity));
        _mm256_srai_epi32::<21>(bits)
    });
    let first = _mm256_set1_epi16((4 * 127 + weights.first_context) as i16);
    let contexts = _mm256_sub_epi16(_mm256_packs_epi32(low, high), first);
    let last = _mm256_set1_epi16(CONTEXTS as i16 - 1);
    max(min(contexts, last), _mm256_setzero_si256())
}

/// Weighted features; for centres on top of the prediction by order 2, for rounded ones with half a unit.
#[inline]
#[target_feature(enable = "avx2")]
pub(super) fn predict(
    order_two: __m256i,
    features: &[[__m256i; 2]; 8],
    classes: __m256i,
    weights: &Weights,
    aim: Aim,
) -> Totals {
    // Of an index no more than the low three bits count.
    let low = _mm256_unpacklo_epi16(classes, classes);
    let high = _mm256_unpackhi_epi16(classes, classes);
    let mut total = Totals {
        low: _mm256_setzero_si256(),
        high: _mm256_setzero_si256(),
    };
    let unit = match aim {
        Aim::Centres => [1 << WEIGHT_BITS, 1 << (WEIGHT_BITS + 1)],
        Aim::FineCentres => [1 << WEIGHT_BITS, 0],
        Aim::FineDetails => [0, 0],
    };
    let unit = _mm256_set1_epi32(packed(unit));
    total.add(order_two, _mm256_set1_epi16(1), unit, unit);
    for ([one, other], weights) in features.iter().zip(&weights.prediction) {
        // SAFETY: eight pairs of 16 bits are 32 bytes.
        let table = unsafe { _mm256_loadu_si256(weights.as_ptr().cast()) };
        let low = _mm256_permutevar8x32_epi32(table, low);
        let high = _mm256_permutevar8x32_epi32(table, high);
        total.add(*one, *other, low, high);
    }
    total
}
