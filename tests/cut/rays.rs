//! Rays and lines of sight against the surface that heights are read from.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use crate::support::repositories::{repaired_repository, repository};
use kimberlite::build::BuildOptions;
use kimberlite::cut::{DiamondSource, Query, Ray};
use proptest::prelude::*;

/// Without any loss, so that the surface is the raster's.
fn lossless() -> BuildOptions {
    BuildOptions {
        max_error: 0.0,
        cells_log2: 4,
        threads: 1,
        ..BuildOptions::default()
    }
}

/// A place in fractions of the raster's sides, on samples and edges as often as between, and a height in metres.
fn places() -> impl Strategy<Value = ([f64; 2], f64)> {
    let along = || prop_oneof![-0.2f64..1.2, (0u32..=64).prop_map(|k| f64::from(k) / 64.0)];
    let height = prop_oneof![-100.0f64..300.0, Just(100.0), 300.0f64..9000.0];
    ([along(), along()], height)
}

fn world(source: &MemorySource, (at, z): ([f64; 2], f64)) -> [f64; 3] {
    let raster = &source.raster;
    let ends = [raster.width - 1, raster.height - 1].map(f64::from);
    // To the sample where the fraction comes near one.
    let place = [0, 1].map(|axis| {
        let exact = at[axis] * ends[axis];
        if (exact - exact.round()).abs() < 0.1 {
            exact.round()
        } else {
            exact
        }
    });
    let [x, y] = source.frame().grid_to_world(place[0], place[1]);
    [x, y, z]
}

/// How high a point is above the surface.
fn above(query: &mut Query, [x, y, z]: [f64; 3]) -> Option<f64> {
    query
        .height_at_world(x, y)
        .unwrap()
        .map(|found| z - found.height)
}

proptest! {
    #![proptest_config(config(64))]

    #[test]
    fn a_ray_meets_the_surface_first_where_its_side_of_it_changes(
        scene in scenes(),
        ends in prop::collection::vec((places(), places()), 40),
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let terrain = repository(&source, &lossless());
        let mut query = Query::new(terrain, 1 << 20);
        for (from, to) in ends {
            let [origin, end] = [from, to].map(|place| world(&source, place));
            let direction: [f64; 3] = std::array::from_fn(|axis| end[axis] - origin[axis]);
            if direction == [0.0; 3] {
                continue;
            }
            let ray = Ray { origin, direction, longest: 1.0 };
            let hit = query.ray_intersect(&ray).unwrap();
            let point = |t: f64| [0, 1, 2].map(|axis| origin[axis] + t * direction[axis]);
            let until = hit.map_or(1.0, |hit| hit.distance);
            prop_assert!((0.0..=1.0).contains(&until));
            if let Some(hit) = hit {
                let length = direction.iter().map(|along| along * along).sum::<f64>().sqrt();
                prop_assert_eq!(hit.level, query.terrain().lattice().levels());
                // On the edge of a void rounding may take the place to its other side.
                if let Some(height) = above(&mut query, hit.place) {
                    prop_assert!(height.abs() <= 1e-7 * (1.0 + length), "{} above", height);
                } else {
                    prop_assert!(scene.voids != Voids::None || is_at_the_border(&source, hit.place));
                }
            }
            // Up to there it stays on one side, but where voids let it change that.
            if scene.voids != Voids::None {
                continue;
            }
            let mut sides = (0..=300)
                .filter_map(|step| above(&mut query, point(until * f64::from(step) / 300.0)))
                .filter(|height| height.abs() > 1e-5);
            if let Some(first) = sides.next() {
                prop_assert!(sides.all(|height| (height > 0.0) == (first > 0.0)), "{:?} {:?}", ray, hit);
            }
        }
    }

    #[test]
    fn no_ray_slips_through(
        scene in scenes(),
        ends in prop::collection::vec(([0u32..=256, 0u32..=256], [0u32..=256, 0u32..=256], 0.0f64..1.0), 100),
    ) {
        let scene = Scene { voids: Voids::None, ..scene };
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let mut query = Query::new(repository(&source, &lossless()), 1 << 20);
        for (from, to, depth) in ends {
            let ends = [from, to].map(|place| place.map(|k| f64::from(k) / 256.0));
            let [mut origin, mut end] = ends.map(|at| world(&source, (at, 0.0)));
            let [first, last] = [origin, end].map(|at| above(&mut query, at).unwrap());
            // From just above the surface to just below it, grazing what lies between.
            origin[2] -= first - 1e-3 - depth;
            end[2] -= last + 1e-3;
            let direction: [f64; 3] = std::array::from_fn(|axis| end[axis] - origin[axis]);
            let ray = Ray { origin, direction, longest: 1.0 };
            prop_assert!(query.ray_intersect(&ray).unwrap().is_some(), "{:?}", ray);
            prop_assert!(!query.is_in_sight(origin, end).unwrap());
        }
    }
}

