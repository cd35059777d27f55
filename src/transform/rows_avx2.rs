//! The rows of a diamond in AVX2: where what sixteen centres are foreseen from is, and is kept.

use super::adaptive::{
    ACTIVITIES, Aim, Kernels, Neighbourhood, Outlook, ROW_RIM, UNIT_ACTIVITY, Vertices, Weights,
    Word,
};
use super::adaptive_avx2::{
    LANES, Shape, Totals, activities, around, context, features, load, packed, predict, round,
    shape, size, store_halves, sum,
};
use super::sight_avx2::look_around;
use std::arch::x86_64::*;

/// The vector functions, where the processor has them and rows are whole vectors.
pub(super) fn kernels(cells: usize) -> Option<Kernels<i16>> {
    let usable = cells.is_multiple_of(LANES) && std::arch::is_x86_feature_detected!("avx2");
    usable.then_some(Kernels {
        foresee: |neighbourhood, weights, aim, outlook| {
            let row = neighbourhood.row;
            let rows = Rows::of(neighbourhood, weights, outlook);
            // SAFETY: the processor has AVX2, and rows are whole vectors.
            unsafe { foresee(&rows, row, aim) };
        },
        // SAFETY: as above.
        complete: |neighbourhood, centres| unsafe { complete(neighbourhood, centres) },
        look_around: |neighbourhood, weights, sights| {
            let row = neighbourhood.row;
            let rows = Rows::to_look(neighbourhood, weights);
            // SAFETY: as above.
            unsafe { look_around(&rows, row, sights) };
        },
    })
}

/// Where the rows of a diamond are read and written. All but vertices and weights are of one row at a time, from
/// the first centre on, or from [`ROW_RIM`] zeros before it.
pub(crate) struct Rows<'a> {
    pub(super) cells: usize,
    pub(super) stride: usize,
    base: i32,
    pub(super) vertices: *const i16,
    /// Surprises, with a rim: those of the row before, and of the one before it.
    pub(super) newest: *mut i16,
    pub(super) older: *mut i16,
    /// The sizes of the newest, with a rim; for each centre the sum of three older ones.
    pub(super) sizes: *mut i16,
    pub(super) older_sizes: *mut i16,
    /// With a rim.
    pub(super) above: *mut i16,
    expected: *mut i16,
    /// With a rim.
    pub(super) companion: *const i16,
    contexts: *mut u8,
    predictions: *mut i32,
    fractions: *mut i32,
    pub(super) weights: &'a Weights,
}

/// Greatest number of centres in a row.
const LONGEST: usize = 128;
/// Words of a row with its rim and slack.
const ROW: usize = LONGEST + 2 * ROW_RIM + LANES;

/// Rows of a diamond whose sixteens are gone through one by one, the next ones being foreseen before the last
/// ones are complete: each row is written over the one before it.
pub(crate) struct Room {
    newest: [i16; ROW],
    older: [i16; ROW],
    sizes: [i16; ROW],
    older_sizes: [i16; ROW],
    above: [i16; ROW],
    expected: [i16; ROW],
    contexts: [u8; LONGEST],
    predictions: [i32; LONGEST],
}

impl Room {
    /// Before the first row.
    pub(crate) fn new() -> Room {
        Room {
            newest: [0; ROW],
            older: [0; ROW],
            sizes: [0; ROW],
            older_sizes: [0; ROW],
            above: [0; ROW],
            expected: [0; ROW],
            contexts: [0; LONGEST],
            predictions: [0; LONGEST],
        }
    }
}

/// Sixteen centres of a row.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub(super) is_first_row: bool,
    /// The first centre's column.
    pub(super) start: usize,
    /// Where the first of the 4 x 4 vertices around that centre is, among all words.
    pub(super) first: usize,
}

impl Place {
    /// The first ones.
    pub(crate) fn start() -> Place {
        Place {
            is_first_row: true,
            start: 0,
            first: 0,
        }
    }

    /// The ones after these.
    #[inline(always)]
    pub(crate) fn next(self, rows: &Rows) -> Place {
        let (start, first) = (self.start + LANES, self.first + LANES);
        if start < rows.cells {
            return Place {
                start,
                first,
                ..self
            };
        }
        Place {
            is_first_row: false,
            start: 0,
            first: first + rows.stride - rows.cells,
        }
    }
}

