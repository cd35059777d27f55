//! Colours of what has neither a texture nor a colour of its own.

use glam::DVec3;

use crate::blockmap::facade;

/// A wall's normal rises, or falls, by less than this.
const STEEP: f64 = 0.3;
const WALL: [u8; 3] = [205, 203, 198];
const ROOF: [u8; 3] = [168, 165, 160];
const FLOOR: [u8; 3] = [122, 118, 112];

/// What an object is, as far as its colours go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Thing {
    Building,
    Road,
    Rail,
    Water,
    Plants,
    Land,
    Bridge,
    Other,
}

/// Which side of an object a surface is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Side {
    Wall,
    Roof,
    Floor,
}

impl Thing {
    /// By the name of a type of CityJSON.
    pub(super) fn of_type(name: &str) -> Thing {
        let starts = |beginnings: &[&str]| beginnings.iter().any(|text| name.starts_with(text));
        if starts(&["Building", "OtherConstruction"]) {
            Thing::Building
        } else if starts(&["Road", "TransportSquare"]) {
            Thing::Road
        } else if starts(&["Railway"]) {
            Thing::Rail
        } else if starts(&["WaterBody", "Waterway"]) {
            Thing::Water
        } else if starts(&["PlantCover", "SolitaryVegetationObject"]) {
            Thing::Plants
        } else if starts(&["LandUse", "TINRelief"]) {
            Thing::Land
        } else if starts(&["Bridge", "Tunnel"]) {
            Thing::Bridge
        } else {
            Thing::Other
        }
    }

    /// The colour of its upper side, but for buildings.
    fn colour(self) -> [u8; 3] {
        match self {
            Thing::Building => ROOF,
            Thing::Road => [104, 104, 108],
            Thing::Rail => [124, 112, 104],
            Thing::Water => [86, 122, 150],
            Thing::Plants => [98, 130, 78],
            Thing::Land => [146, 150, 112],
            Thing::Bridge => [150, 146, 140],
            Thing::Other => [160, 158, 152],
        }
    }
}

impl Side {
    /// By the unit normal that points outwards.
    pub(super) fn of_normal(normal: DVec3) -> Side {
        if normal.z.abs() < STEEP {
            Side::Wall
        } else if normal.z > 0.0 {
            Side::Roof
        } else {
            Side::Floor
        }
    }
}

/// The colour of a surface; a building with a seed has a roof of its own.
pub(super) fn plain(thing: Thing, side: Side, seed: Option<u32>) -> [u8; 3] {
    match (thing, side, seed) {
        (Thing::Building, Side::Wall, Some(seed)) => facade::wall(seed),
        (Thing::Building, Side::Roof, Some(seed)) => facade::roof(seed),
        (Thing::Building, Side::Wall, None) => WALL,
        (Thing::Building, Side::Floor, _) => FLOOR,
        (_, Side::Wall, _) => thing.colour().map(|band| band - band / 8),
        (_, Side::Roof | Side::Floor, _) => thing.colour(),
    }
}

/// A seed for one object, by its name.
pub(super) fn seed_of(seed: u32, name: &str) -> u32 {
    let mixed = name
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325 ^ u64::from(seed), |bits, byte| {
            (bits ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
    let mixed = (mixed ^ mixed >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (mixed >> 32) as u32
}
