//! Floor 3: from views to patches within a budget, and queries without any view. Knows no builder.

mod changes;
mod graph;
mod node;
mod patch;
mod projection;
mod slopes;
mod source;
mod update;
mod view;

pub use changes::Changes;
pub use patch::{GridToWorld, Patch, VertexForm};
pub use source::{DiamondSource, Summary};
pub use update::{Cut, CutOptions, Stats};
pub use view::View;
