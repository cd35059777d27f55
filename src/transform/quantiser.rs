//! The quantiser inside the prediction loop.

use crate::vectors::widened;

/// Turns the distance of a height from its prediction into a coefficient, and back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quantiser {
    bound: i32,
    minimum: i32,
    maximum: i32,
    listed: Option<ListedHeights>,
}

impl Quantiser {
    /// Step 2e + 1 for the bound e (at most 2^30 - 1): every reconstructed height is within e of its
    /// sample. Heights are within `[minimum, maximum]`.
    pub fn new(bound: i32, minimum: i32, maximum: i32) -> Quantiser {
        Quantiser {
            bound,
            minimum,
            maximum,
            listed: None,
        }
    }

    /// Lossless, counting in listed heights instead of units.
    pub fn of_listed(listed: ListedHeights) -> Quantiser {
        Quantiser {
            bound: 0,
            minimum: listed.heights[0],
            maximum: listed.heights[listed.heights.len() - 1],
            listed: Some(listed),
        }
    }

    /// 2e + 1.
    pub fn step(&self) -> i32 {
        // e is at most 2^30 - 1.
        2 * self.bound + 1
    }

    /// The heights that are counted in, where not all are.
    pub fn listed(&self) -> Option<&ListedHeights> {
        self.listed.as_ref()
    }

    /// Least and greatest height.
    pub fn range(&self) -> [i32; 2] {
        [self.minimum, self.maximum]
    }

    /// The coefficient of a sample whose prediction is within the range.
    #[inline]
    pub fn quantise(&self, sample: i32, prediction: i32) -> i32 {
        if let Some(listed) = &self.listed {
            return listed.rank(sample) - listed.rank(prediction);
        }
        if self.bound == 0 {
            return sample.wrapping_sub(prediction);
        }
        let bound = i64::from(self.bound);
        let residual = i64::from(sample) - i64::from(prediction);
        (residual + bound).div_euclid(2 * bound + 1) as i32
    }

    /// The coefficients of a row of samples, whose predictions are clamped to the range; 0 where `coded`, if it
    /// is given, is.
    pub fn quantise_row(
        &self,
        samples: &[i32],
        predictions: &[i32],
        coded: Option<&[u8]>,
        row: &mut [i32],
    ) {
        if self.listed.is_some() {
            let [low, high] = self.range();
            let both = samples.iter().zip(predictions);
            for (i, (coefficient, (&sample, &prediction))) in row.iter_mut().zip(both).enumerate() {
                let is_coded = coded.is_none_or(|coded| coded[i] != 0);
                let quantise = || self.quantise(sample, prediction.clamp(low, high));
                *coefficient = if is_coded { quantise() } else { 0 };
            }
            return;
        }
        if self.bound == 0 {
            subtract(self.range(), samples, predictions, row);
        } else {
            divide(self.bound, self.range(), samples, predictions, row);
        }
        if let Some(coded) = coded {
            for (coefficient, &coded) in row.iter_mut().zip(coded) {
                *coefficient *= i32::from(coded);
            }
        }
    }

    /// The height that a coefficient stands for.
    #[inline]
    pub fn reconstruct(&self, coefficient: i32, prediction: i32) -> i32 {
        if let Some(listed) = &self.listed {
            return listed.height(listed.rank(prediction).wrapping_add(coefficient));
        }
        if self.bound == 0 {
            // Wrapping: a residual of full-range samples needs 33 bits, its sum only 32.
            return prediction
                .wrapping_add(coefficient)
                .clamp(self.minimum, self.maximum);
        }
        let value = i64::from(prediction) + i64::from(coefficient) * i64::from(self.step());
        value.clamp(i64::from(self.minimum), i64::from(self.maximum)) as i32
    }

    /// Whether heights follow from predictions and coefficients in 32 bits.
    pub(crate) fn is_plain(&self) -> bool {
        let (low, high) = (self.minimum, self.maximum);
        // A sound coefficient leads to within the bound of the range, by steps that span no more than it and
        // the bound.
        let has_room = low.checked_sub(self.bound).is_some()
            && high.checked_add(self.bound).is_some()
            && i64::from(high) - i64::from(low) < 1 << 30;
        self.listed.is_none() && has_room
    }

