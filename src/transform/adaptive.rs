//! The trained predictor: a centre from its vertices and from the centres of the rows before.
//!
//! Centres are visited row by row. Everything about a row follows from the vertices and from rows that
//! are complete, so a whole row is computed at once, in vectors. From the same numbers comes the
//! activity of a centre, which tells how far its prediction may be off, and with it the context of its
//! entropy code.
//!
//! Heights are taken relative to the middle of the diamond's vertices and shifted down until they fit
//! a [`Word`]; with words of 16 bits the shift is 0 unless a diamond spans more than 16382 units.

pub use super::sight::Sight;
use crate::vectors::widened;

/// Numbers that a prediction is a weighted sum of.
pub const FEATURES: usize = 16;
/// Numbers that an activity is a weighted sum of.
pub const ACTIVITIES: usize = 12;
/// Components before that tell of one.
pub const COMPANIONS: usize = 2;
/// Bits after the binary point of a prediction's weight.
pub const WEIGHT_BITS: u32 = 10;
/// Classes of activity, each with weights of its own: one an octave.
pub const CLASSES: usize = 8;
/// Contexts that an activity is sorted into: four an octave.
pub const CONTEXTS: usize = 4 * CLASSES;

/// Trained numbers of the predictor, for the diamonds of some levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Weights {
    /// In 2^-10: entry `[f / 2][class][f % 2]` is that of feature f, since vectors multiply two at once.
    pub prediction: [[[i16; 2]; CLASSES]; FEATURES / 2],
    /// Of part p of the activity at `[p / 2][p % 2]`.
    pub activity: [[i16; 2]; ACTIVITIES / 2],
    /// Quarter octaves of activity below which the context is 0.
    pub first_context: i32,
    /// For each component before by how much its residual moves the prediction in each class, in 2^-10.
    pub companions: [[i16; CLASSES]; COMPANIONS],
}

impl Weights {
    /// Order 4 wherever it is, and contexts by the roughness around.
    pub fn fixed() -> Weights {
        let mut prediction = [[[0; 2]; CLASSES]; FEATURES / 2];
        prediction[0] = [[-(1 << (WEIGHT_BITS - 3)); 2]; CLASSES];
        let mut activity = [[16; 2]; ACTIVITIES / 2];
        activity[ACTIVITIES / 2 - 1][1] = 64;
        Weights {
            prediction,
            activity,
            first_context: 40,
            companions: [[0; CLASSES]; COMPANIONS],
        }
    }

    /// The quarter octave of 31 bits that an activity lies in.
    #[inline(always)]
    pub fn quarter(activity: i32) -> i32 {
        // A float's exponent and the upper bits of its mantissa.
        ((activity.max(1) as f32).to_bits() >> 21) as i32 - 4 * 127
    }

    /// Context of an activity: the quarter octave that it lies in, from the first one.
    #[inline(always)]
    pub fn context(&self, activity: i32) -> usize {
        (Self::quarter(activity) - self.first_context).clamp(0, CONTEXTS as i32 - 1) as usize
    }

    /// Class of a context.
    #[inline(always)]
    pub fn class(context: usize) -> usize {
        context / (CONTEXTS / CLASSES)
    }
}

/// Integers that a diamond's relative heights are kept in.
pub(super) trait Word: Copy + Default + Send + Sync + 'static {
    /// Largest magnitude of a relative height; four of them still fit.
    const REACH: i32;
    /// Largest magnitude of any number that is kept.
    const LIMIT: i32;
    /// From a number within the limit.
    fn narrow(value: i32) -> Self;
    /// As 32 bits.
    fn wide(self) -> i32;
    /// The low bits of a number that arithmetic on words leaves.
    fn wrap(value: i64) -> i64;
    /// Heights, all within reach when shifted, relative to a base.
    fn fill(base: i32, shift: u32, heights: &[i32], words: &mut [Self]);
    /// The words, if they have 16 bits.
    fn narrow_words(words: &[Self]) -> Option<&[i16]>;
    /// What does whole rows of so many cells at once, where the processor can.
    fn kernels(cells: usize) -> Option<Kernels<Self>>;
}

