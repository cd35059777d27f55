//! Floor 3: from a raster to a repository. Knows neither views nor the C boundary.

mod bound;
mod builder;
mod coding;
mod crossings;
mod descent;
mod diagonals;
mod filtered;
mod leaf;
mod levels;
mod plane;
mod rms;
pub mod source;
mod summaries;
mod surface;
mod triangles;
#[cfg(target_arch = "x86_64")]
mod triangles_avx2;
mod update;
mod working_store;
mod workspace;

pub use bound::longest_repository;
pub use builder::{BuildOptions, BuildReport, build, build_into};
pub use update::{Predecessor, Replaced, Replacement, replace};
pub use working_store::{Identity, clean};
