//! Several rasters as one.

use std::path::{Path, PathBuf};

use kimberlite::build::source::{Mosaic, RasterSource, RowSource, open_all};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use proptest::prelude::*;

use crate::rasters::{Raster, read_all, read_file};
use crate::{defaults, few_cases};

const SPACING: [f64; 2] = [0.1, -0.3];

/// A raster whose upper left sample lies at (`column`, `row`) of a common grid.
fn placed(column: i32, row: i32, width: u32, height: u32) -> RasterInfo {
    let mut info = RasterInfo::new(width, height, SampleType::I16);
    info.georeferenced = true;
    info.registration = Registration::Area;
    info.nodata = Some(-1.0);
    let x = 100.0 + f64::from(column) * SPACING[0];
    let y = 50.0 + f64::from(row) * SPACING[1];
    info.geotransform = [x, SPACING[0], 0.0, y, 0.0, SPACING[1]];
    info
}

fn source(info: RasterInfo, samples: Vec<f64>) -> Box<dyn RasterSource> {
    let raster = Raster { info, samples };
    let info = raster.info.clone();
    Box::new(RowSource::new(
        info,
        Box::new(move |first, rows| raster.copy_rows(first, rows)),
    ))
}

fn named(sources: Vec<Box<dyn RasterSource>>) -> Vec<(PathBuf, Box<dyn RasterSource>)> {
    sources
        .into_iter()
        .enumerate()
        .map(|(index, source)| (PathBuf::from(format!("part {index}")), source))
        .collect()
}

proptest! {
    #![proptest_config(few_cases())]

    #[test]
    fn later_valid_samples_win_and_gaps_are_void(
        parts in prop::collection::vec(
            (-9i32..9, -9i32..9, 1u32..9, 1u32..9, prop::collection::vec(-1i16..5, 64)), 1..5),
    ) {
        let left = parts.iter().map(|part| part.0).min().unwrap();
        let top = parts.iter().map(|part| part.1).min().unwrap();
        let right = parts.iter().map(|part| part.0 + part.2 as i32).max().unwrap();
        let bottom = parts.iter().map(|part| part.1 + part.3 as i32).max().unwrap();
        let (width, height) = ((right - left) as usize, (bottom - top) as usize);
        let mut expected = vec![f64::NAN; width * height];
        let mut sources = Vec::new();
        for (column, row, part_width, part_height, values) in &parts {
            let count = (part_width * part_height) as usize;
            let samples: Vec<f64> = values[..count].iter().map(|&value| f64::from(value)).collect();
            for (index, &sample) in samples.iter().enumerate() {
                let x = (column - left) as usize + index % *part_width as usize;
                let y = (row - top) as usize + index / *part_width as usize;
                if sample != -1.0 {
                    expected[y * width + x] = sample;
                }
            }
            sources.push(source(placed(*column, *row, *part_width, *part_height), samples));
        }
        let mut mosaic = Mosaic::new(named(sources)).unwrap();
        let info = mosaic.info().clone();
        prop_assert_eq!((info.width as usize, info.height as usize), (width, height));
        let corner = placed(left, top, 1, 1);
        for (a, b) in info.geotransform.iter().zip(&corner.geotransform) {
            prop_assert!((a - b).abs() < 1e-9);
        }
        let model = Raster { info, samples: expected };
        model.assert_same_samples(&read_all(&mut mosaic).unwrap());
    }
}

