//! Profiles along lines against the surface that they cross.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use crate::support::repositories::{repaired_repository, repository};
use crate::surface::Ground;
use kimberlite::build::BuildOptions;
use kimberlite::cut::{DiamondSource, ProfilePlace, Query, Terrain};
use proptest::prelude::*;

pub fn lossless() -> BuildOptions {
    BuildOptions {
        max_error: 0.0,
        cells_log2: 4,
        threads: 1,
        ..BuildOptions::default()
    }
}

pub fn ground(terrain: &Terrain, source: &MemorySource) -> Ground {
    let sample = |sample: &Option<i32>| sample.map_or(f64::NAN, f64::from);
    let samples: Vec<f64> = source.raster.samples.iter().map(sample).collect();
    Ground::new(terrain, &samples)
}

/// How a line goes on from its last point.
#[derive(Clone, Copy, Debug)]
enum Step {
    /// To a place in fractions of the raster's sides, on a sample or half way between two if `is_round`.
    To { at: [f64; 2], is_round: bool },
    /// So many samples along columns and rows: along a row, a column, a diagonal, or not at all.
    By([i32; 2]),
}

fn lines() -> impl Strategy<Value = Vec<Step>> {
    let to = ([-0.3f64..1.3, -0.3f64..1.3], any::<bool>())
        .prop_map(|(at, is_round)| Step::To { at, is_round });
    let by = (-40i32..40, -1i32..2, -1i32..2).prop_map(|(n, x, y)| Step::By([n * x, n * y]));
    prop::collection::vec(prop_oneof![to, by], 2..7)
}

fn grid_points(steps: &[Step], size: [usize; 2]) -> Vec<[f64; 2]> {
    let mut at = size.map(|side| (side / 2) as f64);
    let to_point = |step: &Step| {
        at = match *step {
            Step::By(by) => [0, 1].map(|axis| at[axis] + f64::from(by[axis])),
            Step::To { at, is_round } => {
                let exact = [0, 1].map(|axis| at[axis] * (size[axis] - 1) as f64);
                exact.map(|along| {
                    if is_round {
                        (2.0 * along).round() / 2.0
                    } else {
                        along
                    }
                })
            }
        };
        at
    };
    steps.iter().map(to_point).collect()
}

fn world(terrain: &Terrain, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let world = points
        .iter()
        .map(|point| terrain.frame().grid_to_world(point[0], point[1]));
    world.collect()
}

/// Between which of a line's points each stretch of a profile lies, and that the places are in order and complete.
fn check_order(line: &[[f64; 2]], places: &[ProfilePlace]) -> Result<(), TestCaseError> {
    let mut start = 0.0;
    let mut ends = vec![0.0];
    for pair in line.windows(2) {
        start += f64::hypot(pair[1][0] - pair[0][0], pair[1][1] - pair[0][1]);
        ends.push(start);
    }
    for pair in places.windows(2) {
        prop_assert!(pair[0].distance <= pair[1].distance);
        let is_edge = pair[0].height.is_none() != pair[1].height.is_none();
        prop_assert_eq!(pair[0].distance == pair[1].distance, is_edge);
    }
    for (point, distance) in line.iter().zip(&ends) {
        let here = |place: &&ProfilePlace| place.place == *point && place.distance == *distance;
        prop_assert!(
            places.iter().any(|place| here(&place)),
            "{point:?} is not there"
        );
    }
    let distances = [places.first(), places.last()].map(|place| place.unwrap().distance);
    prop_assert_eq!(distances, [0.0, start]);
    Ok(())
}

/// Places on all stretches, by shares of them, and the heights that the profile has there.
fn between(places: &[ProfilePlace]) -> Vec<([f64; 2], Option<f64>, [ProfilePlace; 2])> {
    let mut between = Vec::new();
    for pair in places
        .windows(2)
        .filter(|pair| pair[0].distance < pair[1].distance)
    {
        for share in [0.303, 0.469, 0.711] {
            let mix = |a: f64, b: f64| a + share * (b - a);
            let at = [0, 1].map(|axis| mix(pair[0].place[axis], pair[1].place[axis]));
            let height = pair[0].height.zip(pair[1].height);
            let height = height.map(|(first, last)| mix(first.height, last.height));
            between.push((at, height, [pair[0], pair[1]]));
        }
    }
    between
}

