//! Floor 3: cities as BlockMaps (Di Benedetto's thesis, ch. 4; `docs/cities.md`).

pub mod facade;
mod layout;
mod scene;
pub mod source;

pub use layout::{BlockMap, WALL_COLUMNS, direction, direction_byte, image_bytes};
pub use scene::{Paint, Scene, Texture, Triangle};