    /// Clamps the predictions of a row to the range, and replaces the row's coefficients by the heights
    /// that they stand for.
    #[inline]
    pub fn reconstruct_row(&self, predictions: &[i32], row: &mut [i32]) {
        let (low, high) = (self.minimum, self.maximum);
        if !self.is_plain() {
            for (height, &prediction) in row.iter_mut().zip(predictions) {
                *height = self.reconstruct(*height, prediction.clamp(low, high));
            }
            return;
        }
        reconstruct_steps(self.step(), self.range(), predictions, row);
    }
}

widened! {
    /// By how much samples are higher than their predictions, wrapping.
    fn subtract(range: [i32; 2], samples: &[i32], predictions: &[i32], row: &mut [i32]) {
        let [low, high] = range;
        let both = samples.iter().zip(predictions);
        for (coefficient, (&sample, &prediction)) in row.iter_mut().zip(both) {
            *coefficient = sample.wrapping_sub(prediction.clamp(low, high));
        }
    }
}

widened! {
    /// The same in steps, rounded to the nearest. Quotients of such integers are farther from the next integer
    /// above than `f64` rounds them, so that the floor is exact.
    fn divide(bound: i32, range: [i32; 2], samples: &[i32], predictions: &[i32], row: &mut [i32]) {
        let [low, high] = range;
        let (bound, step) = (f64::from(bound), 2.0 * f64::from(bound) + 1.0);
        let both = samples.iter().zip(predictions);
        for (coefficient, (&sample, &prediction)) in row.iter_mut().zip(both) {
            let residual = f64::from(sample) - f64::from(prediction.clamp(low, high));
            *coefficient = ((residual + bound) / step).floor() as i32;
        }
    }
}

widened! {
    /// Replaces coefficients by heights. No sum of sound ones leaves 32 bits; those of damaged ones wrap before
    /// they are clamped.
    fn reconstruct_steps(step: i32, range: [i32; 2], predictions: &[i32], row: &mut [i32]) {
        let [low, high] = range;
        for (height, &prediction) in row.iter_mut().zip(predictions) {
            let prediction = prediction.clamp(low, high);
            *height = prediction
                .wrapping_add(height.wrapping_mul(step))
                .clamp(low, high);
        }
    }
}

/// The heights that a raster has, where it has few of those in its range.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListedHeights {
    heights: Vec<i32>,
    /// For each height from the least on, how many listed ones are below it.
    ranks: Vec<i32>,
}

/// Greatest range of a list, which bounds its memory.
pub const LONGEST_LIST: usize = 1 << 20;

impl ListedHeights {
    /// From the least height and, for it and each that follows, whether the raster has it. `None`
    /// unless the first and the last are there, and no more than [`LONGEST_LIST`].
    pub fn new(least: i32, present: &[bool]) -> Option<ListedHeights> {
        let ends = (present.first()?, present.last()?);
        if ends != (&true, &true) || present.len() > LONGEST_LIST {
            return None;
        }
        least.checked_add(present.len() as i32)?;
        let mut listed = ListedHeights {
            heights: Vec::new(),
            ranks: Vec::with_capacity(present.len()),
        };
        for (height, &present) in (least..).zip(present) {
            listed.ranks.push(listed.heights.len() as i32);
            if present {
                listed.heights.push(height);
            }
        }
        Some(listed)
    }

    /// The least height.
    pub fn least(&self) -> i32 {
        self.heights[0]
    }

    /// Whether a height is listed.
    pub fn contains(&self, height: i32) -> bool {
        let place = i64::from(height) - i64::from(self.least());
        let rank = usize::try_from(place)
            .ok()
            .and_then(|place| self.ranks.get(place));
        rank.is_some_and(|&rank| self.heights[rank as usize] == height)
    }

    /// For the least height and each that follows, whether it is listed.
    pub fn present(&self) -> Vec<bool> {
        let mut present = vec![false; self.ranks.len()];
        for &height in &self.heights {
            present[(height - self.least()) as usize] = true;
        }
        present
    }

    #[inline]
    fn rank(&self, height: i32) -> i32 {
        self.ranks[(height - self.heights[0]) as usize]
    }

    #[inline]
    fn height(&self, rank: i32) -> i32 {
        self.heights[rank.clamp(0, self.heights.len() as i32 - 1) as usize]
    }
}
