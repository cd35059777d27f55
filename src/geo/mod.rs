//! Floor 0: what a raster is, and where its samples lie in the world. Knows no diamonds.

mod frame;
mod raster;

pub use frame::Frame;
pub use raster::{RasterInfo, Registration, Sample, SampleType};
