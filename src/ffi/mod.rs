//! Floor 4: the C boundary: argument checks, panic barrier, ownership of handles. No algorithm.
//!
//! `include/kimberlite.h` is made from this room by `tests/header.rs`, one section from each of the
//! files below; their doc comments are its manual and speak to C programmers.
//!
//! | file | section |
//! |---|---|
//! | `boundary.rs` | none: the panic barrier and the checks of pointers |
//! | `frame.rs` | none: what an update is asked |
//! | `status.rs` | version, errors, messages |
//! | `repository.rs` | repositories: opening, what is known of them, coordinates |
//! | `cut.rs` | cuts: what a viewer draws |
//! | `patch.rs` | patches of a cut |
//! | `query.rs` | heights and windows of samples, without any view |
//! | `ray.rs` | rays and lines of sight |
//! | `profile.rs` | profiles along lines, statistics of polygons |
//! | `builder.rs` | building repositories from rows |
//! | `update.rs` | other samples in a part of a repository |
//! | `repair.rs` | what is left of a damaged repository |
//! | `raster.rs` | whole rasters as bytes in memory |
//! | `codec.rs` | one diamond as bytes |
//! | `city.rs` | cities: opening, what is known of them, single blocks |
//! | `city_visit.rs` | visits of a city: what a viewer draws, and rays against it |
//! | `city_builder.rs` | building cities from triangles and files |

// The safety contract of every function is that of a C library; the header's first section states
// it once.
#![allow(clippy::missing_safety_doc)]
#![allow(non_camel_case_types)]

mod boundary;
pub mod builder;
pub mod city;
pub mod city_builder;
pub mod city_visit;
pub mod codec;
pub mod cut;
mod frame;
pub mod patch;
pub mod profile;
pub mod query;
pub mod raster;
pub mod ray;
pub mod repair;
pub mod repository;
pub mod status;
pub mod update;
