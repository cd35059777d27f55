//! Floor 1: prediction and reconstruction on one diamond. Knows no bytes and no files.

pub mod adaptive;
mod interpolating;
mod neville;

pub use interpolating::Interpolating;
pub use neville::predict;

/// What turns the samples at a diamond's centres into coefficients, given its vertices, and back.
///
/// `vertices` is the (N+1)^2 matrix with absent halves reflected; `samples`, `coefficients` and
/// `centres` are N^2. Integer arithmetic throughout: both directions agree on every machine.
pub trait Transform: Send + Sync {
    /// Coefficients of the samples at the coded centres; zero at all others.
    ///
    /// `coded` holds 1 where a centre is coded; `None` means all are.
    fn analyse(
        &self,
        vertices: &[i32],
        samples: &[i32],
        coded: Option<&[u8]>,
        coefficients: &mut [i32],
    );

    /// Heights at all centres; one with coefficient zero gets its own prediction.
    fn synthesise(&self, vertices: &[i32], coefficients: &[i32], centres: &mut [i32]);
}
