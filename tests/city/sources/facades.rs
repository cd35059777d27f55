//! Windows on walls that have no textures.

use std::collections::BTreeMap;

use kimberlite::blockmap::facade::colour;
use kimberlite::blockmap::{Paint, Scene};
use serde_json::{Value, json};

use super::Folder;
use super::city_json::wall;

/// A box without a floor and a roof, each wall one quadrangle, or parted into many triangles in any order.
fn house(is_parted: bool) -> Scene {
    let (x, y, z) = (12.3, 8.1, 9.7);
    let corners = [[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]];
    let mut vertices: Vec<Value> = Vec::new();
    let mut surfaces: Vec<Value> = Vec::new();
    let parts = if is_parted { 4 } else { 1 };
    for side in 0..4 {
        let (a, b) = (corners[side], corners[(side + 1) % 4]);
        for part in 0..parts {
            let at = |number: usize| {
                let share = number as f64 / parts as f64;
                [0, 1].map(|axis| a[axis] + share * (b[axis] - a[axis]))
            };
            let (left, right) = (at(part), at(part + 1));
            let first = vertices.len();
            vertices.extend([
                json!([left[0], left[1], 1.0]),
                json!([right[0], right[1], 1.0]),
                json!([right[0], right[1], 1.0 + z]),
                json!([left[0], left[1], 1.0 + z]),
            ]);
            let [a, b, c, d] = [0, 1, 2, 3].map(|corner| first + corner);
            match is_parted {
                true => surfaces.extend([json!([[a, b, c]]), json!([[a, c, d]])]),
                false => surfaces.push(json!([[a, b, c, d]])),
            }
        }
    }
    // Neighbours in the file are not neighbours on the wall.
    surfaces.sort_by_key(|surface| surface[0][1].as_u64().unwrap() * 7 % 31);
    let mut city = wall();
    city["vertices"] = vertices.into();
    city["CityObjects"]["house"]["geometry"] =
        json!([{"type": "Solid", "lod": 1, "boundaries": [surfaces]}]);
    Folder::new().read("house.json", city.to_string()).unwrap()
}

/// The facade's coordinates by wall and corner, the latter in millimetres.
fn places(scene: &Scene) -> BTreeMap<([i64; 2], [i64; 3]), [f32; 2]> {
    let mut places = BTreeMap::new();
    for triangle in &scene.triangles {
        let Paint::Facade { at, .. } = triangle.paint else {
            panic!("a wall without a facade: {triangle:?}");
        };
        let normal = triangle.normal().unwrap();
        for (corner, at) in triangle.corners.iter().zip(at) {
            let key = (
                [normal[0].round() as i64, normal[1].round() as i64],
                corner.map(|number| (1000.0 * number).round() as i64),
            );
            let known = *places.entry(key).or_insert(at);
            assert!((known[0] - at[0]).abs() < 1e-4 && (known[1] - at[1]).abs() < 1e-4);
        }
    }
    places
}

#[test]
fn a_wall_has_whole_windows_and_storeys() {
    let whole = places(&house(false));
    assert_eq!(whole.len(), 16);
    for ((normal, [x, y, z]), at) in &whole {
        let [bays, storeys] = [if normal[0] == 0 { 5.0 } else { 3.0 }, 3.0];
        // From outside, along goes to the right.
        let is_right = match normal {
            [0, -1] => *x > 0,
            [1, 0] => *y > 0,
            [0, 1] => *x == 0,
            _ => *y == 0,
        };
        let wanted = [
            if is_right { bays } else { 0.0 },
            if *z > 1000 { storeys } else { 0.0 },
        ];
        assert!(
            (at[0] - wanted[0]).abs() < 1e-4 && (at[1] - wanted[1]).abs() < 1e-4,
            "{at:?} {wanted:?}"
        );
    }
}

#[test]
fn the_triangles_of_a_wall_share_its_windows() {
    let (whole, parted) = (places(&house(false)), places(&house(true)));
    assert_eq!(parted.len(), 4 * 10);
    for (place, at) in whole {
        let other = parted[&place];
        assert!((at[0] - other[0]).abs() < 1e-4 && (at[1] - other[1]).abs() < 1e-4);
    }
}

#[test]
fn no_window_lies_across_a_whole_number() {
    for seed in 0..300 {
        for step in 0..80 {
            let share = step as f32 / 20.0 + 0.01;
            for edge in [-0.01, 0.01] {
                // Beside a column's edge all columns are alike, and at a storey's edge all places along it.
                let column = |bay: i32| colour(seed, [bay as f32 + edge, share]);
                assert!(
                    (-3..9).all(|bay| column(bay) == column(0)),
                    "seed {seed} height {share}"
                );
            }
            let top = |bay: f32| colour(seed, [bay, 3.99]);
            assert_eq!(top(share), top(0.01), "seed {seed} place {share}");
        }
    }
}

#[test]
fn facades_differ_and_have_windows() {
    let mut walls: Vec<String> = Vec::new();
    for seed in 0..100 {
        walls.push(format!("{:?}", colour(seed, [0.01, 2.5])));
        let colours = (0..40).map(|bay| format!("{:?}", colour(seed, [bay as f32 + 0.5, 2.5])));
        let mut glass: Vec<String> = colours.collect();
        glass.sort();
        glass.dedup();
        assert!(
            glass.len() > 3 && !glass.contains(&walls[seed as usize]),
            "{glass:?}"
        );
    }
    walls.sort();
    walls.dedup();
    assert!(walls.len() > 6);
}

#[test]
fn any_coordinates_have_a_colour() {
    let numbers = [
        0.0,
        -0.0,
        -1e-30,
        -7.3,
        1e9,
        -1e9,
        f32::MAX,
        f32::MIN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ];
    for seed in [0, 7, u32::MAX] {
        for along in numbers {
            for up in numbers {
                let found = colour(seed, [along, up]);
                assert!(
                    found.iter().all(|band| (0.0..=255.0).contains(band)),
                    "{along} {up}: {found:?}"
                );
                assert_eq!(found, colour(seed, [along, up]));
            }
        }
    }
}