/// Whether rounding may take a place of a stretch to the other side of an edge.
fn is_tiny(terrain: &Terrain, stretch: &[ProfilePlace; 2]) -> bool {
    stretch[1].distance - stretch[0].distance < 1e-3 * terrain.frame().step[0].abs()
}

proptest! {
    #![proptest_config(config(48))]

    #[test]
    fn a_profile_is_straight_between_its_places_and_on_the_surface(
        scene in scenes(),
        lines in prop::collection::vec(lines(), 20),
        bytes in prop_oneof![Just(0u64), Just(1 << 22)],
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let terrain = repository(&source, &lossless());
        let ground = ground(&terrain, &source);
        let mut query = Query::new(terrain.clone(), bytes);
        for steps in lines {
            let line = world(&terrain, &grid_points(&steps, ground.size));
            let places = query.profile(&line).unwrap();
            check_order(&line, &places)?;
            for (at, height, stretch) in between(&places) {
                let grid = terrain.frame().world_to_grid(at[0], at[1]);
                let near = ground.heights_near(grid, 1e-5);
                let Some(height) = height else {
                    let is_void = near.iter().all(|near| near.is_none());
                    prop_assert!(is_void || is_tiny(&terrain, &stretch), "ground at {:?}", grid);
                    continue;
                };
                let mut near = near.iter().flatten();
                prop_assert!(near.any(|near| (near - height).abs() < 0.05), "{} at {:?}", height, grid);
                if let Some(exact) = ground.height(grid) {
                    prop_assert!((exact - height).abs() < 1e-5, "{} not {} at {:?}", height, exact, grid);
                }
                let levels = stretch.map(|place| place.height.unwrap().level);
                prop_assert_eq!(levels, [terrain.lattice().levels(); 2]);
            }
        }
    }

    #[test]
    fn a_profile_over_missing_detail_is_what_heights_are_there(
        scene in scenes(),
        places in prop::collection::vec(0.0f64..1.0, 1..4),
        lines in prop::collection::vec(lines(), 20),
        max_error in prop_oneof![Just(0.0), Just(9.0)],
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let options = BuildOptions { max_error, ..lossless() };
        let terrain = repaired_repository(&source, &options, &places);
        let (ground, levels) = (ground(&terrain, &source), terrain.lattice().levels());
        let mut query = Query::new(terrain.clone(), 1 << 20);
        for steps in lines {
            let line = world(&terrain, &grid_points(&steps, ground.size));
            let places = query.profile(&line).unwrap();
            check_order(&line, &places)?;
            for (at, height, stretch) in between(&places) {
                if is_tiny(&terrain, &stretch) {
                    continue;
                }
                let exact = query.height_at_world(at[0], at[1]).unwrap();
                let (Some(height), Some(exact)) = (height, exact) else {
                    // A line along the edge of a void is on the surface; coarse triangles are drawn over voids, of which
                    // heights know some.
                    let may_be_void = |end: ProfilePlace| end.height.is_some_and(|h| h.error_bound.is_infinite());
                    let step = 1e-3;
                    let mut around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]]
                        .map(|by| query.height_at_world(at[0] + by[0], at[1] + by[1]).unwrap())
                        .into_iter();
                    prop_assert!(
                        height.is_some() == exact.is_some()
                            || exact.is_none() && stretch.into_iter().all(may_be_void)
                            || around.any(|side| side.is_some() == height.is_some())
                    );
                    continue;
                };
                let difference = (height - exact.height).abs();
                prop_assert!(difference < 1e-5, "{} not {:?} at {:?}", height, exact, at);
                let grid = terrain.frame().world_to_grid(at[0], at[1]);
                let Some(input) = ground.height(grid) else {
                    continue;
                };
                for end in stretch.map(|place| place.height.unwrap()) {
                    prop_assert!((height - input).abs() <= end.error_bound + 1e-5, "{:?} at {:?}", end, grid);
                    prop_assert!(end.level == levels || end.error_bound >= terrain.header().max_error * 0.5);
                }
            }
        }
    }

    #[test]
    fn samples_of_a_profile_are_evenly_spaced_heights(
        scene in scenes(),
        steps in lines(),
        count in 0usize..200,
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let terrain = repository(&source, &lossless());
        let size = [source.raster.width, source.raster.height].map(|side| side as usize);
        let line = world(&terrain, &grid_points(&steps, size));
        let mut query = Query::new(terrain, 1 << 20);
        let samples = query.profile_samples(&line, count).unwrap();
        prop_assert_eq!(samples.len(), count);
        let all = query.profile(&line).unwrap();
        let total = all.last().unwrap().distance;
        for (index, sample) in samples.iter().enumerate() {
            let share = index as f64 / (count.max(2) - 1) as f64;
            prop_assert!((sample.distance - share * total).abs() <= 1e-9 * total);
            let [x, y] = sample.place;
            prop_assert_eq!(sample.height, query.height_at_world(x, y).unwrap());
            // On the line, that far along it.
            let after = all.partition_point(|place| place.distance < sample.distance);
            let (from, to) = (all[after.max(1) - 1], all[after.min(all.len() - 1)]);
            let length = to.distance - from.distance;
            let share = if length > 0.0 { (sample.distance - from.distance) / length } else { 0.0 };
            for axis in 0..2 {
                let along = from.place[axis] + share * (to.place[axis] - from.place[axis]);
                prop_assert!((along - sample.place[axis]).abs() <= 1e-6);
            }
        }
        if count > 1 {
            prop_assert_eq!(samples[count - 1].place, *line.last().unwrap());
            prop_assert_eq!(samples[count - 1].distance, total);
        }
    }
}

