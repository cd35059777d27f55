//! Statistics of polygons against their surface, triangle by triangle.

use crate::profiles::{ground, lossless};
use crate::scenes::*;
use crate::support::memory::MemorySource;
use crate::support::repositories::{repaired_repository, repository};
use crate::surface::{Corner, Ground};
use kimberlite::build::BuildOptions;
use kimberlite::cut::{AreaStatistics, DiamondSource, Query, Terrain};
use proptest::prelude::*;
use std::f64::consts::TAU;

type Polygon = Vec<[f64; 2]>;

/// Polygons in fractions of the raster's sides: boxes, and stars that may have any angles.
fn polygons() -> impl Strategy<Value = Polygon> {
    let along = || -0.3f64..1.3;
    let boxes = ([along(), along()], [along(), along()])
        .prop_map(|([a, b], [c, d])| vec![[a, b], [c, b], [c, d], [a, d]]);
    let corner = (0.05f64..0.95, 0.02f64..0.7);
    let stars = ([along(), along()], prop::collection::vec(corner, 3..12));
    let stars = stars.prop_map(|(middle, corners)| {
        let count = corners.len() as f64;
        let corner = |(index, (turn, radius)): (usize, (f64, f64))| {
            let angle = TAU * (index as f64 + turn) / count;
            [
                middle[0] + radius * angle.cos(),
                middle[1] + radius * angle.sin(),
            ]
        };
        corners.into_iter().enumerate().map(corner).collect()
    });
    prop_oneof![boxes, stars]
}

/// In samples; to halves of them if `is_round`.
fn in_samples(polygon: &Polygon, size: [usize; 2], is_round: bool) -> Polygon {
    let along = |share: f64, side: usize| {
        let exact = share * (side - 1) as f64;
        if is_round {
            (2.0 * exact).round() / 2.0
        } else {
            exact
        }
    };
    let point = |point: &[f64; 2]| [0, 1].map(|axis| along(point[axis], size[axis]));
    polygon.iter().map(point).collect()
}

fn world(terrain: &Terrain, polygon: &Polygon) -> Polygon {
    let point = |point: &[f64; 2]| terrain.frame().grid_to_world(point[0], point[1]);
    polygon.iter().map(point).collect()
}

fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn signed_area(polygon: &Polygon) -> f64 {
    let first = polygon[0];
    polygon
        .windows(2)
        .map(|pair| cross(first, pair[0], pair[1]) / 2.0)
        .sum()
}

/// The polygon within one side of a triangle, with edges there and back where it falls apart.
fn cut_off(polygon: &Polygon, [a, b]: [[f64; 2]; 2]) -> Polygon {
    let mut kept = Vec::new();
    for (index, &point) in polygon.iter().enumerate() {
        let next = polygon[(index + 1) % polygon.len()];
        let (here, there) = (cross(a, b, point), cross(a, b, next));
        if here >= 0.0 {
            kept.push(point);
        }
        if here * there < 0.0 {
            let share = here / (here - there);
            kept.push([0, 1].map(|axis| point[axis] + share * (next[axis] - point[axis])));
        }
    }
    kept
}

/// Area of the polygon within a triangle, and the integral of the height over it.
fn share_of(polygon: &Polygon, triangle: [Corner; 3]) -> [f64; 2] {
    let [a, mut b, mut c] = triangle;
    let flat = |corner: Corner| [corner[0], corner[1]];
    if cross(flat(a), flat(b), flat(c)) < 0.0 {
        (b, c) = (c, b);
    }
    let whole = cross(flat(a), flat(b), flat(c));
    let height = |at: [f64; 2]| {
        let second = cross(flat(a), at, flat(c)) / whole;
        let third = cross(flat(a), flat(b), at) / whole;
        a[2] + second * (b[2] - a[2]) + third * (c[2] - a[2])
    };
    let mut rest = polygon.clone();
    for side in [[a, b], [b, c], [c, a]] {
        rest = cut_off(&rest, side.map(flat));
    }
    let Some(&first) = rest.first() else {
        return [0.0; 2];
    };
    // What edges there and back enclose comes to nothing.
    let mut share = [0.0; 2];
    for pair in rest.windows(2) {
        let area = cross(first, pair[0], pair[1]) / 2.0;
        let mean = (height(first) + height(pair[0]) + height(pair[1])) / 3.0;
        share = [share[0] + area, share[1] + area * mean];
    }
    share
}

