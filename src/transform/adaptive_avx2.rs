//! The rows of [`Neighbourhood`] in AVX2: sixteen centres at a time, with the results of the portable
//! functions, whose names and order these follow.

use super::adaptive::{
    ACTIVITIES, Aim, FEATURES, Kernels, Neighbourhood, Outlook, ROW_RIM, UNIT_ACTIVITY,
    WEIGHT_BITS, Weights, Word,
};
use std::arch::x86_64::*;

/// The vector functions, where the processor has them and rows are whole vectors.
pub(super) fn kernels(cells: usize) -> Option<Kernels<i16>> {
    let usable = cells.is_multiple_of(LANES) && std::arch::is_x86_feature_detected!("avx2");
    usable.then_some(Kernels {
        // SAFETY: the processor has AVX2, and rows are whole vectors.
        foresee: |neighbourhood, weights, aim, outlook| unsafe {
            foresee(neighbourhood, weights, aim, outlook);
        },
        // SAFETY: as above.
        complete: |neighbourhood, centres| unsafe { complete(neighbourhood, centres) },
    })
}

/// Centres of a vector.
const LANES: usize = 16;

/// A sum of products for each of sixteen centres: 0 to 3 and 8 to 11 in one half, the others in the other, as
/// unpacking leaves them.
#[derive(Clone, Copy)]
struct Totals {
    low: __m256i,
    high: __m256i,
}

impl Totals {
    /// Adds two numbers of each centre, weighted by a pair of weights in each 32 bits.
    #[inline]
    #[target_feature(enable = "avx2")]
    fn add(&mut self, one: __m256i, other: __m256i, low: __m256i, high: __m256i) {
        let pairs = _mm256_unpacklo_epi16(one, other);
        self.low = _mm256_add_epi32(self.low, _mm256_madd_epi16(pairs, low));
        let pairs = _mm256_unpackhi_epi16(one, other);
        self.high = _mm256_add_epi32(self.high, _mm256_madd_epi16(pairs, high));
    }
}

/// Sixteen words from a slice on.
///
/// # Safety
/// The slice has sixteen entries from `at` on.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load(words: &[i16], at: usize) -> __m256i {
    debug_assert!(at + LANES <= words.len());
    // SAFETY: the caller's.
    unsafe { _mm256_loadu_si256(words.as_ptr().add(at).cast()) }
}

#[inline]
#[target_feature(enable = "avx2")]
fn clamp(value: __m256i, low: __m256i, high: __m256i) -> __m256i {
    _mm256_max_epi16(_mm256_min_epi16(value, high), low)
}

/// Sizes up to 32767.
#[inline]
#[target_feature(enable = "avx2")]
fn size(value: __m256i) -> __m256i {
    _mm256_min_epu16(_mm256_abs_epi16(value), _mm256_set1_epi16(i16::MAX))
}

#[inline]
#[target_feature(enable = "avx2")]
fn sum<const COUNT: usize>(terms: [__m256i; COUNT]) -> __m256i {
    let mut sum = terms[0];
    for &term in &terms[1..] {
        sum = _mm256_adds_epi16(sum, term);
    }
    sum
}

/// # Safety
/// The processor has AVX2; the cells are a multiple of sixteen, the outlook's rows as long.
#[target_feature(enable = "avx2")]
unsafe fn foresee(
    neighbourhood: &mut Neighbourhood<i16>,
    weights: &Weights,
    aim: Aim,
    outlook: &mut Outlook,
) {
    debug_assert_eq!(neighbourhood.shift, 0);
    for start in (0..neighbourhood.cells).step_by(LANES) {
        // SAFETY: `start` and fifteen more are centres of the row.
        unsafe { foresee_vector(neighbourhood, weights, aim, outlook, start) };
    }
}

/// The 4 x 4 vertices around sixteen centres, by row and column, and what several numbers have in common.
struct Around {
    vertices: [[__m256i; 4]; 4],
    order_two: __m256i,
    order_four: __m256i,
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
/// `start` and fifteen more are centres of the row at hand.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn around(own: &Neighbourhood<i16>, start: usize) -> Around {
    let row = |j: usize| {
        let first = (own.row + j) * own.stride + start;
        // SAFETY: three rows of vertices after the row at hand and three columns after the centres are there,
        // and the slack.
        std::array::from_fn(|column| unsafe { load(&own.vertices, first + column) })
    };
    let vertices: [[__m256i; 4]; 4] = [row(0), row(1), row(2), row(3)];
    let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = vertices;
    let order_two = add(add(a, b), add(d, e));
    let beside = less(add(add(r, t), add(s, u)), order_two);
    let above_below = less(add(add(p, q), add(v, w)), order_two);
    let ring = _mm256_adds_epi16(beside, above_below);
    Around {
        vertices,
        order_two,
        order_four: less(_mm256_setzero_si256(), _mm256_srai_epi16::<3>(ring)),
        beside,
        above_below,
        ring,
        diagonal: less(add(a, e), add(b, d)),
    }
}

