//! Cities and BlockMaps for several tests.

use kimberlite::blockmap::source::{ProceduralCity, generate};
use kimberlite::blockmap::{
    BakeOptions, BakeReport, BlockMap, City, CityOptions, CityReport, Grid, Ground, Paint, Scene,
    Triangle, bake, build_city,
};
use kimberlite::store::Access;
use proptest::prelude::*;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Random cases; KIMBERLITE_CASES asks for another number.
pub fn config(cases: u32) -> ProptestConfig {
    let asked = std::env::var("KIMBERLITE_CASES").ok();
    let asked = asked.and_then(|asked| asked.parse().ok());
    ProptestConfig::with_cases(asked.unwrap_or(cases))
}

/// The plane at height 0.
pub const PLANE: Ground = Ground {
    height: &|_| 0.0,
    spacing: f64::INFINITY,
    colour: [120, 130, 110],
};

/// Few views of few pixels, for tests of shapes.
pub fn coarse_bake(side_texels: usize) -> BakeOptions {
    BakeOptions {
        side_texels,
        views: 12,
        view_pixels: 64,
        ..BakeOptions::default()
    }
}

/// A box without a bottom, in one colour.
pub fn box_at(
    [west, south]: [f64; 2],
    [along, across]: [f64; 2],
    top: f64,
    colour: [u8; 3],
) -> Vec<Triangle> {
    let (east, north) = (west + along, south + across);
    let ring = [[west, south], [east, south], [east, north], [west, north]];
    let mut triangles = Vec::new();
    let mut quad = |corners: [[f64; 3]; 4]| {
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            triangles.push(Triangle {
                corners: [corners[a], corners[b], corners[c]],
                paint: Paint::Plain(colour),
            });
        }
    };
    for side in 0..4 {
        let ([ax, ay], [bx, by]) = (ring[side], ring[(side + 1) % 4]);
        quad([[ax, ay, 0.0], [bx, by, 0.0], [bx, by, top], [ax, ay, top]]);
    }
    quad(ring.map(|[x, y]| [x, y, top]));
    triangles
}

pub fn scene_of(triangles: Vec<Triangle>) -> Scene {
    Scene {
        triangles,
        ..Scene::default()
    }
}

/// One block over a square.
pub fn bake_block(
    scene: &Scene,
    ground: &Ground,
    (corner, side): ([f64; 2], f64),
    options: &BakeOptions,
) -> (BlockMap, BakeReport) {
    let grid = Grid::new(scene, corner.map(|at| at - side), side, [3, 3]);
    bake(scene, &grid, ground, (corner, side), options).unwrap()
}

pub fn procedural(seed: u32, side: f64, buildings: usize) -> Scene {
    let city = ProceduralCity {
        seed,
        corner: [85_000.0, 447_000.0],
        side,
        buildings,
    };
    generate(&city, &|_| Some(0.0))
}

pub fn build_at(path: &Path, scene: &Scene, options: &CityOptions) -> CityReport {
    build_city(scene, &PLANE, options, path, &mut |_, _| true).unwrap()
}

/// A small city of four levels, made once for all tests.
pub fn shared_city() -> Arc<City> {
    static CITY: OnceLock<Arc<City>> = OnceLock::new();
    let build = || {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("city.kmb");
        let options = CityOptions {
            bake: coarse_bake(32),
            leaf_side: 32.0,
            ..CityOptions::default()
        };
        build_at(&path, &procedural(3, 250.0, 90), &options);
        Arc::new(City::open(&path, Access::Map).unwrap())
    };
    CITY.get_or_init(build).clone()
}
