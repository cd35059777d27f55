//! All transforms: what each promises, next to voids and borders, at every level.

use crate::against_reference::summary_of;
use crate::rasters::{Raster, decode, decode_diamonds, max_difference, message};
use crate::round_trip::rasters;
use kimberlite::build::{BuildOptions, BuildReport};
use kimberlite::codec::Matrix;
use kimberlite::cut::{DiamondSource, Query, Terrain, Window, level_size, level_step, read_window};
use kimberlite::geo::SampleType;
use kimberlite::lattice::{Diamond, Lattice};
use kimberlite::store::{Access, TransformKind};
use kimberlite::tool;
use proptest::prelude::*;
use std::path::Path;
use std::sync::Arc;

const KINDS: [TransformKind; 3] = [
    TransformKind::Interpolating,
    TransformKind::Lifted,
    TransformKind::TwoStage,
];

/// How far the decoded samples may be from the input.
#[derive(Clone, Copy, Debug)]
pub enum Limit {
    Max(f64),
    Rms(f64),
}

pub fn options(transform: TransformKind, limit: Limit, cells_log2: u32) -> BuildOptions {
    let (max_error, rms_error) = match limit {
        Limit::Max(error) => (error, None),
        Limit::Rms(error) => (0.0, Some(error)),
    };
    BuildOptions {
        transform,
        max_error,
        rms_error,
        cells_log2,
        threads: 2,
        ..BuildOptions::default()
    }
}

/// Builds, and checks what the file says of itself against its input.
fn build(raster: &Raster, path: &Path, transform: TransformKind, limit: Limit) -> BuildReport {
    let report = raster
        .build_with(path, &options(transform, limit, 4))
        .unwrap();
    let error = max_difference(&decode(path, Access::Map).unwrap(), &raster.samples);
    assert_eq!(error, report.max_error, "{transform:?} {limit:?}");
    match limit {
        Limit::Max(limit) => assert!(error <= limit, "{transform:?}: {error} over {limit}"),
        Limit::Rms(limit) => assert!(report.rms_error <= limit, "{report:?} over {limit}"),
    }
    let terrain = Terrain::open(path, Access::Map).unwrap();
    let mut input = raster.source();
    let verdict = tool::verify(&terrain, Some(&mut input), &mut |_, _| true).unwrap();
    assert!(verdict.ok, "{transform:?} {limit:?}");
    report
}

fn amplitude(raster: &Raster) -> f64 {
    let valid = raster.samples.iter().filter(|sample| !sample.is_nan());
    valid.fold(1.0f64, |a, sample| a.max(sample.abs()))
}

