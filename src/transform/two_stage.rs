//! The two-stage transform of C-BDAM (Di Benedetto 2011, eq. 3.1-3.8): filtered levels, and residuals of
//! centres and of vertices that keep every level within e of its filtered data.
//!
//! With P the heights on the diamond's own level, V and C those of vertices and centres on the next, and ~
//! what is decoded.

use super::{
    Coefficients, Interpolating, Quantiser, Synthesis, Target, Transform, Validity, predict,
};
use crate::lattice::{Apex, reflect_absent_centres, reflect_absent_half};

/// Weights alpha of 1/2 at inner vertices whose support is all valid, 1 at all others.
#[derive(Clone, Debug)]
pub struct TwoStage {
    cells: usize,
    minimum: i32,
    maximum: i32,
    /// Residuals of centres against their prediction from P~.
    centres: Interpolating,
    /// Of both kinds of residuals.
    quantiser: Quantiser,
}

impl TwoStage {
    /// A transform for diamonds of `cells` cells.
    pub fn new(cells: usize, quantiser: Quantiser) -> TwoStage {
        let [minimum, maximum] = quantiser.range();
        TwoStage {
            cells,
            minimum,
            maximum,
            centres: Interpolating::new(cells, quantiser.clone()),
            quantiser,
        }
    }

    /// P^(V)(C) at all inner vertices, (N-1)^2. The centres are a matrix of N - 1 cells, the inner
    /// vertices the centres of those: one rule predicts either.
    fn predict_vertices(&self, centres: &[i32]) -> Box<[i32]> {
        let inner = self.cells - 1;
        let mut predictions = vec![0; inner * inner].into_boxed_slice();
        let (low, high) = (self.minimum, self.maximum);
        predict(inner, centres, low, high, &mut predictions);
        predictions
    }

    /// Calls `visit` with the places of each vertex of weight 1/2 in the vertex matrix, in the N^2 matrix
    /// of coefficients and in the (N-1)^2 predictions.
    fn for_each_filtered(&self, validity: &Validity, mut visit: impl FnMut(usize, usize, usize)) {
        let cells = self.cells;
        let centres = validity.whole_centres(cells);
        let are_valid = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            centres.as_ref().is_none_or(|centres| {
                rows.clone()
                    .all(|j| columns.clone().all(|i| centres[j * cells + i] != 0))
            })
        };
        for j in 1..cells {
            for i in 1..cells {
                let vertex = j * (cells + 1) + i;
                let is_valid = validity.vertices.is_none_or(|valid| valid[vertex] != 0);
                let is_wide = (2..cells - 1).contains(&i) && (2..cells - 1).contains(&j);
                // The 12 points are two crossed rectangles of 2 x 4.
                let is_supported = if is_wide {
                    are_valid(i - 2..i + 2, j - 1..j + 1) && are_valid(i - 1..i + 1, j - 2..j + 2)
                } else {
                    are_valid(i - 1..i + 1, j - 1..j + 1)
                };
                if is_valid && is_supported && !is_beyond(validity.absent, cells, i, j) {
                    visit(vertex, j * cells + i, (j - 1) * (cells - 1) + i - 1);
                }
            }
        }
    }

    /// The V~ that P~ and C~ alone predict at a vertex of weight 1/2, the first term of eq. 3.8.
    fn unfilter(&self, own: i32, prediction: i32) -> i32 {
        let doubled = 2 * i64::from(own) - i64::from(prediction);
        doubled.clamp(i64::from(self.minimum), i64::from(self.maximum)) as i32
    }

    /// C~, an absent half reflected (eq. 3.6).
    fn decode_centres(
        &self,
        validity: &Validity,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Box<[i32]> {
        let heights = self.centres.synthesise(validity, vertices, coefficients);
        self.reflected(validity, heights.centres)
    }

    fn reflected(&self, validity: &Validity, mut centres: Box<[i32]>) -> Box<[i32]> {
        if let Some(absent) = validity.absent {
            reflect_absent_centres(self.cells, absent, &mut centres);
        }
        centres
    }
}

/// Whether a vertex lies in an absent half and not on its hypotenuse.
fn is_beyond(absent: Option<Apex>, cells: usize, i: usize, j: usize) -> bool {
    match absent {
        None => false,
        Some(Apex::Origin) => i + j < cells,
        Some(Apex::Right) => i > j,
        Some(Apex::Far) => i + j > cells,
        Some(Apex::Bottom) => i < j,
    }
}

impl Transform for TwoStage {
    fn range(&self) -> [i32; 2] {
        [self.minimum, self.maximum]
    }

    fn is_filtering(&self) -> bool {
        true
    }

    /// Eq. 3.1: P = (V + P^(V)(C)) / 2, rounded to the nearest, halves up.
    fn filter(&self, validity: &Validity, vertices: &mut [i32], centres: &[i32]) {
        let centres = self.reflected(validity, centres.into());
        let predictions = self.predict_vertices(&centres);
        self.for_each_filtered(validity, |vertex, _, inner| {
            let sum = i64::from(vertices[vertex]) + i64::from(predictions[inner]);
            vertices[vertex] = ((sum + 1) >> 1) as i32;
        });
        if let Some(absent) = validity.absent {
            reflect_absent_half(self.cells, absent, vertices);
        }
    }

    fn matrices(&self) -> usize {
        2
    }

    fn coded_vertices(&self, validity: &Validity) -> Option<Box<[u8]>> {
        let mut coded = vec![0; self.cells * self.cells].into_boxed_slice();
        self.for_each_filtered(validity, |_, place, _| coded[place] = 1);
        Some(coded)
    }

    /// Eq. 3.5 and 3.7, where the target itself stands for what eq. 3.3 and 3.4 restore of it.
    fn analyse(&self, validity: &Validity, vertices: &[i32], target: Target) -> Coefficients {
        let mut coefficients = self.centres.analyse(validity, vertices, target);
        let centres = self.decode_centres(validity, vertices, &coefficients);
        let predictions = self.predict_vertices(&centres);
        let mut inner_residuals = vec![0; self.cells * self.cells].into_boxed_slice();
        self.for_each_filtered(validity, |vertex, place, inner| {
            let prediction = self.unfilter(vertices[vertex], predictions[inner]);
            let height = target.vertices[vertex];
            inner_residuals[place] = self.quantiser.quantise(height, prediction);
        });
        coefficients.vertices = Some(inner_residuals);
        coefficients
    }

    /// Eq. 3.6 and 3.8.
    fn synthesise(
        &self,
        validity: &Validity,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Synthesis {
        let centres = self.decode_centres(validity, vertices, coefficients);
        let predictions = self.predict_vertices(&centres);
        let residuals = coefficients.vertices.as_deref().unwrap_or_default();
        let mut next: Box<[i32]> = vertices.into();
        self.for_each_filtered(validity, |vertex, place, inner| {
            let prediction = self.unfilter(vertices[vertex], predictions[inner]);
            let residual = residuals.get(place).copied().unwrap_or(0);
            next[vertex] = self.quantiser.reconstruct(residual, prediction);
        });
        if let Some(absent) = validity.absent {
            reflect_absent_half(self.cells, absent, &mut next);
        }
        Synthesis {
            vertices: Some(next),
            centres,
        }
    }
}
