//! What cuts and queries read diamonds from.

use crate::Result;
use crate::codec::{Matrix, Refined};
use crate::geo::{Frame, RasterInfo};
use crate::lattice::{Diamond, Lattice};

/// What is stored of a refinable diamond beside its detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Upper bound, in height units, of the distance between the leaf surface and this diamond's own
    /// triangles; never below its descendants'. Infinite where voids are wrongly drawn.
    pub error: f64,
    /// Least and greatest height, in units, of all that is drawn for it and its descendants.
    pub range: [i32; 2],
    /// Its detail is missing: it cannot be refined.
    pub is_missing: bool,
}

/// Decoded diamonds of one layer of heights. A repository is one; tests make others.
pub trait DiamondSource: Send + Sync {
    /// The diamonds that there are.
    fn lattice(&self) -> &Lattice;

    /// The level that has all samples. Diamonds from it on have no range of their own: theirs is that of all their parents.
    fn data_levels(&self) -> u32 {
        self.lattice().levels()
    }

    /// The raster that it has the samples of, if that is known.
    fn georeference(&self) -> Option<&RasterInfo> {
        None
    }

    /// From grid coordinates to the world.
    fn frame(&self) -> &Frame;

    /// World z of a height in units: `z[0] + z[1] * unit`.
    fn height_to_world(&self) -> [f64; 2];

    /// Whether samples may be void, as far as is known without decoding any.
    fn has_voids(&self) -> bool {
        true
    }

    /// The root's vertex matrix.
    fn root(&self) -> &Matrix;

    /// Range of units of the whole layer, which the ranges of level 0 refer to.
    fn range(&self) -> [i32; 2];

    /// Error and range of a refinable diamond. `parent_range` is the decoded range of its first
    /// existing parent in [`Lattice::parents`]' order ([`range`](Self::range) for the root), or that of both from
    /// [`data_levels`](Self::data_levels) on.
    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary>;

    /// The heights of a refinable diamond on the next level, given its vertex matrix.
    ///
    /// # Errors
    ///
    /// [`Error::Missing`](crate::Error::Missing) where the detail is missing, else whatever keeps the block from
    /// being read or decoded; the diamond then stays as it is.
    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined>;
}