fn limits(raster: &Raster, transform: TransformKind, share: f64) -> Vec<Limit> {
    let error = (share + 1e-3) * amplitude(raster);
    let mut limits = Vec::new();
    if raster.info.sample_type.is_integer() {
        limits.push(Limit::Max(0.0));
    }
    limits.push(match transform {
        TransformKind::Lifted => Limit::Rms(error),
        _ => Limit::Max(error),
    });
    limits
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn every_transform_keeps_its_promise(raster in rasters(), share in 0.0f64..0.3) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for transform in KINDS {
            for limit in limits(&raster, transform, share) {
                build(&raster, &path, transform, limit);
            }
        }
    }

    #[test]
    fn two_stage_keeps_every_level_within_the_bound_of_its_filtered_data(
        raster in rasters(),
        share in 0.0f64..0.1,
    ) {
        prop_assume!(raster.info.sample_type.is_integer());
        let folder = tempfile::tempdir().unwrap();
        let max_error = (share * amplitude(&raster)).floor();
        let [filtered, coded] = [0.0, max_error].map(|error| {
            let path = folder.path().join(format!("{error}.kmb"));
            build(&raster, &path, TransformKind::TwoStage, Limit::Max(error));
            let terrain = Terrain::open(&path, Access::Map).unwrap();
            decode_diamonds(&terrain)
        });
        for (diamond, (vertices, _)) in &filtered {
            let found = &coded[diamond].0;
            for (index, &height) in vertices.values.iter().enumerate() {
                prop_assert_eq!(vertices.is_valid(index), found.is_valid(index));
                if vertices.is_valid(index) {
                    let error = (i64::from(height) - i64::from(found.values[index])).abs();
                    prop_assert!(error as f64 <= max_error, "level {}: {}", diamond.level(), error);
                }
            }
        }
    }

    #[test]
    fn refining_changes_no_boundary_vertex_and_no_vertex_without_data(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for transform in KINDS {
            let limit = limits(&raster, transform, 0.01).pop().unwrap();
            build(&raster, &path, transform, limit);
            let terrain = Terrain::open(&path, Access::Map).unwrap();
            let cells = terrain.lattice().cells();
            let mut has_changed = false;
            for (own, refined) in decode_diamonds(&terrain).values() {
                let Some(next) = refined.as_ref().and_then(|refined| refined.vertices.as_ref()) else {
                    continue;
                };
                prop_assert_eq!(&next.valid, &own.valid);
                for index in 0..own.values.len() {
                    let (i, j) = (index % (cells + 1), index / (cells + 1));
                    let is_inner = (1..cells).contains(&i) && (1..cells).contains(&j);
                    has_changed |= next.values[index] != own.values[index];
                    if !is_inner || !own.is_valid(index) {
                        prop_assert_eq!(next.values[index], own.values[index]);
                    }
                }
            }
            prop_assert!(!has_changed || transform != TransformKind::Interpolating);
        }
    }

    #[test]
    fn a_window_of_a_level_is_that_level_and_a_query_the_finest(raster in rasters(), limit in 0u64..100_000) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for transform in KINDS {
            let error = limits(&raster, transform, 0.02).pop().unwrap();
            build(&raster, &path, transform, error);
            let terrain = Arc::new(Terrain::open(&path, Access::Map).unwrap());
            let all = decode_diamonds(&terrain);
            let lattice = terrain.lattice();
            let cells = lattice.cells();
            for level in (0..=lattice.levels()).step_by(2) {
                let step = i64::from(level_step(&terrain, level).unwrap());
                let [width, height] = level_size(&terrain, level).unwrap();
                let (column, row) = (width / 3, height / 2);
                let window = Window { column, row, width: (width - column).div_ceil(2), height: height - row };
                let mut samples = vec![0.0; (window.width * window.height) as usize];
                read_window(&terrain, level, window, &mut samples).unwrap();
                for diamond in lattice.diamonds(level) {
                    let (vertices, placement) = (&all[&diamond].0, lattice.placement(diamond));
                    for (index, &unit) in vertices.values.iter().enumerate() {
                        let [x, y] = placement.vertex(index % (cells + 1), index / (cells + 1));
                        let (x, y) = (x / step - i64::from(column), y / step - i64::from(row));
                        let inside = (0..i64::from(window.width)).contains(&x)
                            && (0..i64::from(window.height)).contains(&y);
                        if inside {
                            let found = samples[(y * i64::from(window.width) + x) as usize];
                            let expected = terrain.units().to_sample(unit);
                            prop_assert!(found == expected || found.is_nan() && !vertices.is_valid(index));
                        }
                    }
                }
            }
            let finest = decode(&path, Access::Map).unwrap();
            let mut query = Query::new(terrain.clone(), limit);
            for (index, expected) in finest.iter().enumerate().step_by(37) {
                let (column, row) = (index as u32 % raster.info.width, index as u32 / raster.info.width);
                match query.height_at_grid(f64::from(column), f64::from(row)).unwrap() {
                    Some(found) => {
                        prop_assert!((found.height - expected).abs() <= 1e-9 * amplitude(&raster))
                    }
                    None => prop_assert!(expected.is_nan()),
                }
            }
        }
    }

    #[test]
    fn threads_do_not_change_the_bytes(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        for transform in KINDS {
            let limit = limits(&raster, transform, 0.01).pop().unwrap();
            let files = [1, 2, 5].map(|threads| {
                let path = folder.path().join(format!("{threads}.kmb"));
                let options = BuildOptions { threads, ..options(transform, limit, 4) };
                kimberlite::build::build(&mut raster.source(), &options, &path, &mut |_, _| true).unwrap();
                std::fs::read(&path).unwrap()
            });
            prop_assert!(files[0] == files[1] && files[1] == files[2]);
        }
    }

    #[test]
    fn a_range_contains_every_height_below_it(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for transform in KINDS {
            let limit = limits(&raster, transform, 0.01).pop().unwrap();
            build(&raster, &path, transform, limit);
            let terrain = Terrain::open(&path, Access::Map).unwrap();
            let (lattice, all) = (terrain.lattice(), decode_diamonds(&terrain));
            for (&diamond, (vertices, _)) in &all {
                if diamond.level() == lattice.levels() {
                    continue;
                }
                let [low, high] = summary_of(&terrain, diamond).range;
                let children = lattice.children(diamond).into_iter().flatten();
                let below = children.flat_map(|child| half_of(lattice, child, diamond, &all[&child].0));
                for height in vertices.values.iter().copied().chain(below) {
                    prop_assert!((low..=high).contains(&height), "{:?}: {} to {}, {}", transform, low, high, height);
                }
            }
        }
    }
}

