//! What an error is.

/// What is projected on the screen as a diamond's error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Metric {
    /// The stored error: how far the screen position of a point of the finest surface is at most from that of the drawn
    /// point at the same place. Where a cut is not cut short, no measured error exceeds the tolerance.
    #[default]
    Geometric,
    /// The side of a square as large as a triangle in the mean: the root of a half's projected box over its triangles
    /// (thesis of Di Benedetto, View-Space and Object-Space Errors). A density; it bounds no error. The finest diamonds
    /// have 0.
    Sampling,
}
