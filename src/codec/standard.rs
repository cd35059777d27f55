//! The standard model: weights and tables for diamonds that no model was trained on.
//!
//! The weights were trained once, on the rasters of `data/` together (`tests/codec/standalone.rs` does it
//! again). The activity that they give is how far off a prediction will be on average, so that it
//! tells the width of the coefficients' distribution as well as a context; a table is that distribution.
//! What is left open by the data's own scale is a *scale*, of which every diamond has one: a window, the
//! octaves of coefficients that contexts tell apart, and a correction of their widths.

use super::model::{LevelModel, MatrixModel, Model};
use crate::entropy::frequency::{Counts, Frequencies, PRECISION};
use crate::entropy::token::{ESCAPE, SYMBOLS, join, raw_bits};
use crate::transform::adaptive::{ACTIVITIES, CLASSES, CONTEXTS, FEATURES, Weights};
use std::sync::OnceLock;

/// Weights of prediction, in 2^-10.
const PREDICTION: [i16; FEATURES] = [
    -16, -16, 16, 56, -8, -96, -32, -80, 8, -120, -8, 680, 816, 8, 0, 0,
];
/// Weights of activity, in 256ths.
const ACTIVITY: [i16; ACTIVITIES] = [13, 12, 66, -13, -1, 19, 25, 13, 5, 0, 0, 17];

/// Windows of contexts, four octaves from one to the next.
pub(super) const WINDOWS: u32 = 8;
/// Corrections of width, half an octave from one to the next.
pub(super) const CORRECTIONS: u32 = 5;
/// Quarter octave of an activity of one unit: weights are in 256ths of a quarter of a unit.
const UNIT_QUARTER: i32 = 4 * 10;
/// Quarter octaves from the mean coefficient of the first window's first context up to 1.
const BELOW_ONE: i32 = 4 * 4;
const WINDOW_QUARTERS: i32 = 4 * 4;

/// The scale of a window and a correction.
pub(super) fn scale(window: u32, correction: u32) -> u32 {
    window * CORRECTIONS + correction
}

/// The weights of a window, for a quantiser of this step.
pub(super) fn weights(window: u32, step: i32) -> Weights {
    let mut weights = Weights::fixed();
    for (pair, own) in weights.prediction.iter_mut().enumerate() {
        *own = [[PREDICTION[2 * pair], PREDICTION[2 * pair + 1]]; CLASSES];
    }
    for (own, part) in weights.activity.as_flattened_mut().iter_mut().zip(ACTIVITY) {
        *own = part;
    }
    let first = UNIT_QUARTER + Weights::quarter(step) - BELOW_ONE;
    let first = first + WINDOW_QUARTERS * window as i32;
    weights.first_context = first.clamp(0, 128);
    weights
}

/// The window for coefficients of this mean size: the first whose middle is not below it.
pub(super) fn window(sum: u64, count: u64) -> u32 {
    let fits = |window: &u32| sum <= count << (4 * window + 1);
    (0..WINDOWS).find(fits).unwrap_or(WINDOWS - 1)
}

/// The model of all scales for a quantiser of this step; scales stand where levels do in that of a file.
pub(super) fn model(step: i32) -> Model {
    let level = |scale: u32| {
        let (window, correction) = (scale / CORRECTIONS, scale % CORRECTIONS);
        let matrix = MatrixModel {
            weights: weights(window, step),
            frequencies: (0..CONTEXTS)
                .map(|context| frequencies(context, window, correction))
                .collect(),
        };
        (LevelModel::new(vec![matrix]), scale + 1)
    };
    let levels = (0..WINDOWS * CORRECTIONS).map(level).collect();
    Model::new(true, None, 1, levels)
}

/// 2^(k/4) for k in 0..4, written out so that every machine has the same bits.
const QUARTER_OCTAVES: [f64; 4] = [
    1.0,
    1.189_207_115_002_721,
    std::f64::consts::SQRT_2,
    1.681_792_830_507_429,
];

/// 2^(quarters/4).
fn octaves(quarters: i32) -> f64 {
    QUARTER_OCTAVES[quarters.rem_euclid(4) as usize] * f64::powi(2.0, quarters.div_euclid(4))
}

/// A mixture of Laplace distributions: shares, and mean sizes in those of the mixture's middle one.
type Mixture = &'static [(f64, f64)];
/// Within a context sizes vary more than in one such distribution.
const INNER: Mixture = &[(0.25, 0.5), (0.5, 1.0), (0.2, 1.75), (0.05, 4.0)];
/// The last context has all activities above.
const LAST: Mixture = &[
    (0.3, 1.0),
    (0.3, 2.0),
    (0.2, 4.0),
    (0.1, 16.0),
    (0.1, 256.0),
];

/// Frequencies of a context.
fn frequencies(context: usize, window: u32, correction: u32) -> Frequencies {
    /// Those of the mixtures, by quarter octave: the same few serve many contexts, and every codec.
    static TABLES: [OnceLock<Vec<Frequencies>>; 2] = [OnceLock::new(), OnceLock::new()];
    let is_last = context + 1 == CONTEXTS;
    let mixture = if is_last { LAST } else { INNER };
    let all = TABLES[usize::from(is_last)].get_or_init(|| {
        let quarters = 0..(CONTEXTS as i32 + WINDOW_QUARTERS * WINDOWS as i32);
        quarters
            .map(|quarters| mixed(quarters - BELOW_ONE - WIDEST, mixture))
            .collect()
    });
    let middle = 2 * correction as i32 - WIDEST;
    let quarters = context as i32 + WINDOW_QUARTERS * window as i32 + middle + WIDEST;
    all[quarters as usize].clone()
}

/// Quarter octaves of the greatest correction.
const WIDEST: i32 = 2 * (CORRECTIONS / 2) as i32;

/// Frequencies of coefficients whose mean size lies in a quarter octave, rounded from sums and products that
/// every machine does alike.
fn mixed(quarters: i32, mixture: Mixture) -> Frequencies {
    // The middle of a quarter octave is half of one above its lower end.
    let mean = octaves(quarters) * 1.090_507_732_665_257_7;
    let beyond = |size: f64| {
        let parts = mixture.iter();
        parts.fold(0.0, |sum, (share, width)| {
            sum + share * exponential(size / (mean * width))
        })
    };
    let mut counts: Counts = [0; SYMBOLS];
    for (symbol, count) in counts.iter_mut().enumerate().take(usize::from(ESCAPE)) {
        let least = f64::from(join(symbol as u8, 0).unsigned_abs());
        let width = f64::from(1u32 << raw_bits(symbol as u8));
        let share = if symbol == 0 {
            1.0 - beyond(0.5)
        } else {
            (beyond(least - 0.5) - beyond(least + width - 0.5)) / 2.0
        };
        *count = (share * f64::from(RESOLUTION)) as u32;
        // What would have less than half a slot is left to the escape.
        if *count < RESOLUTION >> (PRECISION + 1) {
            *count = 0;
        }
    }
    Frequencies::like(&counts, false)
}

/// What the counts of a table add up to, about.
const RESOLUTION: u32 = 1 << 24;

/// e^-x for x from 0 up, as (1 - x / 2^20)^(2^20), within a thousandth wherever it matters.
fn exponential(x: f64) -> f64 {
    let mut power = (1.0 - x / f64::from(1 << 20)).max(0.0);
    for _ in 0..20 {
        power *= power;
    }
    power
}
