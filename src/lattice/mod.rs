//! Floor 0: diamonds, their order, and the grid of a patch (`docs/design.md`). Knows no samples.

mod diamond;
mod order;
mod patch;
mod planar;
mod refinement;
mod rows;

pub use diamond::Diamond;
pub use patch::{Apex, PatchGrid};
pub use planar::{Lattice, Placement, ROOT_SIDE, Site};
pub use refinement::{gather_half, reflect_absent_centres, reflect_absent_half};
pub use rows::{CentreRun, centre_runs};
