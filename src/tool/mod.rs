//! Floor 3: what the command line and the tests do with whole repositories. Prints nothing. Knows
//! `build`, `cut` and `blockmap` beside it.

mod bands;
mod bench;
mod cracks;
mod extract;
mod flight;
mod fly;
mod memory;
mod packed;
mod random;
pub mod raster_file;
mod render;
mod repair;
mod update;
mod verify;
mod verify_city;

pub use bench::{Speed, bench};
pub use cracks::count_cracks;
pub use extract::{Extract, Extracted, extract, window_in_box};
pub use fly::{Flight, FlightReport, fly};
pub use memory::peak_memory_bytes;
pub use packed::{open_packed, pack, unpack};
pub use render::{GroundRay, Likeness, Original, Render, Rendered, render};
pub use repair::{RepairReport, repair};
pub use update::{Placed, Update, UpdateReport, update};
pub use verify::{Comparison, DamagedBlocks, MissingBlocks, Verdict, verify};
pub use verify_city::verify_city;

/// Told how much is done, and of how much; false cancels.
pub type Progress<'a> = &'a mut dyn FnMut(u64, u64) -> bool;

/// The value of sorted numbers that this share of them does not exceed; 0 of none.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = (sorted.len() as f64 * share).ceil() as usize;
    sorted.get(place.saturating_sub(1)).copied().unwrap_or(0.0)
}