#[test]
fn tiles_of_vancouver_join_at_their_shared_column() {
    let file = |name: &str| {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("data")
            .join(name)
    };
    let (west, east) = (file("srtm3_N49W124.tif"), file("srtm3_N49W123.tif"));
    let west_raster = read_file(&west, &defaults()).unwrap();
    let east_raster = read_file(&east, &defaults()).unwrap();
    let mut mosaic = open_all(&[east, west], &defaults()).unwrap();
    let info = mosaic.info().clone();
    assert_eq!((info.width, info.height), (2401, 1201));
    let expected = west_raster.info.geotransform;
    assert!(
        info.geotransform
            .iter()
            .zip(&expected)
            .all(|(a, b)| (a - b).abs() < 1e-9)
    );
    assert_eq!(
        (info.crs.as_str(), info.nodata),
        ("EPSG:4326", Some(-32767.0))
    );
    let samples = read_all(mosaic.as_mut()).unwrap();
    let voids = samples.iter().filter(|sample| sample.is_nan()).count();
    let (mut expected_voids, width) = (0, 1201);
    for (row, line) in samples.chunks(2401).enumerate() {
        let west_line = &west_raster.samples[row * width..(row + 1) * width];
        let east_line = &east_raster.samples[row * width..(row + 1) * width];
        let same = |a: f64, b: f64| a == b || a.is_nan() && b.is_nan();
        assert!(
            same(west_line[width - 1], east_line[0]),
            "no shared column in row {row}"
        );
        assert!(
            line.iter().zip(west_line).all(|(&a, &b)| same(a, b)),
            "row {row}"
        );
        assert!(
            line[width - 1..]
                .iter()
                .zip(east_line)
                .all(|(&a, &b)| same(a, b)),
            "row {row}"
        );
        expected_voids += line.iter().filter(|sample| sample.is_nan()).count();
    }
    assert_eq!(voids, expected_voids);
}

#[test]
fn rasters_that_do_not_fit_are_refused_by_name() {
    let refused = |change: &dyn Fn(&mut RasterInfo)| {
        let mut other = placed(3, 0, 2, 2);
        change(&mut other);
        let sources = vec![
            source(placed(0, 0, 2, 2), vec![0.0; 4]),
            source(other, vec![0.0; 4]),
        ];
        let text = Mosaic::new(named(sources))
            .err()
            .expect("should be refused")
            .to_string();
        assert!(
            text.starts_with("part 1: ") && text.ends_with("joined to part 0"),
            "{text}"
        );
        text
    };
    let shifted = refused(&|info| info.geotransform[0] += 0.025);
    assert!(
        shifted.contains("its samples lie 0.250 columns, "),
        "{shifted}"
    );
    assert!(refused(&|info| info.geotransform[1] *= 1.5).contains("spacing differs"));
    assert!(refused(&|info| info.geotransform[4] = 0.01).contains("spacing differs"));
    assert!(refused(&|info| info.sample_type = SampleType::F32).contains("f32 and not i16"));
    assert!(refused(&|info| info.value_scale = 0.1).contains("scale, offset or units"));
    assert!(refused(&|info| info.crs = "EPSG:1234".into()).contains("EPSG:1234 and not unknown"));
    assert!(refused(&|info| info.georeferenced = false).contains("not georeferenced"));
    assert!(refused(&|info| info.geotransform[0] = 1e15).contains("too far"));
    assert!(Mosaic::new(Vec::new()).is_err());
    assert!(open_all(&[], &defaults()).is_err());
}

#[test]
fn small_errors_of_a_geotransform_are_tolerated() {
    let mut other = placed(2, 0, 2, 2);
    other.geotransform[0] += 0.5e-3 * SPACING[0];
    let sources = vec![
        source(placed(0, 0, 2, 2), vec![1.0; 4]),
        source(other, vec![2.0; 4]),
    ];
    let mut mosaic = Mosaic::new(named(sources)).unwrap();
    let samples = read_all(&mut mosaic).unwrap();
    assert_eq!(samples, [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]);
}

#[test]
fn valid_sample_with_the_nodata_value_of_another_input_is_refused() {
    let mut other = placed(2, 0, 2, 1);
    other.nodata = Some(-2.0);
    let joined = |samples: Vec<f64>| {
        let first = source(placed(0, 0, 2, 1), vec![1.0, -1.0]);
        let mut mosaic = Mosaic::new(named(vec![first, source(other.clone(), samples)])).unwrap();
        assert_eq!(mosaic.info().nodata, Some(-1.0));
        read_all(&mut mosaic)
    };
    let fine = joined(vec![-2.0, 3.0]).unwrap();
    assert!(fine[0] == 1.0 && fine[1].is_nan() && fine[2].is_nan() && fine[3] == 3.0);
    assert_eq!(
        joined(vec![4.0, -1.0]).unwrap_err().to_string(),
        "part 1: the sample at column 1, row 0 is -1, which is the nodata value of another input"
    );
}
