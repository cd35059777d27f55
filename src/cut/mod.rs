//! Floor 3: from views to patches within a budget, and queries without any view. Knows no builder.

mod cache;
mod changes;
mod coarse;
mod course;
mod foresight;
mod graph;
mod halves;
mod layer;
mod node;
mod overview;
mod patch;
mod projection;
mod query;
mod queues;
mod ray;
mod shared;
mod skeleton;
mod slopes;
mod source;
mod stock;
mod supply;
mod terrain;
mod tile;
mod update;
mod view;
mod window;

pub use changes::Changes;
pub use layer::Layer;
pub use patch::{GridToWorld, Patch, VertexForm};
pub use query::{Height, Query};
pub use ray::{Hit, Ray};
pub use source::{DiamondSource, Summary};
pub use terrain::Terrain;
pub use update::{Cut, CutOptions, Stats};
pub use view::{Metric, View};
pub use window::{Coarse, Window, level_size, level_step, read_window};
