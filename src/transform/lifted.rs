//! The lifted transform: a reversible integer wavelet (Bettio et al. 2007, eq. 1-4).
//!
//! The paper's eq. 1 and 2 name vertices and centres the other way round than its figures and text, which
//! are followed here. With V' the heights on the diamond's own level, V and C those of vertices and centres
//! on the next, P the prediction and U the mean of the adjacent details: H = C - P(V), V' = V + U(H) / 2, and
//! back V = V' - U(H) / 2, C = H + P(V). All sums and differences wrap in 32 bits.

use super::neville::{predict, repredict_from_valid};
use super::{Coefficients, Synthesis, Target, Transform, Validity};
use crate::lattice::reflect_absent_centres;

/// Integer details, quantised in open loop with step 2e + 1: lossless for e = 0, else without a bound on the
/// error.
#[derive(Clone, Debug)]
pub struct Lifted {
    cells: usize,
    bound: i32,
}

impl Lifted {
    /// A transform for diamonds of `cells` cells with the quantiser's e (at most 2^30 - 1).
    pub fn new(cells: usize, bound: i32) -> Lifted {
        Lifted { cells, bound }
    }

    /// P(V) at all centres. At valid ones it depends on valid vertices only.
    fn predictions(&self, validity: &Validity, vertices: &[i32]) -> Box<[i32]> {
        let mut predictions = vec![0; self.cells * self.cells].into_boxed_slice();
        predict(self.cells, vertices, i32::MIN, i32::MAX, &mut predictions);
        if let Some(valid) = validity.vertices {
            let at = |index: usize| validity.centres.is_none_or(|mask| mask[index] != 0);
            repredict_from_valid(self.cells, vertices, valid, at, &mut predictions);
        }
        predictions
    }

    /// H at all valid centres, 0 at others (eq. 1).
    fn details(&self, validity: &Validity, vertices: &[i32], centres: &[i32]) -> Box<[i32]> {
        let mut details = self.predictions(validity, vertices);
        for (index, (detail, &centre)) in details.iter_mut().zip(centres).enumerate() {
            let is_valid = validity.centres.is_none_or(|mask| mask[index] != 0);
            *detail = if is_valid {
                centre.wrapping_sub(*detail)
            } else {
                0
            };
        }
        details
    }

    /// Adds U(H) / 2, or takes it away, at all valid inner vertices (eq. 2 and 3): with n valid details of
    /// sum s around a vertex, floor((s + n) / 2n).
    fn update(&self, validity: &Validity, details: &[i32], subtract: bool, vertices: &mut [i32]) {
        let (cells, side) = (self.cells, self.cells + 1);
        let centres = validity.whole_centres(cells);
        for j in 1..cells {
            for i in 1..cells {
                let vertex = j * side + i;
                if validity.vertices.is_some_and(|valid| valid[vertex] == 0) {
                    continue;
                }
                let last = j * cells + i;
                let (mut sum, mut count) = (0, 0);
                for index in [last - cells - 1, last - cells, last - 1, last] {
                    if centres.as_ref().is_none_or(|centres| centres[index] != 0) {
                        sum += i64::from(details[index]);
                        count += 1;
                    }
                }
                if count > 0 {
                    // The mean of 32-bit numbers has 32 bits.
                    let half = (sum + count).div_euclid(2 * count) as i32;
                    let change = if subtract { half.wrapping_neg() } else { half };
                    vertices[vertex] = vertices[vertex].wrapping_add(change);
                }
            }
        }
    }

    fn step(&self) -> i64 {
        2 * i64::from(self.bound) + 1
    }
}

impl Transform for Lifted {
    fn range(&self) -> [i32; 2] {
        [i32::MIN, i32::MAX]
    }

    fn is_filtering(&self) -> bool {
        true
    }

    fn filter(&self, validity: &Validity, vertices: &mut [i32], centres: &[i32]) {
        let mut details = self.details(validity, vertices, centres);
        if let Some(absent) = validity.absent {
            reflect_absent_centres(self.cells, absent, &mut details);
        }
        self.update(validity, &details, false, vertices);
    }

    fn analyse(&self, validity: &Validity, _vertices: &[i32], target: Target) -> Coefficients {
        let mut details = self.details(validity, target.vertices, target.centres);
        for detail in &mut details {
            let shifted = i64::from(*detail) + i64::from(self.bound);
            *detail = shifted.div_euclid(self.step()) as i32;
        }
        Coefficients {
            centres: details,
            vertices: None,
        }
    }

    fn synthesise(
        &self,
        validity: &Validity,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Synthesis {
        let dequantise = |&coefficient: &i32| (i64::from(coefficient) * self.step()) as i32;
        let mut details: Box<[i32]> = coefficients.centres.iter().map(dequantise).collect();
        if let Some(absent) = validity.absent {
            reflect_absent_centres(self.cells, absent, &mut details);
        }
        let mut next: Box<[i32]> = vertices.into();
        self.update(validity, &details, true, &mut next);
        let mut centres = self.predictions(validity, &next);
        for (centre, &detail) in centres.iter_mut().zip(&details) {
            *centre = centre.wrapping_add(detail);
        }
        Synthesis {
            vertices: Some(next),
            centres,
        }
    }
}