/// Heights of the half of `child` that comes from `parent`.
fn half_of(lattice: &Lattice, child: Diamond, parent: Diamond, vertices: &Matrix) -> Vec<i32> {
    let parents = lattice.parents(child);
    let half = parents
        .iter()
        .position(|&other| other == Some(parent))
        .unwrap();
    let (apex, cells) = (lattice.apexes(child)[half], lattice.cells() as i64);
    let row = |j: i64| {
        let (first, last) = apex.row(cells, j);
        let place = |i: i64| vertices.values[(j * (cells + 1) + i) as usize];
        (first..=last).map(place).collect::<Vec<i32>>()
    };
    (0..=cells).flat_map(row).collect()
}

fn bumpy(column: u32, row: u32) -> f64 {
    let noise = (column * 7919 + row * 104_729) % 61;
    f64::from(noise) + (f64::from(column) * 0.3).sin() * 200.0 + f64::from(row) * 3.0
}

/// Yes or no by column and row.
type Pattern = fn(u32, u32) -> bool;

/// Where voids are; (32, 32) is the root's centre on 65 x 65.
const VOIDS: [(&str, Pattern); 9] = [
    ("none", |_, _| false),
    ("single samples", |c, r| (c * 13 + r * 7) % 31 == 0),
    ("single samples that are not", |c, r| {
        (c * 13 + r * 7) % 31 != 0
    }),
    ("a checkerboard", |c, r| (c + r) % 2 == 0),
    ("the other checkerboard", |c, r| (c + r) % 2 == 1),
    ("all", |_, _| true),
    ("a cross through the centre", |c, r| c == 32 || r == 32),
    ("a diagonal cross", |c, r| c == r || c + r == 64),
    ("a half", |c, r| 3 * c > 2 * r + 20),
];

#[test]
fn every_void_pattern_is_exact_under_every_transform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    for (name, is_void) in VOIDS {
        for (width, height) in [(65, 65), (66, 64), (97, 40)] {
            let samples = (0..width * height).map(|index| {
                let (column, row) = (index % width, index / width);
                let height = bumpy(column, row).round();
                if is_void(column, row) {
                    f64::NAN
                } else {
                    height
                }
            });
            let raster = Raster::new(width, height, SampleType::I16, samples.collect());
            for transform in KINDS {
                println!("{name}, {width} x {height}, {transform:?}");
                build(&raster, &path, transform, Limit::Max(0.0));
                let lossy = match transform {
                    TransformKind::Lifted => Limit::Rms(5.0),
                    _ => Limit::Max(9.0),
                };
                build(&raster, &path, transform, lossy);
            }
        }
    }
}

