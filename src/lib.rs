//! Kimberlite stores very large terrains in compressed, crack-free, multiresolution form and hands
//! a viewer, frame by frame, the buffers that its view needs.
//!
//! The rooms lie on floors; a room uses only floors below it (`docs/design.md`).
//!
//! | floor | rooms |
//! |---|---|
//! | 4 | [`ffi`] the C boundary, and the command line `kmb` |
//! | 3 | [`tool`] whole repositories, [`build`] rasters to repositories, [`cut`] views and queries, [`blockmap`] cities |
//! | 2 | [`codec`] one matrix, [`schedule`] budgets and priorities, [`store`] the packed file |
//! | 1 | [`transform`] prediction on one diamond, [`entropy`] bits |
//! | 0 | [`lattice`] diamonds and patches, [`geo`] rasters and frames |

#![warn(missing_docs)]
#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

pub mod blockmap;
pub mod build;
pub mod codec;
pub mod cut;
pub mod entropy;
mod error;
pub mod ffi;
pub mod geo;
pub mod lattice;
mod log;
mod positioned;
pub mod schedule;
pub mod store;
pub mod tool;
pub mod transform;
mod vectors;

pub use error::{Error, Result};
pub use log::{LogLevel, set_log_callback};