impl Word for i16 {
    const REACH: i32 = 8191;
    const LIMIT: i32 = 32767;
    #[inline(always)]
    fn narrow(value: i32) -> i16 {
        value as i16
    }
    #[inline(always)]
    fn wide(self) -> i32 {
        i32::from(self)
    }
    /// Sums are kept in 32 bits, as vectors keep them.
    #[inline(always)]
    fn wrap(value: i64) -> i64 {
        i64::from(value as i32)
    }
    fn fill(base: i32, _shift: u32, heights: &[i32], words: &mut [i16]) {
        subtract(base, heights, words);
    }
    fn narrow_words(words: &[i16]) -> Option<&[i16]> {
        Some(words)
    }
    #[cfg(target_arch = "x86_64")]
    fn kernels(cells: usize) -> Option<Kernels<i16>> {
        super::rows_avx2::kernels(cells)
    }
    #[cfg(not(target_arch = "x86_64"))]
    fn kernels(_cells: usize) -> Option<Kernels<i16>> {
        None
    }
}

impl Word for i32 {
    const REACH: i32 = (1 << 26) - 1;
    const LIMIT: i32 = (1 << 28) - 1;
    #[inline(always)]
    fn narrow(value: i32) -> i32 {
        value
    }
    #[inline(always)]
    fn wide(self) -> i32 {
        self
    }
    #[inline(always)]
    fn wrap(value: i64) -> i64 {
        value
    }
    fn fill(base: i32, shift: u32, heights: &[i32], words: &mut [i32]) {
        for (word, &height) in words.iter_mut().zip(heights) {
            *word = relative::<i32>(height, base, shift);
        }
    }
    fn narrow_words(_words: &[i32]) -> Option<&[i16]> {
        None
    }
    fn kernels(_cells: usize) -> Option<Kernels<i32>> {
        None
    }
}

/// What a row is foreseen for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Aim {
    /// Centres, rounded.
    Centres,
    /// Centres, with what rounding takes.
    FineCentres,
    /// By how much centres are higher than the mean of the 4 nearest vertices, with what rounding takes.
    FineDetails,
}

/// [`Surroundings::look_around`].
type LookAround<T> = fn(&mut Neighbourhood<T>, &Weights, &mut [(Sight, i32)]);

/// Functions that do a whole row at once, with the results of the portable ones.
#[derive(Clone, Copy)]
pub(super) struct Kernels<T> {
    /// [`Surroundings::foresee`] and, by its `aim`, [`Surroundings::foresee_finely`].
    pub foresee: fn(&mut Neighbourhood<T>, &Weights, Aim, &mut Outlook),
    /// [`Surroundings::complete`].
    pub complete: fn(&mut Neighbourhood<T>, &[i32]),
    /// [`Surroundings::look_around`].
    pub look_around: LookAround<T>,
}

/// To what a word keeps.
#[inline(always)]
pub(super) fn saturate<T: Word>(value: i32) -> i32 {
    value.clamp(-T::LIMIT - 1, T::LIMIT)
}

/// Rows and columns of copies around the vertices.
const RIM: usize = 1;
/// Zeros around a row of surprises.
pub(super) const ROW_RIM: usize = 2;

/// A diamond in the making: its vertices, and of the centres what the next row needs.
#[derive(Default)]
pub(super) struct Neighbourhood<T> {
    pub(super) cells: usize,
    /// Entries from one row of `vertices` to the next.
    pub(super) stride: usize,
    /// The height that a relative 0 stands for.
    pub(super) base: i32,
    pub(super) shift: u32,
    /// Relative vertices with a rim; vertex (i, j) at `(j + 1) * stride + i + 1`.
    pub(super) vertices: Vec<T>,
    /// Of the row before, and of the one before it: by how much each centre missed its prediction of
    /// order 4, in quarters; with a rim of zeros.
    pub(super) surprises: [Vec<T>; 2],
    /// Relative centres of the row before.
    pub(super) above: Vec<T>,
    /// Where order 4 expects the centres of the row at hand, in quarters of a shifted unit.
    pub(super) expected: Vec<T>,
    /// Activity of the same row in components that are known already, with a rim of zeros.
    pub(super) companion: Vec<T>,
    /// The row at hand.
    pub(super) row: usize,
    kernels: Option<Kernels<T>>,
}

