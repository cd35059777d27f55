//! Polygons with holes keep their area.

use glam::{DQuat, DVec3};
use proptest::prelude::*;
use serde_json::{Value, json};

use super::city_json::wall;
use super::{Folder, total_area};

/// Corners around a point at these distances, counterclockwise.
fn star(centre: [f64; 2], distances: &[f64]) -> Vec<[f64; 2]> {
    let corner = |(number, distance): (usize, &f64)| {
        let (sine, cosine) =
            (std::f64::consts::TAU * number as f64 / distances.len() as f64).sin_cos();
        [centre[0] + distance * cosine, centre[1] + distance * sine]
    };
    distances.iter().enumerate().map(corner).collect()
}

fn flat_area(ring: &[[f64; 2]]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    ring.iter()
        .zip(next)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum::<f64>()
        / 2.0
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn triangles_cover_a_polygon_less_its_holes(
        outline in prop::collection::vec(60.0..140.0_f64, 3..40),
        holes in prop::collection::vec(prop::collection::vec(1.0..9.0_f64, 3..12), 0..4),
        axis in (-1.0..1.0_f64, -1.0..1.0_f64, 0.1..1.0_f64),
        angle in 0.0..6.3_f64,
        is_reversed in any::<bool>(),
    ) {
        let places = [[10.0, 10.0], [-10.0, 10.0], [-10.0, -10.0], [10.0, -10.0]];
        let mut rings = vec![star([0.0; 2], &outline)];
        rings.extend(holes.iter().zip(places).map(|(hole, place)| star(place, hole)));
        let wanted = 2.0 * flat_area(&rings[0]) - rings.iter().map(|ring| flat_area(ring)).sum::<f64>();
        if is_reversed {
            rings.iter_mut().for_each(|ring| ring.reverse());
        }
        let turn = DQuat::from_axis_angle(DVec3::new(axis.0, axis.1, axis.2).normalize(), angle);
        let place = DVec3::new(84_000.0, 447_000.0, 0.0);
        let mut vertices: Vec<Value> = Vec::new();
        let mut boundary: Vec<Vec<usize>> = Vec::new();
        for ring in &rings {
            boundary.push((vertices.len()..vertices.len() + ring.len()).collect());
            vertices.extend(ring.iter().map(|&[x, y]| json!((turn * DVec3::new(x, y, 0.0) + place).to_array())));
        }
        let mut city = wall();
        city["vertices"] = vertices.into();
        city["CityObjects"]["house"]["geometry"][0]["boundaries"] = json!([boundary]);
        let scene = Folder::new().read("polygon.json", city.to_string()).unwrap();
        prop_assert!((total_area(&scene) - wanted).abs() < 1e-6 * wanted, "{} {wanted}", total_area(&scene));
        prop_assert_eq!(&scene.warnings, &[] as &[String]);
        // All triangles are turned like the polygon.
        let normal = turn * DVec3::Z * if is_reversed { -1.0 } else { 1.0 };
        for triangle in &scene.triangles {
            let own = DVec3::from_array(triangle.normal().unwrap());
            // A sliver between rounded corners has no exact normal.
            prop_assert!(super::area(triangle) < 1e-6 || own.dot(normal) > 0.999, "{own} {normal}");
        }
    }
}