proptest! {
    #![proptest_config(config(32))]

    #[test]
    fn no_ray_slips_through_ground_that_a_repair_left_coarse(
        scene in scenes(),
        places in prop::collection::vec(0.0f64..1.0, 1..4),
        ends in prop::collection::vec(([0u32..=256, 0u32..=256], [0u32..=256, 0u32..=256], 0.0f64..1.0), 100),
    ) {
        let scene = Scene { voids: Voids::None, ..scene };
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let mut query = Query::new(repaired_repository(&source, &lossless(), &places), 1 << 20);
        for (from, to, depth) in ends {
            let ends = [from, to].map(|place| place.map(|k| f64::from(k) / 256.0));
            let [mut origin, mut end] = ends.map(|at| world(&source, (at, 0.0)));
            let [Some(first), Some(last)] = [origin, end].map(|at| above(&mut query, at)) else {
                continue;
            };
            origin[2] -= first - 1e-3 - depth;
            end[2] -= last + 1e-3;
            let direction: [f64; 3] = std::array::from_fn(|axis| end[axis] - origin[axis]);
            let ray = Ray { origin, direction, longest: 1.0 };
            let hit = query.ray_intersect(&ray).unwrap();
            prop_assert!(hit.is_some(), "{:?}", ray);
            let height = hit.and_then(|hit| above(&mut query, hit.place));
            let length = direction.iter().map(|along| along * along).sum::<f64>().sqrt();
            prop_assert!(height.is_none_or(|height| height.abs() < 1e-7 * (1.0 + length)), "{:?} {:?}", ray, height);
        }
    }
}

/// Within rounding of the outermost rows and columns.
fn is_at_the_border(source: &MemorySource, [x, y, _]: [f64; 3]) -> bool {
    let place = source.frame().world_to_grid(x, y);
    let ends = [source.raster.width - 1, source.raster.height - 1].map(f64::from);
    (0..2).any(|axis| place[axis].abs() < 1e-4 || (place[axis] - ends[axis]).abs() < 1e-4)
}

#[test]
fn rays_that_mean_nothing_are_refused() {
    let source = MemorySource::rough(hills(33, 33, 1, Voids::None), 3, 0.0);
    let mut query = Query::new(repository(&source, &lossless()), 1 << 20);
    let good = Ray {
        origin: [0.0, 0.0, 900.0],
        direction: [0.0, 0.0, -1.0],
        longest: f64::INFINITY,
    };
    let mut rays = [good; 5];
    rays[0].origin[1] = f64::NAN;
    rays[1].direction[0] = f64::INFINITY;
    rays[2].direction = [0.0; 3];
    rays[3].longest = -1.0;
    rays[4].longest = f64::NAN;
    for ray in rays {
        assert!(query.ray_intersect(&ray).is_err(), "{ray:?}");
    }
    assert_eq!(
        query.ray_intersect(&good).unwrap(),
        None,
        "beside the raster"
    );
}
