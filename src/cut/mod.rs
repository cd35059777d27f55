//! Floor 3: from views to patches within a budget, and queries without any view. Knows no builder.

mod query;
mod source;
mod terrain;
mod view;
mod window;

pub use query::{Height, Query};
pub use source::{DiamondSource, Summary};
pub use terrain::Terrain;
pub use view::View;
pub use window::{Window, level_size, level_step, read_window};
