//! GeoTIFF out and in again.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use kimberlite::build::source::{SourceOptions, open};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use kimberlite::tool::raster_file::write_geotiff;
use kimberlite::{Error, set_log_callback};
use proptest::prelude::*;

use crate::rasters::{Raster, georeferenced, in_folder, rasters, read_file};
use crate::{defaults, few_cases};

fn write(raster: &Raster, path: &Path) -> kimberlite::Result<()> {
    write_geotiff(path, &raster.info, |first, rows| {
        raster.copy_rows(first, rows)
    })
}

fn written_and_read(raster: &Raster) -> Raster {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    write(raster, &path).unwrap();
    assert_eq!(
        std::fs::read_dir(folder.path()).unwrap().count(),
        1,
        "a temporary file is left"
    );
    read_file(&path, &defaults()).unwrap()
}

fn two_by_one(sample_type: SampleType) -> RasterInfo {
    georeferenced(RasterInfo::new(2, 1, sample_type), Registration::Area)
}

fn of(info: RasterInfo) -> Raster {
    Raster {
        info,
        samples: vec![1.0, 2.0],
    }
}

/// The sample GeoTIFFs.
fn sample_files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "tif"))
        .collect();
    files.sort();
    files
}

proptest! {
    #![proptest_config(few_cases())]

    #[test]
    fn written_geotiff_reads_back_to_the_bit(
        raster in rasters(&SampleType::ALL, true), point in any::<bool>(),
    ) {
        let registration = if point { Registration::Point } else { Registration::Area };
        let info = georeferenced(raster.info.clone(), registration);
        let raster = Raster { info, ..raster };
        let read = written_and_read(&raster);
        let without_tags = RasterInfo { metadata: Default::default(), ..read.info };
        prop_assert_eq!(&without_tags, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn raster_without_georeference_or_nodata_stays_without(
        raster in rasters(&SampleType::ALL, false),
    ) {
        let read = written_and_read(&raster);
        prop_assert_eq!(&read.info, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn nodata_survives_to_the_bit(nodata in any::<f64>()) {
        let mut info = RasterInfo::new(2, 1, SampleType::F64);
        info.nodata = Some(nodata);
        let read = written_and_read(&Raster { info, samples: vec![f64::NAN, f64::NAN] });
        let read_nodata = read.info.nodata.unwrap();
        prop_assert!(
            read_nodata.to_bits() == nodata.to_bits() || read_nodata.is_nan() && nodata.is_nan()
        );
        prop_assert!(read.samples.iter().all(|sample| sample.is_nan()));
    }
}

#[test]
fn sample_files_survive_with_all_that_is_known_of_them() {
    let files = sample_files();
    assert!(files.len() >= 6);
    for path in files {
        let raster = read_file(&path, &defaults()).unwrap();
        assert!(raster.info.georeferenced && raster.info.crs.starts_with("EPSG:"));
        assert!(raster.info.metadata.contains_key("tiff.34735"));
        let read = written_and_read(&raster);
        assert_eq!(read.info, raster.info, "{}", path.display());
        raster.assert_same_samples(&read.samples);
    }
}

#[test]
fn sample_files_have_the_range_and_voids_that_their_page_says() {
    let known = [
        (
            "delft_dsm_0.5m_1.tif",
            f64::from(-0.568f32),
            f64::from(19.398f32),
            16652,
        ),
        ("srtm3_N49W123.tif", -37.0, 2674.0, 34926),
        ("srtm3_N49W124.tif", -26.0, 2630.0, 25620),
        ("srtm3_S33W071.tif", 250.0, 6929.0, 0),
        ("puget_sound_1025_decimetres.png", 0.0, 43798.0, 0),
    ];
    for (name, low, high, voids) in known {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("data")
            .join(name);
        let samples = read_file(&path, &defaults()).unwrap().samples;
        let range = (
            samples.iter().copied().fold(f64::INFINITY, f64::min),
            samples.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        );
        assert_eq!(range, (low, high), "{name}");
        assert_eq!(
            samples.iter().filter(|sample| sample.is_nan()).count(),
            voids,
            "{name}"
        );
    }
}

#[test]
fn reference_systems_survive() {
    let wkt = "PROJCS[\"Own\",GEOGCS[\"G\",DATUM[\"D\",SPHEROID[\"S\",6378137,298.25]]]]";
    for (crs, geographic) in [
        ("EPSG:32610", false),
        ("EPSG:4326", true),
        ("", false),
        (wkt, false),
        ("GEOGCS[]", true),
    ] {
        let mut info = two_by_one(SampleType::I16);
        info.crs = crs.to_string();
        info.geographic = geographic;
        let read = written_and_read(&of(info));
        assert_eq!(
            (read.info.crs.as_str(), read.info.geographic),
            (crs, geographic)
        );
    }
}

#[test]
fn rotated_and_mirrored_geotransforms_survive() {
    for geotransform in [
        [10.0, 0.8, 0.6, 20.0, 0.6, -0.8],
        [10.0, 1.0, 0.0, 20.0, 0.0, 1.0],
        [10.0, -1.0, 0.0, 20.0, 0.0, -1.0],
    ] {
        let mut info = two_by_one(SampleType::U8);
        info.geotransform = geotransform;
        assert_eq!(written_and_read(&of(info)).info.geotransform, geotransform);
    }
}

#[test]
fn scale_offset_and_units_survive() {
    let mut info = two_by_one(SampleType::I16);
    info.value_scale = 0.1;
    info.value_offset = -500.25;
    info.units = "m & <dm>".to_string();
    let raster = of(info);
    let first = written_and_read(&raster);
    let second = written_and_read(&first);
    for read in [&first, &second] {
        assert_eq!(read.info.value_scale, 0.1);
        assert_eq!(read.info.value_offset, -500.25);
        assert_eq!(read.info.units, "m & <dm>");
    }
    assert_eq!(first.info, second.info);
}

#[test]
fn overridden_scale_replaces_the_one_in_the_file() {
    let mut info = two_by_one(SampleType::I16);
    info.value_scale = 0.1;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    write(&of(info), &path).unwrap();
    let options = SourceOptions {
        scale: Some(0.5),
        ..defaults()
    };
    let overridden = read_file(&path, &options).unwrap();
    assert_eq!(written_and_read(&overridden).info.value_scale, 0.5);
}

#[test]
fn geotransform_without_inverse_is_dropped_with_a_warning() {
    let heard = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&heard);
    set_log_callback(Some(Box::new(move |_, text| {
        sink.lock().unwrap().push(text.to_string())
    })));
    for number in [0.0, f64::NAN] {
        let mut info = two_by_one(SampleType::U8);
        info.geotransform[1] = number;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("singular.tif");
        write(&of(info), &path).unwrap();
        let read = open(&path, &defaults()).unwrap().info().clone();
        let plain = RasterInfo::new(2, 1, SampleType::U8);
        assert!(!read.georeferenced);
        assert_eq!(read.geotransform, plain.geotransform);
        let name = path.display().to_string();
        assert!(
            heard
                .lock()
                .unwrap()
                .iter()
                .any(|text: &String| text.starts_with(&name))
        );
    }
    set_log_callback(None);
}

#[test]
fn what_the_type_cannot_hold_is_refused_with_its_place() {
    let refused = |nodata, sample, sample_type| {
        let mut info = RasterInfo::new(2, 2, sample_type);
        info.nodata = nodata;
        let raster = Raster {
            info,
            samples: vec![1.0, 2.0, 3.0, sample],
        };
        let folder = tempfile::tempdir().unwrap();
        let error = write(&raster, &folder.path().join("a.tif")).unwrap_err();
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            0,
            "something is left"
        );
        assert!(matches!(error, Error::Argument(_)));
        error.to_string()
    };
    let place = "the sample at column 1, row 1";
    assert_eq!(
        refused(None, f64::NAN, SampleType::U8),
        format!("{place} is void, but there is no nodata value that the type can hold")
    );
    assert!(refused(Some(-9999.0), f64::NAN, SampleType::U8).contains("is void"));
    assert_eq!(
        refused(None, 256.0, SampleType::U8),
        format!("{place} is 256, which u8 cannot hold")
    );
    assert!(refused(None, 0.5, SampleType::I32).contains("i32 cannot hold"));
    assert!(refused(None, 1e300, SampleType::F32).contains("f32 cannot hold"));
    let hidden = refused(Some(-1.0), -1.0, SampleType::I16);
    assert_eq!(
        hidden,
        format!("{place} is valid, but equals the nodata value -1")
    );
}

#[test]
fn failed_write_leaves_the_old_file() {
    let (folder, path) = in_folder("a.tif", b"old");
    let info = RasterInfo::new(500, 500, SampleType::F64);
    let stop = |first, rows: &mut [f64]| {
        rows.fill(0.0);
        if first > 0 {
            Err(Error::Cancelled)
        } else {
            Ok(())
        }
    };
    assert!(matches!(
        write_geotiff(&path, &info, stop),
        Err(Error::Cancelled)
    ));
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn folder_that_does_not_exist_is_named() {
    let path = Path::new("no such folder").join("a.tif");
    let text = write(&of(two_by_one(SampleType::U8)), &path)
        .unwrap_err()
        .to_string();
    assert!(
        text.starts_with(&format!("{}: cannot create: ", path.display())),
        "{text}"
    );
}
