//! Other samples in a part of a repository: the bytes of a build of all of them.

use crate::methods::{METHODS, Method};
use crate::rasters::{Raster, decode, max_difference, message, some_error};
use crate::round_trip::rasters;
use kimberlite::build::{BuildOptions, BuildReport};
use kimberlite::cut::{Terrain, Window};
use kimberlite::geo::SampleType;
use kimberlite::store::{Access, EntropyKind, Store, TransformKind};
use kimberlite::tool::{self, Placed, Update, UpdateReport};
use kimberlite::{Error, Result};
use proptest::prelude::*;
use std::path::Path;

const EXACT: Method = METHODS[0];

/// What a region gets.
#[derive(Clone, Copy, Debug)]
enum New {
    /// What it has, and some noise.
    Rough,
    /// One height for all.
    Flat,
    /// What lies elsewhere.
    Moved,
    /// Nothing.
    Void,
    /// Heights beyond all others.
    Beyond,
    /// What it has.
    Same,
}

fn news() -> impl Strategy<Value = New> {
    prop_oneof![
        3 => Just(New::Rough),
        2 => Just(New::Flat),
        2 => Just(New::Moved),
        1 => Just(New::Void),
        1 => Just(New::Beyond),
        1 => Just(New::Same),
    ]
}

/// Hills of whole numbers or quarters, with or without voids and with a sea.
fn grounds() -> impl Strategy<Value = Raster> {
    let kinds = prop_oneof![
        3 => Just((SampleType::I16, 1.0)),
        1 => Just((SampleType::I32, 1.0)),
        1 => Just((SampleType::F32, 0.25)),
    ];
    let sizes = [2u32..400, 2u32..400];
    (sizes, kinds, 0u64..1 << 40, 0u32..4, 1u32..60).prop_map(
        |([width, height], (sample_type, unit), seed, voids, noise)| {
            let samples = (0..width * height).map(|index| {
                let (x, y) = (f64::from(index % width), f64::from(index / width));
                let mixed = (u64::from(index) ^ seed).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 33;
                let phase = (seed % 97) as f64;
                let hill = (x * 0.021 + phase).sin() * (y * 0.017).cos();
                let is_void = match voids {
                    0 | 1 => false,
                    2 => hill > 0.7,
                    _ => mixed % 200 == 0,
                };
                let rough = 800.0 * hill + (mixed % u64::from(noise)) as f64;
                let dry = if seed.is_multiple_of(2) {
                    rough.max(0.0)
                } else {
                    rough
                };
                if is_void {
                    f64::NAN
                } else {
                    dry.round() * unit
                }
            });
            Raster::new(width, height, sample_type, samples.collect())
        },
    )
}

/// A part of a raster, from shares of its sides.
fn part_of(raster: &Raster, [x, y]: [f64; 2], [width, height]: [u32; 2]) -> Window {
    let (columns, rows) = (raster.info.width, raster.info.height);
    let (width, height) = (width.min(columns), height.min(rows));
    Window {
        column: (x * f64::from(columns - width)) as u32,
        row: (y * f64::from(rows - height)) as u32,
        width,
        height,
    }
}

fn places(raster: &Raster, part: Window) -> impl Iterator<Item = usize> + use<> {
    let width = raster.info.width;
    (0..part.width * part.height).map(move |index| {
        let (column, row) = (index % part.width, index / part.width);
        ((part.row + row) * width + part.column + column) as usize
    })
}

/// The raster with something else in a part.
fn merged(raster: &Raster, part: Window, new: New) -> Raster {
    let mut merged = raster.clone();
    let count = raster.samples.len();
    let valid = || {
        raster
            .samples
            .iter()
            .copied()
            .filter(|sample| !sample.is_nan())
    };
    let [low, high] = [
        valid().fold(f64::MAX, f64::min),
        valid().fold(f64::MIN, f64::max),
    ];
    for (number, place) in places(raster, part).enumerate() {
        let old = raster.samples[place];
        merged.samples[place] = match new {
            New::Rough => (old + (number * number % 7) as f64).min(high),
            New::Flat => raster.samples[count / 2],
            New::Moved => raster.samples[(place + count / 3) % count],
            New::Void => f64::NAN,
            New::Beyond => (high - low) / 8.0 + 1.0 + high.max(0.0),
            New::Same => old,
        };
        if raster.info.sample_type != SampleType::F32 {
            merged.samples[place] = merged.samples[place].round();
        }
    }
    merged
}