#[test]
fn a_profile_says_where_a_void_begins_and_ends() {
    // Flat ground at 7, and one void at column 5 of row 4: the cells around it are gone along that row.
    let raster = crate::support::memory::Raster::new(12, 9, |column, row| {
        ([column, row] != [5, 4]).then_some(7 + column as i32 / 11)
    });
    let source = MemorySource::rough(raster, 3, 0.0);
    let terrain = repository(&source, &lossless());
    let line = world(&terrain, &[[-2.0, 4.0], [8.0, 4.0]]);
    let places = Query::new(terrain, 0).profile(&line).unwrap();
    let told: Vec<(f64, bool)> = places
        .iter()
        .map(|place| {
            (
                (place.distance / 30.0 * 1e6).round() / 1e6,
                place.height.is_some(),
            )
        })
        .collect();
    let expected = [
        (0.0, false),
        (2.0, false),
        (2.0, true),
        (3.0, true),
        (4.0, true),
        (5.0, true),
        (6.0, true),
        (6.0, false),
        (8.0, false),
        (8.0, true),
        (9.0, true),
        (10.0, true),
    ];
    assert_eq!(told, expected);
}

#[test]
fn lines_that_mean_nothing_are_refused() {
    let source = MemorySource::rough(hills(33, 33, 1, Voids::None), 3, 0.0);
    let terrain = repository(&source, &lossless());
    let mut query = Query::new(terrain.clone(), 1 << 20);
    let inside = terrain.frame().grid_to_world(3.0, 4.0);
    let lines: [&[[f64; 2]]; 5] = [
        &[],
        &[inside],
        &[inside, [f64::NAN, 0.0]],
        &[[f64::INFINITY, 0.0], inside],
        &[[-1e308, 0.0], [1e308, 0.0]],
    ];
    for line in lines {
        assert!(query.profile(line).is_err(), "{line:?}");
        assert!(query.profile_samples(line, 3).is_err(), "{line:?}");
    }
    // A line without length is one place.
    let places = query.profile(&[inside; 3]).unwrap();
    let height = query.height_at_world(inside[0], inside[1]).unwrap();
    assert_eq!((places.len(), places[0].distance), (1, 0.0));
    let difference = places[0].height.unwrap().height - height.unwrap().height;
    assert!(difference.abs() < 1e-9);
}