/// Of the rows before, by how much centres missed order 4: `[0][n]` of the last row n - 2 columns on.
type Missed = [[__m256i; 5]; 2];

/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn features(
    own: &Neighbourhood<i16>,
    around: &Around,
    [missed, twice]: &Missed,
    start: usize,
) -> [[__m256i; 2]; FEATURES / 2] {
    let zero = _mm256_setzero_si256();
    let [[c1, _, _, c2], [_, a, b, _], [_, d, e, _], [c3, _, _, c4]] = around.vertices;
    let (order_two, order_four, diagonal) = (around.order_two, around.order_four, around.diagonal);
    let (low, high) = (min(min(a, b), min(d, e)), max(max(a, b), max(d, e)));
    let lowest = less(four_times(low), order_two);
    let highest = less(four_times(high), order_two);
    let (step, followed) = if own.row == 0 {
        (zero, zero)
    } else {
        // SAFETY: rows have a rim of two on either side and the slack.
        let above = unsafe { load(&own.above, start + ROW_RIM) };
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
        [around.beside, around.above_below],
        [corners, diagonal],
        [outer_diagonal, missed[1]],
        [missed[2], missed[3]],
        [twice[2], middle],
        [steadier, median],
        [held, step],
        [followed, _mm256_adds_epi16(missed[0], missed[4])],
    ]
}

/// # Safety
/// As [`around`].
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn activities(
    own: &Neighbourhood<i16>,
    around: &Around,
    [missed, twice]: &Missed,
    start: usize,
) -> [[__m256i; 2]; ACTIVITIES / 2] {
    let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = around.vertices;
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
    let bends = sum([
        size(less(add(r, s), add(a, b))),
        size(less(add(t, u), add(d, e))),
        size(less(add(p, v), add(a, d))),
        size(less(add(q, w), add(b, e))),
    ]);
    let sizes = missed.map(|missed| size(missed));
    let far = sum([
        size(twice[2]),
        size(twice[1]),
        size(twice[3]),
        sizes[0],
        sizes[4],
    ]);
    // SAFETY: rows have a rim of two on either side and the slack.
    let companion = |side: usize| unsafe { load(&own.companion, start + side) };
    let companions = _mm256_adds_epi16(companion(ROW_RIM - 1), companion(ROW_RIM + 1));
    [
        [rise(a, e), rise(b, d)],
        [_mm256_abs_epi16(around.diagonal), size(around.ring)],
        [rises, bends],
        [sizes[2], _mm256_adds_epi16(sizes[1], sizes[3])],
        [far, companion(ROW_RIM)],
        [companions, _mm256_set1_epi16(UNIT_ACTIVITY as i16)],
    ]
}

/// Foresees sixteen centres.
///
/// # Safety
/// As [`foresee`]; `start` and fifteen more are centres of the row at hand.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn foresee_vector(
    own: &mut Neighbourhood<i16>,
    weights: &Weights,
    aim: Aim,
    outlook: &mut Outlook,
    start: usize,
) {
    // SAFETY: the caller's; rows have a rim of two on either side and the slack.
    let (around, features, activities) = unsafe {
        let around = around(own, start);
        let [before, before_that] = &own.surprises;
        let missed = [
            std::array::from_fn(|back| load(before, start + back)),
            std::array::from_fn(|back| load(before_that, start + back)),
        ];
        let features = features(own, &around, &missed, start);
        let activities = activities(own, &around, &missed, start);
        (around, features, activities)
    };
    let mut activity = Totals {
        low: _mm256_setzero_si256(),
        high: _mm256_setzero_si256(),
    };
    for ([one, other], weights) in activities.into_iter().zip(&weights.activity) {
        let pair = _mm256_set1_epi32(packed(*weights));
        activity.add(one, other, pair, pair);
    }
    let contexts = [activity.low, activity.high].map(|activity| context(activity, weights));
    let total = predict(around.order_two, &features, &contexts, weights, aim);
    let base = if aim == Aim::FineDetails { 0 } else { own.base };
    let [low, low_fractions] = round(total.low, base, aim);
    let [high, high_fractions] = round(total.high, base, aim);
    let expected = _mm256_adds_epi16(around.order_two, around.order_four);
    let bytes = _mm256_packs_epi32(contexts[0], contexts[1]);
    let bytes = _mm256_permute4x64_epi64::<0b1000>(_mm256_packus_epi16(bytes, bytes));
    let end = start + LANES;
    assert!(end <= outlook.contexts.len() && end <= outlook.predictions.len());
    assert!(end <= outlook.fractions.len());
    // SAFETY: the rows have sixteen entries from `start` on: the assertions, and the slack of `expected`.
    unsafe {
        store_halves(outlook.predictions.as_mut_ptr().add(start), low, high);
        if aim != Aim::Centres {
            let fractions = outlook.fractions.as_mut_ptr().add(start);
            store_halves(fractions, low_fractions, high_fractions);
        }
        let contexts = outlook.contexts.as_mut_ptr().add(start);
        _mm_storeu_si128(contexts.cast(), _mm256_castsi256_si128(bytes));
        _mm256_storeu_si256(own.expected.as_mut_ptr().add(start).cast(), expected);
    }
}