widened! {
    /// Least and greatest of some heights; of none the greatest and least that there are.
    pub(crate) fn extremes(values: &[i32]) -> [i32; 2] {
        let (mut low, mut high) = (i32::MAX, i32::MIN);
        for &value in values {
            low = low.min(value);
            high = high.max(value);
        }
        [low, high]
    }
}

widened! {
    /// The low words of the distances of some heights from `base`, exact where they are within reach.
    fn subtract(base: i32, heights: &[i32], words: &mut [i16]) {
        for (word, &height) in words.iter_mut().zip(heights) {
            *word = height.wrapping_sub(base) as i16;
        }
    }
}

impl<T: Word> Neighbourhood<T> {
    /// Begins with the (N+1)^2 `vertices` of a diamond, whose least and greatest are given, at its first row of
    /// centres.
    fn start(&mut self, cells: usize, vertices: &[i32], [low, high]: [i32; 2], vectors: bool) {
        let span = i64::from(high) - i64::from(low);
        let fits = |shift: &u32| span >> shift <= 2 * i64::from(T::REACH);
        let side = cells + 1;
        self.base = ((i64::from(low) + i64::from(high)) >> 1) as i32;
        self.shift = (0..i32::BITS).find(fits).unwrap_or(0);
        self.row = 0;
        self.kernels = if vectors { T::kernels(cells) } else { None };
        if self.cells != cells {
            self.cells = cells;
            self.stride = side + 2 * RIM + VECTOR_SLACK;
            let all = (side + 2 * RIM) * self.stride + VECTOR_SLACK;
            self.vertices.resize(all, T::default());
        }
        let row = cells + 2 * ROW_RIM + VECTOR_SLACK;
        let [newest, older] = &mut self.surprises;
        for rows in [
            newest,
            older,
            &mut self.above,
            &mut self.companion,
            &mut self.expected,
        ] {
            rows.clear();
            rows.resize(row, T::default());
        }
        self.fill(vertices);
    }

    /// Places the vertices and copies the outermost into the rim.
    fn fill(&mut self, vertices: &[i32]) {
        let (stride, side) = (self.stride, self.cells + 1);
        for (j, row) in vertices.chunks_exact(side).enumerate() {
            let own = &mut self.vertices[(j + RIM) * stride..(j + RIM + 1) * stride];
            T::fill(self.base, self.shift, row, &mut own[RIM..]);
            own[0] = own[RIM];
            own[RIM + side] = own[side];
        }
        self.vertices.copy_within(stride..2 * stride, 0);
        self.vertices
            .copy_within(side * stride..(side + 1) * stride, (side + 1) * stride);
    }
}

/// What is known of a row before it is coded.
#[derive(Clone, Debug, Default)]
pub struct Outlook {
    /// Context of each centre.
    pub contexts: Vec<u8>,
    /// Predicted heights, not yet clamped to any range.
    pub predictions: Vec<i32>,
    /// What rounding took from each prediction that was made finely, in units times 2^10: -512 to 511.
    pub fractions: Vec<i32>,
}

impl Outlook {
    /// Makes room for rows of `cells` centres.
    pub fn fit(&mut self, cells: usize) {
        self.contexts.resize(cells, 0);
        self.predictions.resize(cells, 0);
        self.fractions.resize(cells, 0);
    }
}

/// A diamond whose rows are gone through from the first to the last: each is foreseen, coded by the caller,
/// and completed.
pub trait Surroundings {
    /// Contexts and predictions of the row at hand.
    fn foresee(&mut self, weights: &Weights, outlook: &mut Outlook);

    /// Contexts and predictions of the row at hand, with what rounding takes from these; with `details` not of
    /// the centres, but of how much higher they are than the mean of the 4 nearest vertices.
    fn foresee_finely(&mut self, weights: &Weights, details: bool, outlook: &mut Outlook);

    /// Contexts of the row at hand, for coefficients whose predictions are made elsewhere.
    fn foresee_contexts(&mut self, weights: &Weights, outlook: &mut Outlook);