fn is_within(polygon: &Polygon, [column, row]: [f64; 2]) -> bool {
    let mut is_within = false;
    for (index, a) in polygon.iter().enumerate() {
        let b = polygon[(index + 1) % polygon.len()];
        if (a[1] > row) != (b[1] > row) {
            let crossing = a[0] + (row - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
            is_within ^= column < crossing;
        }
    }
    is_within
}

/// Area in square samples and the height's integral over it.
fn totals(ground: &Ground, polygon: &Polygon) -> [f64; 2] {
    let mut polygon = polygon.clone();
    if signed_area(&polygon) < 0.0 {
        polygon.reverse();
    }
    let mut totals = [0.0; 2];
    for row in 0..ground.size[1] - 1 {
        for column in 0..ground.size[0] - 1 {
            for triangle in ground.triangles([column, row]).into_iter().flatten() {
                let [area, volume] = share_of(&polygon, triangle);
                totals = [totals[0] + area, totals[1] + volume];
            }
        }
    }
    totals
}

/// Least and greatest height at samples inside, along the edges, and at the corners of what is drawn.
fn extremes(query: &mut Query, ground: &Ground, polygon: &Polygon) -> [f64; 2] {
    let mut heights = Vec::new();
    for row in 0..ground.size[1] - 1 {
        for column in 0..ground.size[0] - 1 {
            for corner in ground
                .triangles([column, row])
                .into_iter()
                .flatten()
                .flatten()
            {
                if is_within(polygon, [corner[0], corner[1]]) {
                    heights.push(corner[2]);
                }
            }
        }
    }
    let mut line = world(query.terrain(), polygon);
    line.push(line[0]);
    let along = query.profile(&line).unwrap();
    heights.extend(along.iter().filter_map(|place| Some(place.height?.height)));
    let least = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    [least, greatest]
}

fn near(a: f64, b: f64, scale: f64) -> bool {
    (a - b).abs() <= 1e-9 * (1.0 + scale)
}

proptest! {
    #![proptest_config(config(24))]

    #[test]
    fn statistics_are_those_of_all_triangles_clipped_to_the_polygon(
        scene in scenes(),
        polygons in prop::collection::vec((polygons(), any::<bool>()), 8),
        bytes in prop_oneof![Just(0u64), Just(1 << 22)],
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let terrain = repository(&source, &lossless());
        let ground = ground(&terrain, &source);
        let mut query = Query::new(terrain.clone(), bytes);
        for (polygon, is_round) in polygons {
            let polygon = in_samples(&polygon, ground.size, is_round);
            let Ok(found) = query.area_statistics(&world(&terrain, &polygon)) else {
                // Rounding may make a polygon flat or cross itself.
                prop_assert!(is_round || signed_area(&polygon) == 0.0);
                continue;
            };
            let [area, volume] = totals(&ground, &polygon);
            let scale = area.abs() + signed_area(&polygon).abs();
            let Some(found) = found else {
                prop_assert!(near(area, 0.0, scale));
                continue;
            };
            let step = terrain.frame().step;
            let samples = found.area / (step[0] * step[1]).abs();
            prop_assert!(near(samples, area, scale), "{} not {}", samples, area);
            prop_assert!(near(found.mean * samples, volume, 1e4 * scale), "{:?} not {}", found, volume / area);
            let [least, greatest] = extremes(&mut query, &ground, &polygon);
            // Of what is only touched nothing counts; rounding gives stars spikes without area.
            let is_box = polygon.len() == 4
                && (0..2).all(|k| {
                    polygon[2 * k][1] == polygon[2 * k + 1][1] && polygon[k][0] == polygon[3 - k][0]
                });
            let has_spikes = is_round && !is_box;
            prop_assert!(found.minimum >= least - 1e-5 && found.maximum <= greatest + 1e-5);
            if scene.voids == Voids::None && area > 1e-6 && !has_spikes {
                prop_assert!(found.minimum <= least + 1e-5, "{:?} not {}", found, least);
                prop_assert!(found.maximum >= greatest - 1e-5, "{:?} not {}", found, greatest);
            }
            prop_assert!(found.minimum <= found.mean && found.mean <= found.maximum);
            prop_assert_eq!((found.error_bound, found.level), (0.0, terrain.lattice().levels()));
        }
    }

    #[test]
    fn a_byte_limit_changes_no_statistics(scene in scenes(), polygon in polygons()) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let terrain = repository(&source, &lossless());
        let size = [source.raster.width, source.raster.height].map(|side| side as usize);
        let polygon = world(&terrain, &in_samples(&polygon, size, false));
        let found = [0, 1 << 16, u64::MAX]
            .map(|bytes| Query::new(terrain.clone(), bytes).area_statistics(&polygon).unwrap());
        prop_assert_eq!(found[0], found[1]);
        prop_assert_eq!(found[0], found[2]);
    }

    #[test]
    fn statistics_over_missing_detail_have_a_bound_that_holds(
        scene in scenes(),
        damage in prop::collection::vec(0.0f64..1.0, 1..4),
        polygons in prop::collection::vec(polygons(), 8),
        max_error in prop_oneof![Just(0.0), Just(9.0)],
    ) {
        let source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        let options = BuildOptions { max_error, ..lossless() };
        let terrain = repaired_repository(&source, &options, &damage);
        let ground = ground(&terrain, &source);
        let (mut query, levels) = (Query::new(terrain.clone(), 1 << 20), terrain.lattice().levels());
        for polygon in polygons {
            let polygon = in_samples(&polygon, ground.size, false);
            let Ok(Some(found)) = query.area_statistics(&world(&terrain, &polygon)) else {
                continue;
            };
            let AreaStatistics { error_bound, level, .. } = found;
            prop_assert!(level <= levels);
            if level == levels {
                prop_assert_eq!(error_bound, terrain.header().max_error * 0.5);
            }
            // The ground inside, by heights at the samples that are there.
            let [area, volume] = totals(&ground, &polygon);
            if !error_bound.is_finite() || area < 1e-6 {
                continue;
            }
            let limit = error_bound + 1e-6;
            prop_assert!((found.mean - volume / area).abs() <= limit, "{:?} not {}", found, volume / area);
            for row in 0..ground.size[1] {
                for column in 0..ground.size[0] {
                    let at = [column as f64, row as f64];
                    let Some(height) = ground.height(at).filter(|_| is_within(&polygon, at)) else {
                        continue;
                    };
                    prop_assert!(found.minimum <= height + limit && height - limit <= found.maximum);
                }
            }
        }
    }
}

