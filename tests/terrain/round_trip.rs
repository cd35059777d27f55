//! From a raster to a repository and back: the certified error, exact voids, one output.

use crate::rasters::{Raster, decode, max_difference, message};
use kimberlite::cut::{DiamondSource, Query, Terrain, Window, level_step, read_window};
use kimberlite::geo::SampleType;
use kimberlite::store::Access;
use proptest::prelude::*;
use std::sync::Arc;

/// Hills with noise, as real terrains have both.
fn hill(column: u32, row: u32, seed: u64, amplitude: f64) -> f64 {
    let (x, y) = (f64::from(column), f64::from(row));
    let mixed =
        (u64::from(column) << 32 | u64::from(row)) ^ seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let noise = (mixed.wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 40) as f64 / (1 << 24) as f64;
    amplitude * ((x * 0.11).sin() * (y * 0.07).cos() + 0.2 * noise)
}

pub fn rasters() -> impl Strategy<Value = Raster> {
    let kinds = prop_oneof![
        Just((SampleType::I16, 3000.0)),
        Just((SampleType::U8, 100.0)),
        Just((SampleType::F32, 50.0)),
        Just((SampleType::F64, 1e6)),
        Just((SampleType::I32, 1.7e9)),
    ];
    (2u32..120, 2u32..120, kinds, any::<u64>(), 0u64..4).prop_map(
        |(width, height, (sample_type, amplitude), seed, voids)| {
            let samples = (0..width * height).map(|index| {
                let (column, row) = (index % width, index / width);
                let blob = hill(column, row, seed ^ 77, 1.0);
                let is_void = match voids {
                    0 => false,
                    1 => blob > 0.5,
                    2 => (column ^ row).is_multiple_of(7),
                    _ => blob < 0.9,
                };
                let height = hill(column, row, seed, amplitude);
                let height = if sample_type == SampleType::U8 {
                    height.abs()
                } else {
                    height
                };
                match sample_type {
                    _ if is_void => f64::NAN,
                    SampleType::F32 => f64::from(height as f32),
                    SampleType::F64 => height,
                    _ => height.round(),
                }
            });
            Raster::new(width, height, sample_type, samples.collect())
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_decoded_sample_is_within_the_certified_error(
        raster in rasters(),
        share in 0.0f64..0.3,
        cells_log2 in 4u32..7,
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        let amplitude = raster.samples.iter().filter(|s| !s.is_nan()).fold(1.0f64, |a, s| a.max(s.abs()));
        let integer = raster.info.sample_type.is_integer();
        let max_error = if integer { (share * amplitude).floor() } else { (share + 1e-3) * amplitude };
        let report = raster.build(&path, max_error, cells_log2).unwrap();
        let mapped = decode(&path, Access::Map).unwrap();
        let error = max_difference(&mapped, &raster.samples);
        prop_assert!(error <= max_error, "{} over {}", error, max_error);
        prop_assert_eq!(error, report.max_error);
        let positioned = decode(&path, Access::Positioned).unwrap();
        prop_assert_eq!(max_difference(&mapped, &positioned), 0.0);
    }

    #[test]
    fn coarser_levels_are_every_second_sample_of_the_finest(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        raster.build(&path, 1e9, 4).unwrap();
        let finest = decode(&path, Access::Map).unwrap();
        let terrain = Terrain::open(&path, Access::Map).unwrap();
        for level in (0..=terrain.lattice().levels()).step_by(2) {
            let step = level_step(&terrain, level).unwrap();
            let [width, height] = kimberlite::cut::level_size(&terrain, level).unwrap();
            let (column, row) = (width / 3, height / 2);
            let window = Window { column, row, width: width - column, height: height - row };
            let mut samples = vec![0.0; (window.width * window.height) as usize];
            read_window(&terrain, level, window, &mut samples).unwrap();
            let expected: Vec<f64> = (0..samples.len() as u32).map(|index| {
                let (c, r) = (column + index % window.width, row + index / window.width);
                finest[(r * step * raster.info.width + c * step) as usize]
            }).collect();
            prop_assert_eq!(max_difference(&samples, &expected), 0.0);
        }
    }

    #[test]
    fn heights_at_samples_are_the_decoded_samples(raster in rasters(), limit in 0u64..100_000) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        raster.build(&path, 1e9, 4).unwrap();
        let finest = decode(&path, Access::Map).unwrap();
        let mut query = Query::new(Arc::new(Terrain::open(&path, Access::Map).unwrap()), limit);
        let range = finest.iter().filter(|h| !h.is_nan()).fold(1.0f64, |a, h| a.max(h.abs()));
        for (index, expected) in finest.iter().enumerate().step_by(37) {
            let (column, row) = (index as u32 % raster.info.width, index as u32 / raster.info.width);
            let height = query.height_at_grid(f64::from(column), f64::from(row)).unwrap();
            match height {
                Some(found) => prop_assert!((found.height - expected).abs() <= 1e-6 * range),
                None => prop_assert!(expected.is_nan()),
            }
        }
        prop_assert!(query.height_at_grid(-0.01, 0.0).unwrap().is_none());
        prop_assert!(query.height_at_grid(0.0, f64::NAN).unwrap().is_none());
    }
}

#[test]
fn full_range_integers_are_lossless() {
    let extremes = [f64::from(i32::MIN), f64::from(i32::MAX), 0.0, -1.0];
    let samples: Vec<f64> = (0..70 * 50).map(|k| extremes[(k * k / 3) % 4]).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    for (sample_type, shift) in [(SampleType::I32, 0.0), (SampleType::U32, 2_147_483_648.0)] {
        let samples: Vec<f64> = samples.iter().map(|sample| sample + shift).collect();
        let raster = Raster::new(70, 50, sample_type, samples);
        raster.build(&path, 0.0, 4).unwrap();
        assert_eq!(
            max_difference(&decode(&path, Access::Map).unwrap(), &raster.samples),
            0.0
        );
        let report = raster.build(&path, 1e6, 4).unwrap();
        assert!(report.max_error <= 1e6);
    }
}

#[test]
fn a_valid_sample_never_becomes_the_nodata_value() {
    let samples: Vec<f64> = (0..60 * 60)
        .map(|k| (k % 60) as f64 - 30.0)
        .map(|h| if h == 0.0 { f64::NAN } else { h })
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    for (sample_type, max_error) in [
        (SampleType::I16, 1.0),
        (SampleType::I16, 7.0),
        (SampleType::F32, 2.5),
        (SampleType::F32, 0.0),
    ] {
        let mut raster = Raster::new(60, 60, sample_type, samples.clone());
        raster.info.nodata = Some(0.0);
        raster.build(&path, max_error, 4).unwrap();
        let decoded = decode(&path, Access::Map).unwrap();
        assert!(max_difference(&decoded, &raster.samples) <= max_error);
        assert!(decoded.iter().all(|&sample| sample != 0.0));
    }
}

#[test]
fn a_raster_without_any_valid_sample_stays_void() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let raster = Raster::new(200, 100, SampleType::I16, vec![f64::NAN; 20_000]);
    let report = raster.build(&path, 1.0, 4).unwrap();
    assert_eq!(report.void_samples, 20_000);
    assert!(
        decode(&path, Access::Map)
            .unwrap()
            .iter()
            .all(|sample| sample.is_nan())
    );
}

#[test]
fn what_cannot_be_built_says_why_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let raster = Raster::new(
        9,
        9,
        SampleType::F32,
        (0..81).map(|k| f64::from(k as f32 * 0.123_456_7)).collect(),
    );
    for (max_error, expected) in [
        (0.0, "multiples of one unit, 1 to 1e-6 by powers of ten"),
        (-1.0, "must be a number from 0 up, not -1"),
        (f64::NAN, "must be a number from 0 up, not NaN"),
        (1e-9, "too small for f32 samples"),
    ] {
        let text = message(raster.build(&path, max_error, 4));
        assert!(text.contains(expected), "{text}");
    }
    let mut infinite = raster.clone();
    infinite.samples[9 * 4 + 2] = f64::INFINITY;
    let text = message(infinite.build(&path, 1.0, 4));
    assert!(text.contains("column 2, row 4"), "{text}");
    let options = kimberlite::build::BuildOptions {
        max_error: 1.0,
        cells_log2: 4,
        threads: 1,
        ..Default::default()
    };
    let text = message(kimberlite::build::build(
        &mut raster.source(),
        &options,
        &path,
        &mut |done, _| done == 0,
    ));
    assert_eq!(text, "cancelled");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
