//! The interpolating transform: no update, no filter, the quantiser inside the prediction loop.

use super::{Coefficients, Quantiser, Synthesis, Target, Transform, Validity, predict};

/// Residuals against the prediction from reconstructed vertices, quantised with step 2e + 1, so that
/// every reconstructed height is within e of its sample, at every level.
#[derive(Clone, Debug)]
pub struct Interpolating {
    cells: usize,
    quantiser: Quantiser,
}

impl Interpolating {
    /// A transform for diamonds of `cells` cells.
    pub fn new(cells: usize, quantiser: Quantiser) -> Interpolating {
        Interpolating { cells, quantiser }
    }

    fn predict(&self, vertices: &[i32]) -> Box<[i32]> {
        let mut predictions = vec![0; self.cells * self.cells].into_boxed_slice();
        let [low, high] = self.quantiser.range();
        predict(self.cells, vertices, low, high, &mut predictions);
        predictions
    }
}

impl Transform for Interpolating {
    fn range(&self) -> [i32; 2] {
        self.quantiser.range()
    }

    fn analyse(&self, validity: &Validity, vertices: &[i32], target: Target) -> Coefficients {
        let mut centres = self.predict(vertices);
        for (index, (coefficient, &sample)) in centres.iter_mut().zip(target.centres).enumerate() {
            let is_coded = validity.centres.is_none_or(|mask| mask[index] != 0);
            *coefficient = if is_coded {
                self.quantiser.quantise(sample, *coefficient)
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
            *centre = self.quantiser.reconstruct(coefficient, *centre);
        }
        Synthesis {
            vertices: None,
            centres,
        }
    }
}
