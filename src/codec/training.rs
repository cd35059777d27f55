//! Fitting the numbers of the trained predictor to a data set.
//!
//! Sums are taken in a fixed order and nothing is fused, so that every machine finds the same weights.

use super::model::WEIGHT_STEP;
use crate::transform::adaptive::{
    ACTIVITIES, CLASSES, COMPANIONS, CONTEXTS, FEATURES, Sight, WEIGHT_BITS, Weights,
};
use crate::vectors::widened;

/// Rounds of fitting: two for the activity, one to see where it lies, one for each class.
pub const ROUNDS: usize = 4;
/// Quarter octaves of 31 bits.
const QUARTERS: usize = 128;
/// Weight of an activity of one quarter of a unit.
const ACTIVITY_UNIT: f64 = 256.0;
/// Largest weight.
const GREATEST: f64 = 1023.0;
/// Samples of a class below which its weights lean on those of all classes.
const FEW_SAMPLES: f64 = 2000.0;

/// Normal equations of a weighted least squares problem in `N` unknowns.
#[derive(Clone)]
struct Equations<const N: usize> {
    matrix: [[f64; N]; N],
    right: [f64; N],
    count: f64,
}

impl<const N: usize> Equations<N> {
    fn new() -> Self {
        Equations {
            matrix: [[0.0; N]; N],
            right: [0.0; N],
            count: 0.0,
        }
    }

    /// Takes in what was seen, each entry of the sums in the order of `all`.
    #[inline(always)]
    fn add(&mut self, all: &[Seen<N>]) {
        // Two rows at a time keep enough sums in flight.
        let rows = self.matrix.as_chunks_mut::<2>().0.iter_mut();
        for (pair, rows) in rows.enumerate() {
            let mut sums = *rows;
            for seen in all {
                let own = [2 * pair, 2 * pair + 1].map(|row| seen.numbers[row] * seen.weight);
                for (sums, scaled) in sums.iter_mut().zip(own) {
                    for (sum, &other) in sums.iter_mut().zip(&seen.numbers) {
                        *sum += scaled * other;
                    }
                }
            }
            *rows = sums;
        }
        for seen in all {
            for (sum, &number) in self.right.iter_mut().zip(&seen.numbers) {
                *sum += number * seen.weight * seen.target;
            }
            self.count += 1.0;
        }
    }

    fn merge(&mut self, other: &Self) {
        for (row, other) in self.matrix.iter_mut().zip(&other.matrix) {
            for (entry, other) in row.iter_mut().zip(other) {
                *entry += other;
            }
        }
        for (entry, other) in self.right.iter_mut().zip(&other.right) {
            *entry += other;
        }
        self.count += other.count;
    }

    /// The solution nearest to `prior`, which counts as `strength` of the mean diagonal.
    fn solve(&self, prior: &[f64; N], strength: f64) -> [f64; N] {
        let mut matrix = self.matrix;
        let mut right = self.right;
        for i in 0..N {
            let pull = matrix[i][i] * strength + 1e-9;
            matrix[i][i] += pull;
            right[i] += pull * prior[i];
        }
        for i in 0..N {
            let pivot = matrix[i];
            for j in i + 1..N {
                let factor = matrix[j][i] / pivot[i];
                for (entry, other) in matrix[j][i..].iter_mut().zip(&pivot[i..]) {
                    *entry -= factor * other;
                }
                right[j] -= factor * right[i];
            }
        }
        for i in (0..N).rev() {
            for k in i + 1..N {
                right[i] -= matrix[i][k] * right[k];
            }
            right[i] /= matrix[i][i];
        }
        right
    }
}

/// A sample's part in a least squares problem.
#[derive(Clone, Copy)]
struct Seen<const N: usize> {
    numbers: [f64; N],
    target: f64,
    weight: f64,
}

/// Samples that are taken in at a time.
const BATCH: usize = 16;

/// Equations, and samples that are not yet in them.
#[derive(Clone)]
struct Gathered<const N: usize> {
    equations: Equations<N>,
    waiting: Vec<Seen<N>>,
}

impl<const N: usize> Gathered<N> {
    fn new() -> Self {
        Gathered {
            equations: Equations::new(),
            waiting: Vec::with_capacity(BATCH),
        }
    }

    #[inline(always)]
    fn see(&mut self, seen: Seen<N>, take: fn(&mut Equations<N>, &[Seen<N>])) {
        self.waiting.push(seen);
        if self.waiting.len() == BATCH {
            self.settle(take);
        }
    }

    fn settle(&mut self, take: fn(&mut Equations<N>, &[Seen<N>])) {
        take(&mut self.equations, &self.waiting);
        self.waiting.clear();
    }
}

/// Finds weights in rounds, each of which sees the same samples by the weights of the one before.
pub struct Trainer {
    weights: Weights,
    round: usize,
}

/// What one round saw; several can be put together.
#[derive(Clone)]
pub struct Fit {
    prediction: Vec<Gathered<FEATURES>>,
    activity: Gathered<ACTIVITIES>,
    companions: Vec<Equations<COMPANIONS>>,
    /// How often each quarter octave of activity came.
    quarters: [u64; QUARTERS],
}

impl Default for Fit {
    fn default() -> Fit {
        Fit::new()
    }
}

impl Fit {
    /// Nothing seen yet.
    pub fn new() -> Fit {
        Fit {
            prediction: vec![Gathered::new(); CLASSES],
            activity: Gathered::new(),
            companions: vec![Equations::new(); CLASSES],
            quarters: [0; QUARTERS],
        }
    }

    /// Takes in all that was seen; to be called before anything is made of it.
    pub(super) fn settle(&mut self) {
        for own in &mut self.prediction {
            own.settle(add_features);
        }
        self.activity.settle(add_activities);
    }

