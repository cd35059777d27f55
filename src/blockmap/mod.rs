//! Floor 3: cities as BlockMaps (Di Benedetto's thesis, ch. 4; `docs/cities.md`).

mod bake;
mod cast;
mod columns;
pub mod facade;
mod layout;
mod orthographic;
mod raster;
mod scene;
pub mod source;
mod surroundings;
mod walls;

pub use bake::{BakeOptions, BakeReport, Ground, bake};
pub use cast::{Caster, Hit, Ray, Surface};
pub use layout::{BlockMap, WALL_COLUMNS, direction, direction_byte, image_bytes};
pub use scene::{Paint, Scene, Texture, Triangle};
pub use surroundings::Grid;