    /// Ends a row whose centres were foreseen and are known now.
    fn complete(&mut self, centres: &[i32]);

    /// Ends a row of coefficients, each worth `step` units.
    fn complete_coefficients(&mut self, coefficients: &[i32], step: i32);

    /// Tells of the coefficients at the same place in a matrix that is known, each worth `step` units.
    fn accompany(&mut self, coefficients: &[i32], step: i32);

    /// What is known of the centres of the row at hand, and their activity.
    fn look_around(&mut self, weights: &Weights, sights: &mut [(Sight, i32)]);

    /// What turns heights into quarters of a shifted unit, as sights are.
    fn quarters(&self) -> Quarters;

    /// The vertices in 16 bits, where vectors may go through the diamond.
    fn vertices(&self) -> Option<Vertices<'_>>;
}

/// The height of which a diamond's sights are relative, and what a unit is in their numbers: a power of two.
#[derive(Clone, Copy, Debug)]
pub struct Quarters {
    base: f64,
    /// Quarters of a shifted unit.
    pub unit: f64,
}

impl Quarters {
    /// A height in quarters of a shifted unit.
    #[inline(always)]
    pub fn of(self, height: i32) -> f64 {
        (f64::from(height) - self.base) * self.unit
    }
}

/// The vertices of a diamond in 16 bits, with a rim.
#[derive(Clone, Copy, Debug)]
pub struct Vertices<'a> {
    /// Cells along a side.
    pub cells: usize,
    /// Words from one row to the next.
    pub stride: usize,
    /// The height that a word 0 stands for.
    pub base: i32,
    /// Vertex (i, j) at `(j + 1) * stride + i + 1`; after the last row is the slack.
    pub words: &'a [i16],
}

/// Room for a diamond at a time.
#[derive(Default)]
pub struct Workspace {
    narrow: Neighbourhood<i16>,
    wide: Neighbourhood<i32>,
}

impl Workspace {
    /// The surroundings of the N^2 centres of a diamond with these (N+1)^2 vertices. `vectors` allows what
    /// the processor has, to the same result.
    pub fn start(
        &mut self,
        cells: usize,
        vertices: &[i32],
        vectors: bool,
    ) -> &mut dyn Surroundings {
        let [low, high] = extremes(vertices);
        if i64::from(high) - i64::from(low) > 2 * i64::from(i16::REACH) {
            self.wide.start(cells, vertices, [low, high], vectors);
            return &mut self.wide;
        }
        self.narrow.start(cells, vertices, [low, high], vectors);
        &mut self.narrow
    }
}

impl<T: Word> Surroundings for Neighbourhood<T> {
    fn foresee(&mut self, weights: &Weights, outlook: &mut Outlook) {
        assert!(self.row < self.cells, "a row after the last");
        if let Some(kernels) = self.kernels {
            return (kernels.foresee)(self, weights, Aim::Centres, outlook);
        }
        for i in 0..self.cells {
            let sight = self.look(i);
            let context = weights.context(sight.activity::<T>(weights));
            let start = (i64::from(sight.order_two) << WEIGHT_BITS) + (1 << (WEIGHT_BITS + 1));
            let total = start + sight.correction(weights, Weights::class(context));
            let offset = T::wrap(total) >> (WEIGHT_BITS + 2) << self.shift;
            outlook.contexts[i] = context as u8;
            outlook.predictions[i] = (i64::from(self.base) + offset) as i32;
            self.expected[i] = T::narrow(saturate::<T>(sight.order_two + sight.order_four));
        }
    }

    fn foresee_finely(&mut self, weights: &Weights, details: bool, outlook: &mut Outlook) {
        assert!(self.row < self.cells, "a row after the last");
        if let Some(kernels) = self.kernels {
            let aim = if details {
                Aim::FineDetails
            } else {
                Aim::FineCentres
            };
            return (kernels.foresee)(self, weights, aim, outlook);
        }
        for i in 0..self.cells {
            let sight = self.look(i);
            let context = weights.context(sight.activity::<T>(weights));
            let correction = sight.correction(weights, Weights::class(context));
            let (from, base) = match details {
                true => (0, 0),
                false => (i64::from(sight.order_two) << WEIGHT_BITS, self.base),
            };
            let fine = (T::wrap(from + correction) << self.shift) >> 2;
            let half = 1 << (WEIGHT_BITS - 1);
            let offset = (fine + half) >> WEIGHT_BITS;
            let prediction = i64::from(base) + offset;
            outlook.contexts[i] = context as u8;
            outlook.predictions[i] =
                prediction.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
            outlook.fractions[i] = (fine - (offset << WEIGHT_BITS)) as i32;
            self.expected[i] = T::narrow(saturate::<T>(sight.order_two + sight.order_four));
        }
    }

