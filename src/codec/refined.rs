//! What refining a diamond gives.

use super::Matrix;

/// A diamond's heights on the next level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refined {
    /// The (N+1)^2 vertices; `None` where they are those of the diamond's own level. Those on its
    /// boundary always are, and refining never changes which vertices are valid.
    pub vertices: Option<Matrix>,
    /// The N^2 centres.
    pub centres: Matrix,
}

impl Refined {
    /// The vertices on the next level, given those on the diamond's own.
    pub fn vertices<'a>(&'a self, own: &'a Matrix) -> &'a Matrix {
        self.vertices.as_ref().unwrap_or(own)
    }

    /// Vertices and centres on the next level, given the vertices on the diamond's own.
    pub fn into_matrices(self, own: Matrix) -> (Matrix, Matrix) {
        (self.vertices.unwrap_or(own), self.centres)
    }
}