#[test]
fn extremes_of_16_and_32_bits_overflow_no_transform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let types = [
        (SampleType::I16, f64::from(i16::MIN), f64::from(i16::MAX)),
        (SampleType::I32, f64::from(i32::MIN), f64::from(i32::MAX)),
        (SampleType::U32, 0.0, f64::from(u32::MAX)),
    ];
    let patterns: [Pattern; 4] = [
        |c, r| (c + r) % 2 == 0,
        |c, _| c % 2 == 0,
        |c, r| (c / 2 + r / 2) % 2 == 0,
        |c, r| (c * c + 3 * r * c + r).is_multiple_of(5),
    ];
    for (sample_type, low, high) in types {
        for is_low in patterns {
            let samples = (0..70 * 50).map(|k| if is_low(k % 70, k / 70) { low } else { high });
            let raster = Raster::new(70, 50, sample_type, samples.collect());
            for transform in KINDS {
                build(&raster, &path, transform, Limit::Max(0.0));
                for share in [1e-6, 1e-3, 0.3, 2.0] {
                    let error = share * (high - low);
                    build(
                        &raster,
                        &path,
                        transform,
                        match transform {
                            TransformKind::Lifted => Limit::Rms(error),
                            _ => Limit::Max(error),
                        },
                    );
                }
            }
        }
    }
}

#[test]
fn the_bound_chosen_for_an_rms_error_is_the_largest() {
    let folder = tempfile::tempdir().unwrap();
    let samples = (0..129 * 129).map(|k| bumpy(k % 129, k / 129).round());
    let raster = Raster::new(129, 129, SampleType::I16, samples.collect());
    let mut last: Option<(u32, f64)> = None;
    for rms in [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 1e6] {
        let path = folder.path().join("a.kmb");
        let report = build(&raster, &path, TransformKind::Lifted, Limit::Rms(rms));
        let bound = Terrain::open(&path, Access::Map)
            .unwrap()
            .header()
            .bound_units;
        if let Some((coarser, error)) = last {
            assert!(
                bound >= coarser && report.rms_error >= error,
                "{bound} at {rms}"
            );
            // A larger bound that this limit allows would have been taken for it.
            assert!(bound == coarser || report.rms_error > error);
        }
        assert_eq!(report.rms_error == 0.0, bound == 0);
        last = Some((bound, report.rms_error));
    }
}

#[test]
fn errors_that_a_transform_cannot_keep_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let heights: Vec<f64> = (0..81).map(|k| f64::from(k as f32 * 0.123_456_7)).collect();
    let raster = Raster::new(9, 9, SampleType::F64, heights);
    let refused = |options: BuildOptions, expected: &str| {
        let text = message(raster.build_with(&path, &options));
        assert!(text.contains(expected), "{text}");
    };
    let [interpolating, lifted, two_stage] = KINDS;
    refused(
        options(interpolating, Limit::Rms(1.0), 4),
        "needs the transform lifted",
    );
    refused(
        options(two_stage, Limit::Rms(1.0), 4),
        "needs the transform lifted",
    );
    refused(
        options(lifted, Limit::Max(1.0), 4),
        "keeps no maximum error of 1",
    );
    refused(options(lifted, Limit::Rms(-1.0), 4), "from 0 up, not -1");
    refused(
        options(lifted, Limit::Rms(f64::NAN), 4),
        "from 0 up, not NaN",
    );
    refused(options(lifted, Limit::Rms(0.0), 4), "above 0");
    refused(
        options(lifted, Limit::Rms(1e-9), 4),
        "too small for f64 samples",
    );
    let both = BuildOptions {
        max_error: 1.0,
        ..options(lifted, Limit::Rms(1.0), 4)
    };
    refused(both, "not both");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
