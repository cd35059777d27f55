//! What is known of a centre before it is coded: the numbers that its prediction and its activity are sums of.

use super::adaptive::{
    ACTIVITIES, FEATURES, Neighbourhood, ROW_RIM, UNIT_ACTIVITY, Weights, Word, saturate,
};

/// What is known of a centre before it is coded; all heights in quarters of a shifted unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// Prediction by order 2: the sum of the 4 nearest vertices.
    pub order_two: i32,
    /// How much higher the prediction by order 4 is.
    pub order_four: i32,
    /// Differences from the prediction by order 2, whose weighted sum corrects it.
    pub features: [i32; FEATURES],
    /// Signs of roughness, none negative.
    pub activities: [i32; ACTIVITIES],
}

impl Sight {
    /// How far off a prediction may be, by these weights.
    #[inline(always)]
    pub(super) fn activity<T: Word>(&self, weights: &Weights) -> i32 {
        let parts = self.activities.iter().zip(weights.activity.as_flattened());
        let activity = parts.fold(0, |sum, (&part, &weight)| {
            sum + i64::from(part) * i64::from(weight)
        });
        T::wrap(activity).clamp(0, i64::from(i32::MAX)) as i32
    }

    /// How much higher than by order 2 the prediction of a class is, in quarters times 2^10.
    #[inline(always)]
    pub(super) fn correction(&self, weights: &Weights, class: usize) -> i64 {
        let features = self.features.chunks_exact(2).zip(&weights.prediction);
        features.fold(0, |total, (pair, weights)| {
            let [one, other] = weights[class].map(i64::from);
            total + i64::from(pair[0]) * one + i64::from(pair[1]) * other
        })
    }
}

/// The 4 x 4 vertices around a centre, by row and column, and what several numbers have in common.
struct Around {
    vertices: [[i32; 4]; 4],
    order_two: i32,
    order_four: i32,
    beside: i32,
    above_below: i32,
    diagonal: i32,
}

impl Around {
    #[inline(always)]
    fn new<T: Word>(vertices: [[i32; 4]; 4]) -> Around {
        let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = vertices;
        let order_two = a + b + d + e;
        let beside = saturate::<T>(r + t + s + u - order_two);
        let above_below = saturate::<T>(p + q + v + w - order_two);
        Around {
            vertices,
            order_two,
            order_four: -(saturate::<T>(beside + above_below) >> 3),
            beside,
            above_below,
            diagonal: (a + e) - (b + d),
        }
    }
}

impl<T: Word> Neighbourhood<T> {
    /// What is known of centre `i` of the row at hand.
    #[inline(always)]
    pub(super) fn look(&self, i: usize) -> Sight {
        let around = Around::new::<T>(std::array::from_fn(|j| {
            let start = (self.row + j) * self.stride + i;
            let row = &self.vertices[start..start + 4];
            std::array::from_fn(|column| row[column].wide())
        }));
        Sight {
            order_two: around.order_two,
            order_four: around.order_four,
            features: self.features(i, &around),
            activities: self.activities(i, &around),
        }
    }

    /// By how much the centre `back` columns on, in the row before or the one before it, missed order 4.
    #[inline(always)]
    fn missed(&self, rows: usize, i: usize, back: isize) -> i32 {
        self.surprises[rows][(i + ROW_RIM).wrapping_add_signed(back)].wide()
    }

    #[inline(always)]
    fn features(&self, i: usize, around: &Around) -> [i32; FEATURES] {
        let sat = saturate::<T>;
        let [[c1, _, _, c2], [_, a, b, _], [_, d, e, _], [c3, _, _, c4]] = around.vertices;
        let (order_two, order_four, diagonal) =
            (around.order_two, around.order_four, around.diagonal);
        let (low, high) = (a.min(b).min(d.min(e)), a.max(b).max(d.max(e)));
        let (lowest, highest) = (sat(4 * low - order_two), sat(4 * high - order_two));
        let (step, followed) = if self.row == 0 {
            (0, 0)
        } else {
            let centre = sat(4 * self.above[i + ROW_RIM].wide() - order_two);
            let one = sat(4 * a.min(b).max(d.min(e)) - order_two);
            let other = sat(4 * a.max(b).min(d.max(e)) - order_two);
            let step = centre.clamp(one.min(other), one.max(other));
            (step, centre.clamp(lowest, highest))
        };
        [
            around.beside,
            around.above_below,
            sat(c1 + c2 + c3 + c4 - order_two),
            diagonal,
            sat((c1 + c4) - (c2 + c3)),
            self.missed(0, i, -1),
            self.missed(0, i, 0),
            self.missed(0, i, 1),
            self.missed(1, i, 0),
            sat(order_two - 2 * (low + high)),
            diagonal * ((b - d).abs() - (a - e).abs()).signum(),
            order_four.clamp(-diagonal.abs(), diagonal.abs()),
            order_four.clamp(lowest, highest),
            step,
            followed,
            sat(self.missed(0, i, -2) + self.missed(0, i, 2)),
        ]
    }

    #[inline(always)]
    fn activities(&self, i: usize, around: &Around) -> [i32; ACTIVITIES] {
        let size = |value: i32| value.abs().min(T::LIMIT);
        let sum = |terms: &[i32]| {
            let total = |sum: i32, &term: &i32| saturate::<T>(sum + term);
            terms.iter().fold(0, total)
        };
        let [[_, p, q, _], [r, a, b, s], [t, d, e, u], [_, v, w, _]] = around.vertices;
        let rises = [a - r, d - t, b - s, e - u, a - p, b - q, d - v, e - w];
        let bends = [
            (r + s) - (a + b),
            (t + u) - (d + e),
            (p + v) - (a + d),
            (q + w) - (b + e),
        ];
        let missed = |rows: usize, back: isize| size(self.missed(rows, i, back));
        let companion = |side: usize| self.companion[i + side].wide();
        [
            (a - e).abs(),
            (b - d).abs(),
            around.diagonal.abs(),
            size(saturate::<T>(around.beside + around.above_below)),
            sum(&rises.map(i32::abs)),
            sum(&bends.map(size)),
            missed(0, 0),
            sum(&[missed(0, -1), missed(0, 1)]),
            sum(&[
                missed(1, 0),
                missed(1, -1),
                missed(1, 1),
                missed(0, -2),
                missed(0, 2),
            ]),
            companion(ROW_RIM),
            sum(&[companion(ROW_RIM - 1), companion(ROW_RIM + 1)]),
            UNIT_ACTIVITY,
        ]
    }
}
