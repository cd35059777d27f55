//! Floor 2: one matrix of samples to bytes and back: transform, quantiser, entropy coder, void mask.
//! Knows no files, threads or views.

mod block;
mod bounds;
pub mod colour;
mod mask;
mod matrix;
mod roots;
mod units;

pub use block::{BlockCodec, BlockError, block_length_unit};
pub use bounds::{ErrorCode, RangeCode};
pub use matrix::{Matrix, child_vertices, codable_centres};
pub use roots::RootCodec;
pub use units::Units;