fn cut_out(raster: &Raster, part: Window) -> Raster {
    let samples = places(raster, part)
        .map(|place| raster.samples[place])
        .collect();
    Raster::new(part.width, part.height, raster.info.sample_type, samples)
}

fn options_for(part: Window) -> Update {
    Update {
        region: part,
        rms_error: None,
        memory: None,
        threads: 2,
    }
}

fn update(path: &Path, new: &Raster, at: [i64; 2], options: &Update) -> Result<UpdateReport> {
    let mut source = new.source();
    let placed = Placed {
        source: &mut source,
        at,
    };
    tool::update(path, placed, options, &mut |_, _| true)
}

/// Updates with the samples of the part alone.
fn update_part(path: &Path, merged: &Raster, part: Window) -> Result<UpdateReport> {
    let at = [i64::from(part.column), i64::from(part.row)];
    update(path, &cut_out(merged, part), at, &options_for(part))
}

/// A build with the tables of another file.
fn rebuild(raster: &Raster, tables: &Path, path: &Path, options: &BuildOptions) -> BuildReport {
    let terrain = Terrain::open(tables, Access::Map).unwrap();
    let options = BuildOptions {
        tables: terrain.model().cloned(),
        ..options.clone()
    };
    raster.build_with(path, &options).unwrap()
}

fn has_a_sample(raster: &Raster) -> bool {
    raster.samples.iter().any(|sample| !sample.is_nan())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn an_update_of_a_lossless_file_is_a_build_of_the_merged_raster(
        raster in grounds(),
        cells_log2 in 4u32..6,
        (corner, size) in ([0.0f64..1.0, 0.0f64..1.0], [1u32..50, 1u32..50]),
        new in news(),
        method in prop_oneof![5 => Just(0usize), 1 => 1usize..3, 1 => 3usize..9],
    ) {
        let part = part_of(&raster, corner, size);
        let merged = merged(&raster, part, new);
        prop_assume!(has_a_sample(&raster) && has_a_sample(&merged));
        let folder = tempfile::tempdir().unwrap();
        let [file, rebuilt] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
        let options = METHODS[method].options(0.0, cells_log2);
        raster.build_with(&file, &options).unwrap();
        rebuild(&merged, &file, &rebuilt, &options);
        let report = update_part(&file, &merged, part).unwrap();
        prop_assert!(std::fs::read(&file).unwrap() == std::fs::read(&rebuilt).unwrap(), "{:?}", report);
        if matches!(new, New::Same) && METHODS[method].transform == TransformKind::Interpolating {
            prop_assert_eq!(report.diamonds_recomputed, 0);
        }
    }

    #[test]
    fn an_update_with_all_originals_is_a_build_of_the_merged_raster(
        raster in rasters(),
        (corner, size) in ([0.0f64..1.0, 0.0f64..1.0], [1u32..50, 1u32..50]),
        new in prop_oneof![Just(New::Flat), Just(New::Moved), Just(New::Same)],
        method in 0usize..9,
    ) {
        let part = part_of(&raster, corner, size);
        let merged = merged(&raster, part, new);
        prop_assume!(has_a_sample(&raster) && has_a_sample(&merged));
        let folder = tempfile::tempdir().unwrap();
        let [file, rebuilt] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
        let options = METHODS[method].options(some_error(&raster), 4);
        raster.build_with(&file, &options).unwrap();
        let is_lossless = Store::open(&file, Access::Map).unwrap().header().lossless;
        // An RMS error that was never made use of is forgotten.
        prop_assume!(!(is_lossless && options.rms_error.is_some()));
        rebuild(&merged, &file, &rebuilt, &options);
        let update_options = Update { rms_error: options.rms_error, ..options_for(part) };
        update(&file, &merged, [0, 0], &update_options).unwrap();
        prop_assert!(std::fs::read(&file).unwrap() == std::fs::read(&rebuilt).unwrap());
    }
}