#[test]
fn polygons_that_mean_nothing_are_refused() {
    let source = MemorySource::rough(hills(33, 33, 1, Voids::None), 3, 0.0);
    let terrain = repository(&source, &lossless());
    let mut query = Query::new(terrain.clone(), 1 << 20);
    let polygons: [&[[f64; 2]]; 7] = [
        &[],
        &[[1.0, 1.0], [5.0, 5.0]],
        &[[1.0, 1.0], [5.0, f64::NAN], [9.0, 9.0]],
        &[[1.0, 1.0], [5.0, f64::INFINITY], [9.0, 9.0]],
        &[[1.0, 1.0], [1e200, 1.0], [9.0, 1e200]],
        // Along one line, and a box whose sides are crossed.
        &[[1.0, 1.0], [5.0, 5.0], [9.0, 9.0], [3.0, 3.0]],
        &[[1.0, 1.0], [9.0, 9.0], [9.0, 1.0], [1.0, 9.0]],
    ];
    for polygon in polygons {
        let error = query.area_statistics(&world(&terrain, &polygon.to_vec()));
        assert!(error.is_err(), "{polygon:?}: {error:?}");
    }
    let beside = vec![[40.0, 1.0], [50.0, 1.0], [50.0, 9.0]];
    let found = query.area_statistics(&world(&terrain, &beside)).unwrap();
    assert_eq!(found, None);
}

#[test]
fn a_polygon_may_have_a_hole_that_a_bridge_leads_to() {
    let source = MemorySource::rough(hills(65, 65, 1, Voids::None), 3, 0.0);
    let terrain = repository(&source, &lossless());
    let mut query = Query::new(terrain.clone(), 1 << 20);
    let outer = [[10.0, 10.0], [50.5, 10.0], [50.5, 40.25], [10.0, 40.25]];
    let hole = [[20.0, 20.0], [20.0, 30.0], [30.5, 30.0], [30.5, 20.0]];
    let mut area = |polygon: Polygon| {
        let found = query
            .area_statistics(&world(&terrain, &polygon))
            .unwrap()
            .unwrap();
        (found.area / 900.0, found.mean)
    };
    let (whole, inner) = (area(outer.to_vec()), area(hole.to_vec()));
    let bridged = [&outer[..], &outer[..1], &hole[..], &hole[..1]].concat();
    let (rest, mean) = area(bridged);
    assert!((whole.0 - 40.5 * 30.25).abs() < 1e-6 && (inner.0 - 105.0).abs() < 1e-6);
    assert!((rest - (whole.0 - inner.0)).abs() < 1e-6);
    let volume = whole.0 * whole.1 - inner.0 * inner.1;
    assert!(
        (mean * rest - volume).abs() < 1e-3,
        "{} not {volume}",
        mean * rest
    );
}
