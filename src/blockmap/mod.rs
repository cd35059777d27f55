//! Floor 3: cities as BlockMaps (Di Benedetto's thesis, ch. 4; `docs/cities.md`).

mod bake;
mod cast;
mod city;
mod codec;
mod columns;
mod construct;
pub mod facade;
mod layout;
mod merge;
mod orthographic;
mod png;
mod raster;
mod rays;
mod scene;
mod sight;
pub mod source;
mod surroundings;
mod tree;
mod visit;
mod walls;

pub use self::png::{read_png, write_png};
pub use bake::{BARE_GROUND, BakeOptions, BakeReport, Ground, bake};
pub use cast::{Caster, Hit, Ray, Surface};
pub use city::City;
pub use codec::{decode, encode};
pub use construct::{CityOptions, CityReport, build_city};
pub use layout::{BlockMap, WALL_COLUMNS, direction, direction_byte, image_bytes};
pub use merge::{NodeError, merge};
pub use raster::Seen;
pub use rays::{CityHit, CityRays};
pub use scene::{FAR, Paint, Scene, Texture, Triangle};
pub use surroundings::{Grid, Local, local};
pub use tree::{Node, Tree};
pub use visit::{ALL_QUARTERS, Drawn, Visit, VisitStats};
