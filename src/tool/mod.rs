//! Filled in below.

pub mod raster_file;
