//! Floor 3: what the command line and the tests do with whole repositories.

mod cracks;
pub mod raster_file;

pub use cracks::count_cracks;
