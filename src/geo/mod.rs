//! Floor 0: what a raster is, where its samples lie in the world, and who looks at it. Knows no diamonds.

mod frame;
mod raster;
mod view;

pub use frame::Frame;
pub use raster::{RasterInfo, Registration, Sample, SampleType};
pub use view::View;
