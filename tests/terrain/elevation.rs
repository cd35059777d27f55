//! Real rasters by every transform and coder, lossless and at three errors: built, verified against their input,
//! extracted, compared.
//!
//! All of that takes `data/` and the folder that `KIMBERLITE_DATA` names (`make sweep`). Without such a folder large
//! rasters take two methods in turn. Says what it passed over.

use crate::methods::{METHODS, Method};
use crate::rasters::max_difference;
use kimberlite::build::build;
use kimberlite::build::source::{SourceOptions, open};
use kimberlite::cut::Terrain;
use kimberlite::geo::RasterInfo;
use kimberlite::store::Access;
use kimberlite::tool::{self, Extract};
use std::path::{Path, PathBuf};

const SUFFIXES: [&str; 6] = ["tif", "tiff", "png", "hgt", "asc", "bil"];

fn rasters() -> Vec<PathBuf> {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let named = std::env::var_os("KIMBERLITE_DATA").map(PathBuf::from);
    if named.is_none() {
        println!("KIMBERLITE_DATA names no folder: only data/ is taken");
    }
    let mut files = Vec::new();
    for folder in [Some(shipped), named].into_iter().flatten() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let suffix = path
                .extension()
                .map(|suffix| suffix.to_string_lossy().to_lowercase());
            if suffix.is_some_and(|suffix| SUFFIXES.contains(&suffix.as_str())) {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

fn read(path: &Path) -> (RasterInfo, Vec<f64>) {
    let mut source = open(path, &SourceOptions::default()).unwrap();
    let info = source.info().clone();
    let mut samples = vec![0.0; info.width as usize * info.height as usize];
    source.read_rows(&mut samples).unwrap();
    (info, samples)
}

fn check(path: &Path, method: Method, error: f64) {
    let folder = tempfile::tempdir().unwrap();
    let repository = folder.path().join("a.kmb");
    let mut source = open(path, &SourceOptions::default()).unwrap();
    let options = method.options(error, 6);
    let report = build(source.as_mut(), &options, &repository, &mut |_, _| true).unwrap();
    let max_error = match options.rms_error {
        None => error,
        Some(rms_error) => {
            assert!(report.rms_error <= rms_error);
            report.max_error
        }
    };
    let valid = (report.samples - report.void_samples).max(1);

    let terrain = Terrain::open(&repository, Access::Positioned).unwrap();
    let mut again = open(path, &SourceOptions::default()).unwrap();
    let verdict = tool::verify(&terrain, Some(again.as_mut()), &mut |_, _| true).unwrap();
    let found = verdict.comparison.unwrap();
    assert!(verdict.ok, "{}", path.display());
    assert_eq!(found.void_mismatches, 0);
    assert!(found.max_error <= max_error);
    assert_eq!(found.max_error, report.max_error);

    let extracted = folder.path().join("a.tif");
    let whole = Extract {
        level: None,
        corners: None,
    };
    tool::extract(&terrain, &extracted, &whole, &mut |_, _| true).unwrap();
    let ((info, samples), (found, decoded)) = (read(path), read(&extracted));
    assert!(max_difference(&samples, &decoded) <= max_error);
    assert_eq!(found.sample_type, info.sample_type);
    assert_eq!(
        found.nodata.map(f64::to_bits),
        info.nodata.map(f64::to_bits)
    );
    assert_eq!((&found.crs, found.geographic), (&info.crs, info.geographic));
    assert_eq!(
        (found.value_scale, found.value_offset),
        (info.value_scale, info.value_offset)
    );
    if info.georeferenced {
        let corners = |info: &RasterInfo| {
            let last = [f64::from(info.width) - 1.0, f64::from(info.height) - 1.0];
            [
                info.sample_to_crs(0.0, 0.0),
                info.sample_to_crs(last[0], last[1]),
            ]
            .concat()
        };
        let tolerance = info.geotransform[1].abs() * 1e-6;
        for (a, b) in corners(&info).iter().zip(corners(&found)) {
            assert!(
                (a - b).abs() <= tolerance,
                "the geotransform moved: {a} to {b}"
            );
        }
        assert_eq!(found.registration, info.registration);
    }
    let extremes = |samples: &[f64]| {
        let valid = samples.iter().filter(|sample| !sample.is_nan());
        valid.fold([f64::MAX, f64::MIN], |[low, high], &s| {
            [low.min(s), high.max(s)]
        })
    };
    let (allowed, reached) = (extremes(&samples), extremes(&decoded));
    assert!(
        allowed[0] <= reached[0] && reached[1] <= allowed[1],
        "beyond the input's range"
    );
    println!(
        "{:33} {:13} {:5} {:8} at {error:4}: max error {:8.4}, bits per sample {:7.4}",
        path.file_name().unwrap().to_string_lossy(),
        format!("{:?}", method.transform),
        format!("{:?}", method.entropy),
        if method.adaptive { "adaptive" } else { "" },
        report.max_error,
        8.0 * report.bytes as f64 / valid as f64,
    );
}

/// Lossless where integer, and three errors.
fn errors(info: &RasterInfo) -> &'static [f64] {
    if info.sample_type.is_integer() {
        &[0.0, 1.0, 2.0, 8.0]
    } else {
        &[0.01, 0.1, 1.0]
    }
}

#[test]
fn real_rasters_keep_their_certified_error_georeference_and_voids() {
    let is_sweep = std::env::var_os("KIMBERLITE_DATA").is_some();
    let mut count = 0;
    for path in rasters() {
        let source = match open(&path, &SourceOptions::default()) {
            Ok(source) => source,
            Err(error) => {
                println!("passed over: {error}");
                continue;
            }
        };
        let info = source.info();
        let is_large = u64::from(info.width) * u64::from(info.height) > 1 << 19;
        for (place, &error) in errors(info).iter().enumerate() {
            for (turn, method) in METHODS.into_iter().enumerate() {
                let has_its_turn =
                    place % 2 == 0 && (turn + place + count).is_multiple_of(METHODS.len());
                if is_sweep || !is_large || has_its_turn {
                    check(&path, method, error);
                }
            }
        }
        if is_large && !is_sweep {
            let name = path.display();
            println!("{name}: one method lossless and one at an error of 2; make sweep has all");
        }
        count += 1;
    }
    assert!(count >= 7, "data/ has seven rasters");
}
