//! Cities made from a seed.

use std::collections::BTreeMap;
use std::time::Instant;

use kimberlite::blockmap::source::{ProceduralCity, generate};
use kimberlite::blockmap::{Paint, Scene};

const CITY: ProceduralCity = ProceduralCity {
    seed: 5,
    corner: [84_000.0, 447_000.0],
    side: 1000.0,
    buildings: 1000,
};

fn slope([x, y]: [f64; 2]) -> Option<f64> {
    Some(0.05 * (x - 84_000.0) + 0.02 * (y - 447_000.0))
}

fn text(scene: &Scene) -> String {
    format!("{:?}", scene.triangles)
}

/// Corners by the seed of their building's facade.
fn buildings(scene: &Scene) -> BTreeMap<u32, Vec<[f64; 3]>> {
    let mut buildings: BTreeMap<u32, Vec<[f64; 3]>> = BTreeMap::new();
    for triangle in &scene.triangles {
        if let Paint::Facade { seed, .. } = triangle.paint {
            buildings.entry(seed).or_default().extend(triangle.corners);
        }
    }
    buildings
}

#[test]
fn the_same_seed_makes_the_same_city_and_another_one_another() {
    let first = text(&generate(&CITY, &slope));
    assert_eq!(first, text(&generate(&CITY, &slope)));
    assert_ne!(
        first,
        text(&generate(&ProceduralCity { seed: 6, ..CITY }, &slope))
    );
}

#[test]
fn as_many_buildings_as_wanted_stand_in_the_square() {
    for count in [1, 7, 100, 1000] {
        let scene = generate(
            &ProceduralCity {
                buildings: count,
                ..CITY
            },
            &slope,
        );
        assert_eq!(buildings(&scene).len(), count);
        let [low, high] = scene.bounds().unwrap();
        assert!(
            low[0] >= 84_000.0 && high[0] <= 85_000.0,
            "{low:?} {high:?}"
        );
        assert!(
            low[1] >= 447_000.0 && high[1] <= 448_000.0,
            "{low:?} {high:?}"
        );
        assert!(
            scene
                .triangles
                .iter()
                .all(|triangle| triangle.normal().is_some())
        );
    }
}

#[test]
fn walls_reach_two_metres_below_the_lowest_corner() {
    let scene = generate(&CITY, &slope);
    for corners in buildings(&scene).values() {
        let least = |axis: usize| {
            corners
                .iter()
                .map(|corner| corner[axis])
                .fold(f64::INFINITY, f64::min)
        };
        let most = |axis: usize| {
            corners
                .iter()
                .map(|corner| corner[axis])
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let ground = slope([least(0), least(1)]).unwrap();
        assert!(
            (ground - 2.0 - least(2)).abs() < 1e-9,
            "{ground} {}",
            least(2)
        );
        let height = most(2) - ground;
        assert!((6.0..=60.0).contains(&height), "{height}");
    }
}

#[test]
fn walls_look_outwards_and_their_windows_are_whole() {
    let scene = generate(&CITY, &slope);
    for triangle in &scene.triangles {
        let Paint::Facade { at, .. } = triangle.paint else {
            continue;
        };
        assert!(
            at.iter()
                .all(|at| at[0].fract() == 0.0 && (at[1] < 0.0 || at[1].fract() == 0.0)),
            "{at:?}"
        );
    }
    // A box's signed volume tells which way its walls look.
    for corners in buildings(&scene).values() {
        let centre = corners
            .iter()
            .map(|corner| glam::DVec3::from_array(*corner))
            .sum::<glam::DVec3>()
            / corners.len() as f64;
        let outwards: f64 = corners[..24]
            .chunks_exact(3)
            .map(|triangle| {
                let [a, b, c] =
                    [0, 1, 2].map(|corner| glam::DVec3::from_array(triangle[corner]) - centre);
                a.cross(b).dot(c).signum()
            })
            .sum();
        assert_eq!(outwards, 8.0);
    }
}

#[test]
fn there_are_roofs_of_every_kind_and_towers_near_the_centre() {
    let scene = generate(&CITY, &slope);
    let count = |wanted: &dyn Fn(f64) -> bool| {
        let roofs = scene
            .triangles
            .iter()
            .filter(|triangle| matches!(triangle.paint, Paint::Plain(_)));
        roofs
            .filter(|triangle| triangle.normal().is_some_and(|normal| wanted(normal[2])))
            .count()
    };
    assert!(count(&|z| z > 0.99) > 200, "flat");
    assert!(count(&|z| (0.3..0.99).contains(&z)) > 200, "gabled");
    assert_eq!(count(&|z| z < -0.01), 0, "downwards");
    let courts = buildings(&scene)
        .values()
        .filter(|corners| corners.len() == 48)
        .count();
    assert!(courts > 10, "{courts} courtyards");
    let tall = buildings(&scene)
        .into_values()
        .max_by(|a, b| height(a).total_cmp(&height(b)))
        .unwrap();
    assert!(height(&tall) > 30.0, "{}", height(&tall));
    assert!(
        (tall[0][0] - 84_500.0).hypot(tall[0][1] - 447_500.0) < 300.0,
        "{tall:?}"
    );
}

fn height(corners: &[[f64; 3]]) -> f64 {
    let heights = corners.iter().map(|corner| corner[2]);
    heights.clone().fold(f64::NEG_INFINITY, f64::max) - heights.fold(f64::INFINITY, f64::min)
}

#[test]
fn buildings_without_ground_are_left_out() {
    let half = |at: [f64; 2]| slope(at).filter(|_| at[0] < 84_500.0);
    let count = buildings(&generate(&CITY, &half)).len();
    assert!((400..600).contains(&count), "{count}");
    assert!(generate(&CITY, &|_| None).triangles.is_empty());
    for side in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(
            generate(&ProceduralCity { side, ..CITY }, &slope)
                .triangles
                .is_empty()
        );
    }
    assert!(
        generate(
            &ProceduralCity {
                buildings: 0,
                ..CITY
            },
            &slope
        )
        .triangles
        .is_empty()
    );
}

#[test]
fn twenty_thousand_buildings_take_no_time() {
    let start = Instant::now();
    let city = ProceduralCity {
        side: 5000.0,
        buildings: 20_000,
        ..CITY
    };
    let scene = generate(&city, &slope);
    println!(
        "{} triangles in {:?}",
        scene.triangles.len(),
        start.elapsed()
    );
    assert!(start.elapsed().as_secs_f64() < 2.0);
}