impl<'a> Rows<'a> {
    /// The row at hand of a neighbourhood.
    ///
    /// # Panics
    /// If rows are not whole vectors, or the outlook has no room for them.
    fn of(
        own: &'a mut Neighbourhood<i16>,
        weights: &'a Weights,
        outlook: &'a mut Outlook,
    ) -> Rows<'a> {
        let cells = own.cells;
        assert!(cells <= outlook.contexts.len());
        assert!(cells <= outlook.predictions.len() && cells <= outlook.fractions.len());
        Rows {
            contexts: outlook.contexts.as_mut_ptr(),
            predictions: outlook.predictions.as_mut_ptr(),
            fractions: outlook.fractions.as_mut_ptr(),
            ..Rows::to_look(own, weights)
        }
    }

    /// The row at hand of a neighbourhood, about which nothing is said.
    ///
    /// # Panics
    /// If rows are not whole vectors.
    fn to_look(own: &'a mut Neighbourhood<i16>, weights: &'a Weights) -> Rows<'a> {
        debug_assert_eq!(own.shift, 0);
        let cells = own.cells;
        assert!(cells.is_multiple_of(LANES));
        let [newest, older] = own.surprises.each_mut().map(|row| row.as_mut_ptr());
        Rows {
            cells,
            stride: own.stride,
            base: own.base,
            vertices: own.vertices.as_ptr(),
            newest,
            older,
            sizes: std::ptr::null_mut(),
            older_sizes: std::ptr::null_mut(),
            above: own.above.as_mut_ptr(),
            expected: own.expected.as_mut_ptr(),
            companion: own.companion.as_ptr(),
            contexts: std::ptr::null_mut(),
            predictions: std::ptr::null_mut(),
            fractions: std::ptr::null_mut(),
            weights,
        }
    }

    /// The rows of a diamond that nothing is a companion of.
    ///
    /// # Panics
    /// If rows are not whole vectors, or longer than 128.
    #[inline(always)]
    pub(crate) fn alone(
        vertices: Vertices<'a>,
        weights: &'a Weights,
        room: &'a mut Room,
    ) -> Rows<'a> {
        let Vertices {
            cells,
            stride,
            base,
            words,
        } = vertices;
        assert!(cells.is_multiple_of(LANES) && cells <= LONGEST);
        assert!(words.len() >= (cells + 3) * stride && stride >= cells + 3);
        Rows {
            cells,
            stride,
            base,
            vertices: words.as_ptr(),
            newest: room.newest.as_mut_ptr(),
            older: room.older.as_mut_ptr(),
            sizes: room.sizes.as_mut_ptr(),
            older_sizes: room.older_sizes.as_mut_ptr(),
            above: room.above.as_mut_ptr(),
            expected: room.expected.as_mut_ptr(),
            companion: std::ptr::null(),
            contexts: room.contexts.as_mut_ptr(),
            predictions: room.predictions.as_mut_ptr(),
            fractions: std::ptr::null_mut(),
            weights,
        }
    }

    /// The contexts of sixteen centres.
    ///
    /// # Safety
    /// The place is in the matrix.
    #[inline(always)]
    pub(crate) unsafe fn contexts(&self, at: Place) -> *const u8 {
        // SAFETY: the caller's.
        unsafe { self.contexts.add(at.start) }
    }

    /// The predictions of sixteen centres.
    ///
    /// # Safety
    /// The place is in the matrix.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(crate) unsafe fn predictions(&self, at: Place) -> [__m256i; 2] {
        // SAFETY: the caller's.
        unsafe {
            let pointer = self.predictions.add(at.start).cast::<__m256i>();
            [
                _mm256_loadu_si256(pointer),
                _mm256_loadu_si256(pointer.add(1)),
            ]
        }
    }

    /// What is known of sixteen centres, whose contexts it stores. `ALONE` says that the rows are alone; `CALLER`
    /// is a number of the place that calls: a function that is called from one place alone is part of it.
    ///
    /// # Safety
    /// The place is in the matrix.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(crate) unsafe fn look<const ALONE: bool, const CALLER: usize>(&self, at: Place) -> View {
        // SAFETY: the caller's.
        let (shape, activities) = unsafe {
            let around = around(self, at);
            let shape = shape(&around);
            let activities = activities::<ALONE>(self, &around, &shape, at);
            (shape, activities)
        };
        let weights = &self.weights.activity;
        let constant = UNIT_ACTIVITY * i32::from(weights[ACTIVITIES / 2 - 1][1]);
        let mut activity = Totals {
            low: _mm256_set1_epi32(constant),
            high: _mm256_set1_epi32(constant),
        };
        for ([one, other], weights) in activities.into_iter().zip(weights) {
            let pair = _mm256_set1_epi32(packed(*weights));
            activity.add(one, other, pair, pair);
        }
        if !ALONE {
            // SAFETY: the caller's; rows have a rim of two on either side and the slack.
            let beside = unsafe {
                let companion = |side: usize| load(self.companion.add(at.start + side));
                sum([companion(ROW_RIM - 1), companion(ROW_RIM + 1)])
            };
            let pair = _mm256_set1_epi32(packed([weights[ACTIVITIES / 2 - 1][0], 0]));
            activity.add(beside, _mm256_setzero_si256(), pair, pair);
        }
        let words = context(&activity, self.weights);
        let bytes = _mm256_permute4x64_epi64::<0b1000>(_mm256_packus_epi16(words, words));
        // SAFETY: the place is in the row.
        unsafe {
            let contexts = self.contexts.add(at.start);
            _mm_storeu_si128(contexts.cast(), _mm256_castsi256_si128(bytes));
        }
        View {
            shape,
            classes: _mm256_srli_epi16::<2>(words),
        }
    }

    /// Predicts sixteen centres that have been looked at.
    ///
    /// # Safety
    /// The place is in the matrix.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(crate) unsafe fn predict<const ALONE: bool, const CALLER: usize>(
        &self,
        at: Place,
        view: &View,
        aim: Aim,
    ) {
        let shape = &view.shape;
        // SAFETY: the caller's.
        let features = unsafe { features::<ALONE>(self, shape, at) };
        let total = predict(shape.order_two, &features, view.classes, self.weights, aim);
        let base = if aim == Aim::FineDetails {
            0
        } else {
            self.base
        };
        let [low, low_fractions] = round(total.low, base, aim);
        let [high, high_fractions] = round(total.high, base, aim);
        let expected = _mm256_adds_epi16(shape.order_two, shape.order_four);
        // SAFETY: the place is in the row.
        unsafe {
            store_halves(self.predictions.add(at.start), low, high);
            if aim != Aim::Centres {
                let fractions = self.fractions.add(at.start);
                store_halves(fractions, low_fractions, high_fractions);
            }
            _mm256_storeu_si256(self.expected.add(at.start).cast(), expected);
        }
    }

    /// Ends sixteen centres, which are known now, of rows that are alone.
    ///
    /// # Safety
    /// The place is in the matrix.
    #[inline]
    #[target_feature(enable = "avx2")]
    pub(crate) unsafe fn complete(&self, at: Place, centres: [__m256i; 2]) {
        // SAFETY: the caller's; rows have a rim of two and the slack.
        unsafe {
            let expected = load(self.expected.add(at.start));
            let (relative, surprise) = surprise(self.base, centres, expected);
            let from = at.start + ROW_RIM;
            _mm256_storeu_si256(self.above.add(from).cast(), relative);
            _mm256_storeu_si256(self.newest.add(from).cast(), surprise);
            _mm256_storeu_si256(self.sizes.add(from).cast(), size(surprise));
        }
    }
}

