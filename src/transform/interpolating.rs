//! The interpolating transform: no update, no filter, the quantiser inside the prediction loop.

use super::{Coefficients, Synthesis, Target, Transform, Validity, predict};

/// Residuals against the prediction from reconstructed vertices, quantised with step 2e + 1, so that
/// every reconstructed height is within e of its sample, at every level.
#[derive(Clone, Debug)]
pub struct Interpolating {
    cells: usize,
    bound: i32,
    minimum: i32,
    maximum: i32,
}

impl Interpolating {
    /// A transform for diamonds of `cells` cells with the integer bound e (at most 2^30 - 1), for
    /// heights within `[minimum, maximum]`.
    pub fn new(cells: usize, bound: i32, minimum: i32, maximum: i32) -> Interpolating {
        Interpolating {
            cells,
            bound,
            minimum,
            maximum,
        }
    }

    fn predict(&self, vertices: &[i32]) -> Box<[i32]> {
        let mut predictions = vec![0; self.cells * self.cells].into_boxed_slice();
        let (low, high) = (self.minimum, self.maximum);
        predict(self.cells, vertices, low, high, &mut predictions);
        predictions
    }

    /// The quantised residual of a sample.
    pub fn quantise(&self, sample: i32, prediction: i32) -> i32 {
        if self.bound == 0 {
            return sample.wrapping_sub(prediction);
        }
        let bound = i64::from(self.bound);
        let residual = i64::from(sample) - i64::from(prediction);
        (residual + bound).div_euclid(2 * bound + 1) as i32
    }

    /// The height that a quantised residual stands for.
    pub fn reconstruct(&self, coefficient: i32, prediction: i32) -> i32 {
        if self.bound == 0 {
            // Wrapping: a residual of full-range samples needs 33 bits, its sum only 32.
            return prediction
                .wrapping_add(coefficient)
                .clamp(self.minimum, self.maximum);
        }
        let step = 2 * i64::from(self.bound) + 1;
        let value = i64::from(prediction) + i64::from(coefficient) * step;
        value.clamp(i64::from(self.minimum), i64::from(self.maximum)) as i32
    }
}

impl Transform for Interpolating {
    fn range(&self) -> [i32; 2] {
        [self.minimum, self.maximum]
    }

    fn analyse(&self, validity: &Validity, vertices: &[i32], target: Target) -> Coefficients {
        let mut centres = self.predict(vertices);
        for (index, (coefficient, &sample)) in centres.iter_mut().zip(target.centres).enumerate() {
            let is_coded = validity.centres.is_none_or(|mask| mask[index] != 0);
            *coefficient = if is_coded {
                self.quantise(sample, *coefficient)
            } else {
                0
            };
        }
        Coefficients {
            centres,
            vertices: None,
        }
    }

    fn synthesise(
        &self,
        _validity: &Validity,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Synthesis {
        let mut centres = self.predict(vertices);
        for (centre, &coefficient) in centres.iter_mut().zip(&coefficients.centres) {
            *centre = self.reconstruct(coefficient, *centre);
        }
        Synthesis {
            vertices: None,
            centres,
        }
    }
}