    /// Adds what another part of the same round saw.
    pub fn merge(&mut self, other: &Fit) {
        for (own, other) in self.prediction.iter_mut().zip(&other.prediction) {
            own.equations.merge(&other.equations);
        }
        self.activity.equations.merge(&other.activity.equations);
        for (own, other) in self.companions.iter_mut().zip(&other.companions) {
            own.merge(other);
        }
        for (own, other) in self.quarters.iter_mut().zip(&other.quarters) {
            *own += other;
        }
    }
}

impl Default for Trainer {
    fn default() -> Trainer {
        Trainer::new()
    }
}

impl Trainer {
    /// Begins with the fixed rule.
    pub fn new() -> Trainer {
        Trainer {
            weights: Weights::fixed(),
            round: 0,
        }
    }

    /// The weights so far.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Takes in a sample: what was known of it and its activity, and in quarters of a shifted unit by how much
    /// it differs from the prediction by order 2 and from that of the weights so far, the residuals of the
    /// components before, and the quantiser's step.
    pub fn see(
        &self,
        fit: &mut Fit,
        (sight, activity): &(Sight, i32),
        misses: [f64; 2],
        companions: [f64; COMPANIONS],
        step: f64,
    ) {
        let [from_order_two, residual] = misses;
        fit.quarters[Weights::quarter(*activity) as usize % QUARTERS] += 1;
        // A miss tells less where the surface is rough, and nothing below the quantiser's step.
        let parts = sight.activities.map(f64::from);
        let rough = if self.round == 0 {
            4.0 + 0.1 * parts.iter().sum::<f64>()
        } else {
            f64::from(*activity) / ACTIVITY_UNIT
        };
        let scale = 1e-3 + rough + 0.3 * step;
        let class = Weights::class(self.weights.context(*activity));
        let weight = 1.0 / (0.3 * residual * residual + scale * scale);
        let moves = companions.iter().zip(&self.weights.companions);
        let unit = f64::from(1u32 << WEIGHT_BITS);
        let moved = moves.fold(0.0, |sum, (companion, weights)| {
            sum + companion * f64::from(weights[class]) / unit
        });
        let seen = Seen {
            numbers: sight.features.map(f64::from),
            target: from_order_two - moved,
            weight,
        };
        fit.prediction[class].see(seen, add_features);
        if companions != [0.0; COMPANIONS] {
            let seen = Seen {
                numbers: companions,
                target: residual + moved,
                weight,
            };
            fit.companions[class].add(&[seen]);
        }
        let scale = scale + 0.1 * step;
        let seen = Seen {
            numbers: parts,
            target: residual.abs(),
            weight: 1.0 / (0.3 * residual * residual + scale * scale),
        };
        fit.activity.see(seen, add_activities);
    }

    /// Ends a round.
    pub fn learn(&mut self, fit: &Fit) {
        let by_class = self.round + 1 == ROUNDS;
        let prediction = solve_classes(fit.prediction.iter().map(|own| &own.equations), by_class);
        for (class, own) in prediction.into_iter().enumerate() {
            for (feature, own) in own.into_iter().enumerate() {
                self.weights.prediction[feature / 2][class][feature % 2] = in_weight_bits(own);
            }
        }
        let companions = solve_classes(fit.companions.iter(), by_class);
        for (class, own) in companions.into_iter().enumerate() {
            for (weights, own) in self.weights.companions.iter_mut().zip(own) {
                weights[class] = in_weight_bits(own);
            }
        }
        if self.round + 2 < ROUNDS {
            let activity = fit.activity.equations.solve(&[0.0; ACTIVITIES], 1e-5);
            for (own, part) in self
                .weights
                .activity
                .as_flattened_mut()
                .iter_mut()
                .zip(activity)
            {
                *own = (part * ACTIVITY_UNIT).round().clamp(-GREATEST, GREATEST) as i16;
            }
        } else if self.round + 2 == ROUNDS {
            self.weights.first_context = first_context(&fit.quarters);
        }
        self.round += 1;
    }
}

widened! {
    fn add_features(equations: &mut Equations<FEATURES>, all: &[Seen<FEATURES>]) {
        equations.add(all);
    }
}

widened! {
    fn add_activities(equations: &mut Equations<ACTIVITIES>, all: &[Seen<ACTIVITIES>]) {
        equations.add(all);
    }
}

/// The weights of each class; those of all together, unless `by_class`.
fn solve_classes<'a, const N: usize>(
    classes: impl Iterator<Item = &'a Equations<N>> + Clone,
    by_class: bool,
) -> Vec<[f64; N]> {
    let mut all = Equations::new();
    for class in classes.clone() {
        all.merge(class);
    }
    let general = all.solve(&[0.0; N], 1e-5);
    let solve = |equations: &Equations<N>| {
        let few = FEW_SAMPLES / (FEW_SAMPLES + equations.count);
        equations.solve(&general, 1e-5 + 0.1 * few)
    };
    let own = |equations| if by_class { solve(equations) } else { general };
    classes.map(own).collect()
}

fn in_weight_bits(weight: f64) -> i16 {
    let unit = f64::from(1u32 << WEIGHT_BITS) / f64::from(WEIGHT_STEP);
    (weight * unit).round().clamp(-GREATEST, GREATEST) as i16 * WEIGHT_STEP
}

/// The first of the consecutive quarter octaves, as many as there are contexts, that hold the most samples.
fn first_context(quarters: &[u64; QUARTERS]) -> i32 {
    let held = |first: usize| quarters[first..first + CONTEXTS].iter().sum::<u64>();
    let best = (0..QUARTERS - CONTEXTS)
        .rev()
        .max_by_key(|&first| held(first));
    best.unwrap_or(0) as i32
}
