//! Floor 2: one matrix of samples to bytes and back: transform, quantiser, entropy coder, void mask.
//! Knows no files, threads or views.

mod block;
mod bounds;
pub mod colour;
mod components;
mod draft;
mod lengths;
mod mask;
mod matrix;
mod model;
mod outline;
mod refined;
mod roots;
mod standalone;
mod standard;
mod symbols;
mod tables;
mod trace;
mod training;
mod units;
#[cfg(target_arch = "x86_64")]
mod wave_avx2;

pub use block::{BlockCodec, BlockError, block_length_unit};
pub use bounds::{ErrorCode, RangeCode};
pub use components::{ColourUnits, Components};
pub use draft::Draft;
pub use lengths::{DECISION_BITS, NUMBER_BITS, longest_block, longest_blocks};
pub use matrix::{Matrix, MatrixView, child_vertices};
pub use model::{LevelModel, MatrixModel, Model};
pub use outline::Outline;
pub use refined::Refined;
pub use roots::RootCodec;
pub use standalone::{DiamondCodec, DiamondOptions, DiamondView};
pub use symbols::SymbolCoder;
pub use tables::Census;
pub use trace::Trace;
pub use training::{Fit, ROUNDS, Trainer};
pub use units::Units;