/// Ground in which a height is nowhere twice as an extreme.
fn slope(width: u32, height: u32) -> Raster {
    let samples = (0..width * height).map(|index| {
        let (x, y) = (index % width, index / width);
        let noise = (x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)).wrapping_mul(2_654_435_761);
        f64::from(3 * x + 2 * y + (noise >> 28))
    });
    Raster::new(width, height, SampleType::I16, samples.collect())
}

#[test]
fn an_update_of_a_lossless_file_codes_only_what_the_region_reaches() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(1000, 900);
    let options = EXACT.options(0.0, 4);
    for [column, row] in [[500, 450], [17, 860], [333, 2]] {
        raster.build_with(&file, &options).unwrap();
        let part = Window {
            column,
            row,
            width: 20,
            height: 20,
        };
        let merged = merged(&raster, part, New::Rough);
        let report = update_part(&file, &merged, part).unwrap();
        assert_eq!(
            report.diamonds,
            Terrain::open(&file, Access::Map)
                .unwrap()
                .header()
                .block_count
        );
        assert!(report.diamonds_recomputed > 0);
        assert!(
            report.diamonds_recomputed * 50 < report.diamonds,
            "{report:?}"
        );
        let decoded = decode(&file, Access::Map).unwrap();
        assert_eq!(max_difference(&decoded, &merged.samples), 0.0);
    }
}

#[test]
fn a_sample_at_any_corner_or_edge_changes_what_a_build_would() {
    let folder = tempfile::tempdir().unwrap();
    let [file, rebuilt] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
    let options = EXACT.options(0.0, 4);
    for [width, height] in [[257, 257], [210, 2], [300, 190]] {
        let raster = slope(width, height);
        for [column, row] in [
            [0, 0],
            [1, 0],
            [width - 1, 0],
            [0, height - 1],
            [width / 2, 0],
            [width - 1, height - 1],
        ] {
            let part = Window {
                column,
                row,
                width: 1,
                height: 1,
            };
            let mut merged = raster.clone();
            let place = (row * width + column) as usize;
            merged.samples[place] = raster.samples[(place + 7) % raster.samples.len()];
            raster.build_with(&file, &options).unwrap();
            rebuild(&merged, &file, &rebuilt, &options);
            update_part(&file, &merged, part).unwrap();
            assert!(
                std::fs::read(&file).unwrap() == std::fs::read(&rebuilt).unwrap(),
                "{part:?}"
            );
        }
    }
}

#[test]
fn a_reader_of_the_old_file_goes_on_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(300, 200);
    raster.build_with(&file, &EXACT.options(0.0, 4)).unwrap();
    let old: Vec<Store> = [Access::Map, Access::Positioned]
        .map(|access| Store::open(&file, access).unwrap())
        .into();
    let bytes = std::fs::read(&file).unwrap();
    let part = Window {
        column: 10,
        row: 10,
        width: 200,
        height: 150,
    };
    update_part(&file, &merged(&raster, part, New::Rough), part).unwrap();
    assert_ne!(std::fs::read(&file).unwrap(), bytes);
    let copy = folder.path().join("copy.kmb");
    std::fs::write(&copy, &bytes).unwrap();
    let expected = Store::open(&copy, Access::Map).unwrap();
    let (mut one, mut other) = (Vec::new(), Vec::new());
    for rank in 0..expected.header().block_count {
        for old in &old {
            assert_eq!(
                old.block(rank, &mut one).unwrap(),
                expected.block(rank, &mut other).unwrap()
            );
        }
    }
}

/// Refuses an update, and says whether the file is as it was.
fn refused(path: &Path, result: impl FnOnce() -> Result<UpdateReport>) -> String {
    let before = std::fs::read(path).unwrap();
    let told = message(result());
    assert_eq!(std::fs::read(path).unwrap(), before, "{told}");
    let folder = path.parent().unwrap();
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 1, "{told}");
    told
}

