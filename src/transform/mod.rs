//! Floor 1: prediction and reconstruction on one diamond. Knows no bytes and no files.

pub mod adaptive;
#[cfg(target_arch = "x86_64")]
mod adaptive_avx2;
mod interpolating;
mod lifted;
mod neville;
mod quantiser;
#[cfg(target_arch = "x86_64")]
pub(crate) mod rows_avx2;
mod sight;
#[cfg(target_arch = "x86_64")]
mod sight_avx2;
mod two_stage;

use crate::lattice::{Apex, reflect_absent_centres};
use std::borrow::Cow;

pub use interpolating::Interpolating;
pub use lifted::Lifted;
pub use neville::predict;
pub use quantiser::{LONGEST_LIST, ListedHeights, Quantiser};
pub use two_stage::TwoStage;

/// The transforms that there are. The numbers are those of the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum TransformKind {
    /// Residuals of a prediction, quantised in the loop.
    #[default]
    Interpolating = 0,
    /// Reversible integer wavelet.
    Lifted = 1,
    /// Filtered levels, each with residuals of vertices and centres.
    TwoStage = 2,
}

impl TransformKind {
    /// The transform for diamonds of `cells` cells with the quantiser's bound e (at most 2^30 - 1) and the
    /// range of units, which [`Lifted`] has no use for.
    pub fn transform(self, cells: usize, bound: i32, range: [i32; 2]) -> Box<dyn Transform> {
        let quantiser = Quantiser::new(bound, range[0], range[1]);
        match self {
            TransformKind::Interpolating => Box::new(Interpolating::new(cells, quantiser)),
            TransformKind::Lifted => Box::new(Lifted::new(cells, bound)),
            TransformKind::TwoStage => Box::new(TwoStage::new(cells, quantiser)),
        }
    }
}

/// What turns a diamond's heights on the next level into coefficients, given its heights on its own
/// level, and back.
///
/// Matrices of vertices are (N+1)^2, with an absent half reflected; matrices of centres are N^2. Integer
/// arithmetic throughout: both directions agree on every machine.
pub trait Transform: Send + Sync {
    /// Least and greatest height that it can make.
    fn range(&self) -> [i32; 2];

    /// Whether levels are filtered, so that refining changes inner vertices. If not, a vertex keeps one
    /// height for ever.
    fn is_filtering(&self) -> bool {
        false
    }

    /// One step from fine to coarse: turns the vertices on the next level into those on the diamond's
    /// own. Only inner ones that are valid change.
    fn filter(&self, validity: &Validity, vertices: &mut [i32], centres: &[i32]) {
        let _ = (validity, vertices, centres);
    }

    /// How many matrices of coefficients a diamond has: 2 where inner vertices have some.
    fn matrices(&self) -> usize {
        1
    }

    /// Which inner vertices have coefficients beside the centres: N^2, where entry `[j * N + i]` is 1 if
    /// vertex (i, j) has; row 0 and column 0 are 0. `None` for transforms without such coefficients.
    fn coded_vertices(&self, validity: &Validity) -> Option<Box<[u8]>> {
        let _ = validity;
        None
    }

    /// Coefficients that lead from decoded `vertices` to `target`; zero at all centres that are not valid.
    fn analyse(&self, validity: &Validity, vertices: &[i32], target: Target) -> Coefficients;

    /// The heights on the next level. A centre that is not valid gets its own prediction, a vertex that
    /// is not keeps its height.
    fn synthesise(
        &self,
        validity: &Validity,
        vertices: &[i32],
        coefficients: &Coefficients,
    ) -> Synthesis;
}

/// Which heights of a diamond are samples', known before any of its coefficients.
#[derive(Clone, Copy, Debug)]
pub struct Validity<'a> {
    /// (N+1)^2, an absent half reflected: 0 where a vertex is void or outside; `None` when none is.
    pub vertices: Option<&'a [u8]>,
    /// N^2: 0 where a centre is void, outside, or in an absent half; `None` when none is.
    pub centres: Option<&'a [u8]>,
    /// The apex of the half that is not present, if one is not.
    pub absent: Option<Apex>,
}

impl Validity<'_> {
    /// Which centres are valid, an absent half reflected.
    fn whole_centres(&self, cells: usize) -> Option<Cow<'_, [u8]>> {
        let mut centres = Cow::from(self.centres?);
        if let Some(absent) = self.absent {
            reflect_absent_centres(cells, absent, centres.to_mut());
        }
        Some(centres)
    }
}

/// Heights on the next level that coefficients should lead to.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// (N+1)^2; without meaning where not valid.
    pub vertices: &'a [i32],
    /// N^2; without meaning where not valid.
    pub centres: &'a [i32],
}

/// Quantised coefficients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coefficients {
    /// N^2.
    pub centres: Box<[i32]>,
    /// N^2, placed as by [`Transform::coded_vertices`]; `None` where that is.
    pub vertices: Option<Box<[i32]>>,
}

impl Coefficients {
    /// Whether all are 0.
    pub fn are_zero(&self) -> bool {
        let vertices = self.vertices.as_deref().unwrap_or_default();
        self.centres.iter().chain(vertices).all(|&entry| entry == 0)
    }
}

/// Heights on the next level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Synthesis {
    /// (N+1)^2; `None` where they are those of the diamond's own level.
    pub vertices: Option<Box<[i32]>>,
    /// N^2.
    pub centres: Box<[i32]>,
}