    fn foresee_contexts(&mut self, weights: &Weights, outlook: &mut Outlook) {
        assert!(self.row < self.cells, "a row after the last");
        if let Some(kernels) = self.kernels {
            return (kernels.foresee)(self, weights, Aim::Centres, outlook);
        }
        for (i, context) in outlook.contexts.iter_mut().enumerate() {
            *context = weights.context(self.look(i).activity::<T>(weights)) as u8;
        }
    }

    fn complete(&mut self, centres: &[i32]) {
        if let Some(kernels) = self.kernels {
            return (kernels.complete)(self, centres);
        }
        let ([newest, older], above) = (&mut self.surprises, &mut self.above);
        std::mem::swap(newest, older);
        let (base, shift) = (self.base, self.shift);
        for (i, &centre) in centres.iter().enumerate() {
            let relative = relative::<T>(centre, base, shift);
            above[i + ROW_RIM] = T::narrow(relative);
            let surprise = 4 * relative - self.expected[i].wide();
            newest[i + ROW_RIM] = T::narrow(saturate::<T>(surprise));
        }
        self.row += 1;
    }

    fn complete_coefficients(&mut self, coefficients: &[i32], step: i32) {
        let [newest, older] = &mut self.surprises;
        std::mem::swap(newest, older);
        let shift = self.shift;
        for (i, &coefficient) in coefficients.iter().enumerate() {
            newest[i + ROW_RIM] = T::narrow(residual::<T>(coefficient, step, shift));
        }
        self.row += 1;
    }

    fn accompany(&mut self, coefficients: &[i32], step: i32) {
        let shift = self.shift;
        for (i, &coefficient) in coefficients.iter().enumerate() {
            let size = residual::<T>(coefficient, step, shift).abs();
            self.companion[i + ROW_RIM] = T::narrow(size);
        }
    }

    fn look_around(&mut self, weights: &Weights, sights: &mut [(Sight, i32)]) {
        assert!(self.row < self.cells, "a row after the last");
        if let Some(kernels) = self.kernels {
            return (kernels.look_around)(self, weights, sights);
        }
        for (i, (sight, activity)) in sights.iter_mut().enumerate() {
            *sight = self.look(i);
            *activity = sight.activity::<T>(weights);
        }
    }

    fn vertices(&self) -> Option<Vertices<'_>> {
        self.kernels?;
        Some(Vertices {
            cells: self.cells,
            stride: self.stride,
            base: self.base,
            words: T::narrow_words(&self.vertices)?,
        })
    }

    fn quarters(&self) -> Quarters {
        Quarters {
            base: f64::from(self.base),
            unit: 4.0 / (1u64 << self.shift) as f64,
        }
    }
}

/// A coefficient in quarters of a shifted unit.
#[inline(always)]
fn residual<T: Word>(coefficient: i32, step: i32, shift: u32) -> i32 {
    let residual = (4 * i64::from(coefficient) * i64::from(step)) >> shift;
    residual.clamp(-i64::from(T::LIMIT), i64::from(T::LIMIT)) as i32
}

/// A height relative to the base, within reach.
#[inline(always)]
fn relative<T: Word>(height: i32, base: i32, shift: u32) -> i32 {
    let offset = (i64::from(height) - i64::from(base)) >> shift;
    offset.clamp(-i64::from(T::REACH), i64::from(T::REACH)) as i32
}

/// The constant part of an activity.
pub(super) const UNIT_ACTIVITY: i32 = 16;
/// Entries that vectors may read or write beyond the last one that counts.
pub(super) const VECTOR_SLACK: usize = 16;