/// Predictions from a base, and what rounding takes from them, of eight totals.
#[inline]
#[target_feature(enable = "avx2")]
fn round(total: __m256i, base: i32, aim: Aim) -> [__m256i; 2] {
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
unsafe fn store_halves(numbers: *mut i32, low: __m256i, high: __m256i) {
    // SAFETY: the caller's.
    unsafe {
        let first = _mm256_permute2x128_si256::<0x20>(low, high);
        _mm256_storeu_si256(numbers.cast(), first);
        let second = _mm256_permute2x128_si256::<0x31>(low, high);
        _mm256_storeu_si256(numbers.add(8).cast(), second);
    }
}

/// Two weights in 32 bits.
fn packed([one, other]: [i16; 2]) -> i32 {
    i32::from(one as u16) | i32::from(other) << 16
}

/// Contexts of eight activities.
#[inline]
#[target_feature(enable = "avx2")]
fn context(activity: __m256i, weights: &Weights) -> __m256i {
    let positive = _mm256_max_epi32(activity, _mm256_set1_epi32(1));
    let bits = _mm256_castps_si256(_mm256_cvtepi32_ps(positive));
    let first = _mm256_set1_epi32(4 * 127 + weights.first_context);
    let context = _mm256_sub_epi32(_mm256_srli_epi32::<21>(bits), first);
    let last = _mm256_set1_epi32(super::adaptive::CONTEXTS as i32 - 1);
    _mm256_max_epi32(_mm256_min_epi32(context, last), _mm256_setzero_si256())
}

/// Weighted features; for centres on top of the prediction by order 2, for rounded ones with half a unit.
#[inline]
#[target_feature(enable = "avx2")]
fn predict(
    order_two: __m256i,
    features: &[[__m256i; 2]; 8],
    contexts: &[__m256i; 2],
    weights: &Weights,
    aim: Aim,
) -> Totals {
    let [low, high] = contexts.map(|contexts| _mm256_srli_epi32::<2>(contexts));
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

/// # Safety
/// As [`foresee`]; there are as many centres as cells.
#[target_feature(enable = "avx2")]
unsafe fn complete(own: &mut Neighbourhood<i16>, centres: &[i32]) {
    assert!(centres.len() == own.cells);
    own.surprises.swap(0, 1);
    let reach = <i16 as Word>::REACH;
    // What lies beyond the reach need not be exact, only as far.
    let least = _mm256_set1_epi32(own.base.saturating_sub(reach));
    let greatest = _mm256_set1_epi32(own.base.saturating_add(reach));
    let base = _mm256_set1_epi32(own.base);
    let near = |centres: __m256i| {
        let held = _mm256_max_epi32(_mm256_min_epi32(centres, greatest), least);
        _mm256_sub_epi32(held, base)
    };
    for start in (0..own.cells).step_by(LANES) {
        // SAFETY: there are sixteen centres from `start` on; rows have a rim of two and the slack.
        unsafe {
            let pointer = centres.as_ptr().add(start);
            let first = near(_mm256_loadu_si256(pointer.cast()));
            let second = near(_mm256_loadu_si256(pointer.add(8).cast()));
            let packed = _mm256_packs_epi32(first, second);
            let relative = _mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
            let above = own.above.as_mut_ptr().add(start + ROW_RIM);
            _mm256_storeu_si256(above.cast(), relative);
            let expected = load(&own.expected, start);
            let surprise = _mm256_subs_epi16(_mm256_slli_epi16::<2>(relative), expected);
            let newest = own.surprises[0].as_mut_ptr().add(start + ROW_RIM);
            _mm256_storeu_si256(newest.cast(), surprise);
        }
    }
    own.row += 1;
}