#[test]
fn a_lossy_file_without_its_originals_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(300, 200);
    raster.build_with(&file, &EXACT.options(4.0, 4)).unwrap();
    let part = Window {
        column: 100,
        row: 50,
        width: 30,
        height: 20,
    };
    let merged = merged(&raster, part, New::Rough);
    let told = refused(&file, || update_part(&file, &merged, part));
    assert!(
        told.contains("is not lossless") && told.contains("original"),
        "{told}"
    );
    assert!(
        told.contains("300 x 200") && told.contains("30 x 20"),
        "{told}"
    );
}

#[test]
fn samples_that_are_not_the_originals_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(300, 200);
    raster.build_with(&file, &EXACT.options(4.0, 4)).unwrap();
    let part = Window {
        column: 100,
        row: 50,
        width: 30,
        height: 20,
    };
    let mut merged = merged(&raster, part, New::Rough);
    merged.samples[71 * 300 + 99] += 40.0;
    let told = refused(&file, || update(&file, &merged, [0, 0], &options_for(part)));
    assert!(told.contains("column 99, row 71"), "{told}");
}

#[test]
fn an_update_that_does_not_fit_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(300, 200);
    raster.build_with(&file, &EXACT.options(0.0, 4)).unwrap();
    let part = Window {
        column: 100,
        row: 50,
        width: 30,
        height: 20,
    };
    let beyond = Window {
        column: 280,
        ..part
    };
    let told = refused(&file, || {
        update(&file, &raster, [0, 0], &options_for(beyond))
    });
    assert!(
        told.contains("column 280") && told.contains("300 x 200"),
        "{told}"
    );
    let told = refused(&file, || {
        update(
            &file,
            &cut_out(&raster, part),
            [101, 50],
            &options_for(part),
        )
    });
    assert!(
        told.contains("column 100, row 50") && told.contains("column 101"),
        "{told}"
    );
    let other = Raster::new(30, 20, SampleType::F32, vec![0.0; 600]);
    let told = refused(&file, || {
        update(&file, &other, [100, 50], &options_for(part))
    });
    assert!(told.contains("f32") && told.contains("i16"), "{told}");
    let mut wrong = cut_out(&raster, part);
    wrong.samples[3 * 30 + 7] = 0.5;
    let told = refused(&file, || {
        update(&file, &wrong, [100, 50], &options_for(part))
    });
    assert!(told.contains("column 107, row 53"), "{told}");
    let with_rms = Update {
        rms_error: Some(1.0),
        ..options_for(part)
    };
    let told = refused(&file, || update(&file, &raster, [0, 0], &with_rms));
    assert!(told.contains("RMS"), "{told}");
}

#[test]
fn a_file_with_an_rms_error_wants_it_told_again() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(100, 90);
    let lifted = Method {
        transform: TransformKind::Lifted,
        entropy: EntropyKind::Rans,
        adaptive: false,
    };
    raster.build_with(&file, &lifted.options(4.0, 4)).unwrap();
    let part = Window {
        column: 10,
        row: 5,
        width: 30,
        height: 20,
    };
    let told = refused(&file, || update(&file, &raster, [0, 0], &options_for(part)));
    assert!(told.contains("RMS"), "{told}");
}

#[test]
fn a_cancelled_update_leaves_the_file_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.kmb");
    let raster = slope(300, 200);
    raster.build_with(&file, &EXACT.options(0.0, 4)).unwrap();
    let part = Window {
        column: 100,
        row: 50,
        width: 30,
        height: 20,
    };
    let merged = merged(&raster, part, New::Rough);
    for steps in 0..3 {
        let told = refused(&file, || {
            let mut source = merged.source();
            let new = Placed {
                source: &mut source,
                at: [0, 0],
            };
            let mut left = steps;
            tool::update(&file, new, &options_for(part), &mut |_, _| {
                left -= 1;
                left >= 0
            })
        });
        assert_eq!(told, Error::Cancelled.to_string());
    }
}
