//! Floor 3: from views to patches within a budget, and queries without any view. Knows no builder.

mod source;
mod view;

pub use source::{DiamondSource, Summary};
pub use view::View;