/// What is known of sixteen centres.
pub(crate) struct View {
    shape: Shape,
    /// Class of each in 16 bits.
    classes: __m256i,
}

/// Foresees a row of a neighbourhood.
///
/// # Safety
/// The processor has AVX2; the row is in the matrix.
#[target_feature(enable = "avx2")]
unsafe fn foresee(rows: &Rows, row: usize, aim: Aim) {
    for start in (0..rows.cells).step_by(LANES) {
        let at = Place {
            is_first_row: row == 0,
            start,
            first: row * rows.stride + start,
        };
        // SAFETY: `start` and fifteen more are centres of the row.
        unsafe {
            let view = rows.look::<false, 0>(at);
            rows.predict::<false, 0>(at, &view, aim);
        }
    }
}

/// # Safety
/// The processor has AVX2; rows are whole vectors.
#[target_feature(enable = "avx2")]
unsafe fn complete(own: &mut Neighbourhood<i16>, centres: &[i32]) {
    assert!(centres.len() == own.cells);
    own.surprises.swap(0, 1);
    for start in (0..own.cells).step_by(LANES) {
        // SAFETY: there are sixteen centres from `start` on; rows have a rim of two and the slack.
        unsafe {
            let pointer = centres.as_ptr().add(start).cast::<__m256i>();
            let centres = [
                _mm256_loadu_si256(pointer),
                _mm256_loadu_si256(pointer.add(1)),
            ];
            let expected = load(own.expected.as_ptr().add(start));
            let (relative, surprise) = surprise(own.base, centres, expected);
            let from = start + ROW_RIM;
            _mm256_storeu_si256(own.above.as_mut_ptr().add(from).cast(), relative);
            _mm256_storeu_si256(own.surprises[0].as_mut_ptr().add(from).cast(), surprise);
        }
    }
    own.row += 1;
}

/// Sixteen centres relative to the base, and by how much they missed order 4.
#[inline]
#[target_feature(enable = "avx2")]
fn surprise(base: i32, centres: [__m256i; 2], expected: __m256i) -> (__m256i, __m256i) {
    let reach = <i16 as Word>::REACH;
    // What lies beyond the reach need not be exact, only as far.
    let least = _mm256_set1_epi32(base.saturating_sub(reach));
    let greatest = _mm256_set1_epi32(base.saturating_add(reach));
    let base = _mm256_set1_epi32(base);
    let [first, second] = centres.map(|centres| {
        let held = _mm256_max_epi32(_mm256_min_epi32(centres, greatest), least);
        _mm256_sub_epi32(held, base)
    });
    let packed = _mm256_packs_epi32(first, second);
    let relative = _mm256_permute4x64_epi64::<0b11_01_10_00>(packed);
    let surprise = _mm256_subs_epi16(_mm256_slli_epi16::<2>(relative), expected);
    (relative, surprise)
}
