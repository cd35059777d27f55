//! What commands give when all is well.

use crate::kmb;
use crate::kmb::{Folder, assert_numbers, sample};
use kimberlite::build::source::{SourceOptions, open};
use kimberlite::geo::RasterInfo;
use serde_json::{Map, Value};
use std::path::Path;

/// A raster's description and all its samples.
fn read(path: &Path) -> (RasterInfo, Vec<f64>) {
    let mut source = open(path, &SourceOptions::default()).unwrap();
    let info = source.info().clone();
    let mut samples = vec![0.0; info.width as usize * info.height as usize];
    source.read_rows(&mut samples).unwrap();
    (info, samples)
}

/// Builds a sample at an error, verifies it against the input and extracts it.
fn round_trip(name: &str, max_error: &str) {
    let (folder, input) = (Folder::new(), sample(name));
    let (repository, output) = (folder.path("a.kmb"), folder.path("a.tif"));
    let built = kmb![
        "build",
        &input,
        "-o",
        &repository,
        "--max-error",
        max_error,
        "--json"
    ];
    let built = built.succeeds().json();
    assert_numbers(
        &built,
        &[
            "samples",
            "bytes",
            "bits_per_sample",
            "max_error",
            "rms_error",
        ],
    );
    assert_numbers(&built, &["seconds", "peak_memory_bytes"]);
    let found = kmb!["verify", &repository, "--against", &input, "--json"]
        .succeeds()
        .json();
    assert_eq!(found["ok"], true);
    assert_eq!(found["damaged_blocks"], 0);
    assert_eq!(found["void_mismatches"], 0);
    let bound: f64 = max_error.parse().unwrap();
    assert!(found["max_error"].as_f64().unwrap() <= bound);
    assert_eq!(
        found["max_error"], built["max_error"],
        "the builder believes another error"
    );
    let extracted = kmb!["extract", &repository, "-o", &output, "--json"]
        .succeeds()
        .json();
    let ((expected, input), (restored, samples)) = (read(&input), read(&output));
    assert_eq!(extracted["width"], expected.width);
    assert_eq!(extracted["height"], expected.height);
    assert_numbers(&extracted, &["level"]);
    assert_restored(&restored, &expected);
    let valid = || input.iter().copied().filter(|sample| !sample.is_nan());
    let range = valid().fold(f64::INFINITY, f64::min)..=valid().fold(f64::NEG_INFINITY, f64::max);
    for (index, (sample, input)) in samples.iter().zip(&input).enumerate() {
        assert_eq!(
            sample.is_nan(),
            input.is_nan(),
            "{name}: void of sample {index}"
        );
        assert!(input.is_nan() || ((sample - input).abs() <= bound && range.contains(sample)));
    }
}

fn assert_restored(restored: &RasterInfo, expected: &RasterInfo) {
    assert_eq!(restored.sample_type, expected.sample_type);
    assert_eq!(restored.nodata, expected.nodata);
    assert_eq!(restored.georeferenced, expected.georeferenced);
    assert_eq!(restored.crs, expected.crs);
    assert_eq!(restored.units, expected.units);
    assert_eq!(restored.value_scale, expected.value_scale);
    assert_eq!(restored.value_offset, expected.value_offset);
    if expected.georeferenced {
        assert_eq!(restored.geotransform, expected.geotransform);
        assert_eq!(restored.registration, expected.registration);
        assert_eq!(restored.geographic, expected.geographic);
    }
}

#[test]
fn what_comes_out_is_what_went_in_within_the_error() {
    for (name, errors) in [
        ("delft_dsm_0.5m_1.tif", ["0", "0.05", "1"]),
        ("jacksboro_fault_srtm3.tif", ["0", "1", "7.5"]),
        ("puget_sound_1025_decimetres.png", ["0", "2", "10"]),
        ("rocky_mountain_np_dem.tif", ["0", "1", "20"]),
        ("srtm3_N49W123.tif", ["0", "1", "10"]),
    ] {
        for max_error in errors {
            round_trip(name, max_error);
        }
    }
}

#[test]
fn every_transform_is_named_and_verified() {
    let folder = Folder::new();
    let (input, repository) = (sample("jacksboro_fault_srtm3.tif"), folder.path("a.kmb"));
    for (transform, option, limit) in [
        ("interpolating", "--max-error", 4.0),
        ("two-stage", "--max-error", 4.0),
        ("lifted", "--max-error", 0.0),
        ("lifted", "--rms", 2.0),
    ] {
        let number = limit.to_string();
        let run = kmb![
            "build",
            &input,
            "-o",
            &repository,
            "--transform",
            transform,
            option,
            &number,
            "--json"
        ];
        let built = run.succeeds().json();
        let kept = if option == "--rms" {
            "rms_error"
        } else {
            "max_error"
        };
        assert!(built[kept].as_f64().unwrap() <= limit, "{built:?}");
        let info = kmb!["info", &repository, "--json"].succeeds().json();
        assert_eq!(info["transform"], transform);
        assert_eq!(info["lossless"], limit == 0.0);
        assert_eq!(info["max_error"], built["max_error"]);
        let bound = info["max_error_bound"].as_f64().unwrap();
        if option == "--rms" {
            assert_eq!(info["max_error_bound"], built["max_error"]);
        } else {
            assert_eq!(bound, limit);
        }
        let found = kmb!["verify", &repository, "--against", &input, "--json"];
        let found = found.succeeds().json();
        assert_eq!(found["max_error"], built["max_error"]);
        assert_eq!(found["rms_error"], built["rms_error"]);
    }
}

#[test]
fn neighbouring_rasters_become_one() {
    let (folder, west, east) = (
        Folder::new(),
        sample("srtm3_N49W124.tif"),
        sample("srtm3_N49W123.tif"),
    );
    let repository = folder.path("both.kmb");
    kmb!["build", &west, &east, "-o", &repository, "--max-error", "3"].succeeds();
    let found = kmb!["verify", &repository, "--against", &west, &east, "--json"];
    assert_eq!(found.succeeds().json()["ok"], true);
    let info = kmb!["info", &repository, "--json"].succeeds().json();
    assert_eq!(
        (&info["width"], &info["height"]),
        (&2401.into(), &1201.into())
    );
}

#[test]
fn the_same_input_gives_the_same_bytes_with_any_number_of_threads() {
    let (folder, input) = (Folder::new(), sample("delft_dsm_0.5m_1.tif"));
    let build = |threads: &str| {
        let output = folder.path(threads);
        let options = ["--max-error", "0.1", "--cells", "16", "--threads", threads];
        let [a, b, c, d, e, f] = options;
        kmb!["build", &input, "-o", &output, a, b, c, d, e, f].succeeds();
        std::fs::read(output).unwrap()
    };
    assert!(build("1") == build("3"));
}

#[test]
fn info_tells_what_a_program_needs() {
    let (folder, input) = (Folder::new(), sample("rocky_mountain_np_dem.tif"));
    let repository = folder.path("a.kmb");
    let built = kmb![
        "build",
        &input,
        "-o",
        &repository,
        "--max-error",
        "1.5",
        "--json"
    ];
    let built = built.succeeds().json();
    let info = kmb!["info", &repository, "--json"].succeeds().json();
    for (key, value) in [
        ("kind", "heights"),
        ("domain", "planar"),
        ("transform", "interpolating"),
    ] {
        assert_eq!(info[key], value);
    }
    assert_eq!(info["entropy"], "rans");
    assert_eq!((&info["cells"], &info["levels"]), (&64.into(), &4.into()));
    assert_eq!(info["samples"], 187 * 152);
    for key in [
        "bytes",
        "bits_per_sample",
        "max_error",
        "rms_error",
        "samples",
    ] {
        assert_eq!(info[key], built[key], "{key}");
    }
    let file_bytes = std::fs::metadata(&repository).unwrap().len();
    assert_eq!(info["bytes"], file_bytes);
    let valid = info["samples"].as_f64().unwrap() - info["void_samples"].as_f64().unwrap();
    assert_eq!(info["bits_per_sample"], 8.0 * file_bytes as f64 / valid);
    assert_numbers(
        &info,
        &[
            "diamonds",
            "void_samples",
            "payload_bytes",
            "max_error_bound",
        ],
    );
    assert_numbers(
        &info,
        &["width", "height", "value_scale", "value_offset", "nodata"],
    );
    assert_eq!(info["sample_type"], "u16");
    assert_eq!(info["geotransform"].as_array().map(Vec::len), Some(6));
    assert!(info["crs"].is_string() && info["units"].is_string() && info["metadata"].is_object());
    let text = kmb!["info", &repository].succeeds().stdout;
    assert!(
        text.lines()
            .any(|line| line.split_whitespace().eq(["kind", "heights"])),
        "{text}"
    );
}

/// Width, height and level that `kmb extract` printed.
fn shape(extracted: &Map<String, Value>) -> [u64; 3] {
    ["width", "height", "level"].map(|key| extracted[key].as_u64().unwrap())
}

/// Fails unless every sample of `part` is the whole's sample at the same coordinates.
fn assert_part_of(part: &(RasterInfo, Vec<f64>), whole: &(RasterInfo, Vec<f64>)) {
    assert_eq!(part.0.registration, whole.0.registration);
    for (index, sample) in part.1.iter().enumerate() {
        let at = [index % part.0.width as usize, index / part.0.width as usize];
        let [x, y] = part.0.sample_to_crs(at[0] as f64, at[1] as f64);
        let [column, row] = whole.0.crs_to_sample(x, y).unwrap();
        assert!((column - column.round()).abs() < 1e-6 && (row - row.round()).abs() < 1e-6);
        let place = row.round() as usize * whole.0.width as usize + column.round() as usize;
        assert!(whole.1[place] == *sample || (whole.1[place].is_nan() && sample.is_nan()));
    }
}

#[test]
fn coarse_levels_and_boxes_keep_every_sample_in_its_place() {
    for name in ["srtm3_N49W123.tif", "delft_dsm_0.5m_1.tif"] {
        let (folder, input) = (Folder::new(), sample(name));
        let (repository, output) = (folder.path("a.kmb"), folder.path("a.tif"));
        kmb!["build", &input, "-o", &repository, "--max-error", "0"].succeeds();
        let whole = read(&input);
        let levels = kmb!["info", &repository, "--json"].succeeds().json()["levels"].clone();
        let level = levels.as_u64().unwrap() - 4;
        let argument = level.to_string();
        let run = kmb![
            "extract",
            &repository,
            "-o",
            &output,
            "--level",
            &argument,
            "--json"
        ];
        let (width, height) = (u64::from(whole.0.width), u64::from(whole.0.height));
        let expected = [(width - 1) / 4 + 1, (height - 1) / 4 + 1, level];
        assert_eq!(shape(&run.succeeds().json()), expected);
        assert_part_of(&read(&output), &whole);

        // From one sample to another, a little inside of one and outside of the other.
        let [x0, y0] = whole
            .0
            .sample_to_crs(100.2, 51.2)
            .map(|number| number.to_string());
        let [x1, y1] = whole
            .0
            .sample_to_crs(300.2, 160.8)
            .map(|number| number.to_string());
        let run = kmb![
            "extract",
            &repository,
            "-o",
            &output,
            "--bbox",
            &x1,
            &y0,
            &x0,
            &y1,
            "--json"
        ];
        let finest = levels.as_u64().unwrap();
        assert_eq!(shape(&run.succeeds().json()), [200, 109, finest]);
        let part = read(&output);
        assert_part_of(&part, &whole);
        let first = whole.0.sample_to_crs(101.0, 52.0);
        let found = part.0.sample_to_crs(0.0, 0.0);
        assert!(
            (0..2).all(|axis| (found[axis] - first[axis]).abs() < 1e-6),
            "{found:?} {first:?}"
        );
    }
}

#[test]
fn a_height_is_the_input_within_its_bound() {
    let (folder, input) = (Folder::new(), sample("srtm3_S33W071.tif"));
    let repository = folder.path("a.kmb");
    kmb!["build", &input, "-o", &repository, "--max-error", "4"].succeeds();
    let (info, samples) = read(&input);
    for [column, row] in [[0, 0], [17, 1200], [600, 601], [1200, 1200]] {
        let [x, y] = info.sample_to_crs(f64::from(column), f64::from(row));
        let (x, y) = (x.to_string(), y.to_string());
        let found = kmb!["height", &repository, &x, &y, "--json"]
            .succeeds()
            .json();
        let [height, bound] = ["height", "error_bound"].map(|key| found[key].as_f64().unwrap());
        let expected = samples[row as usize * 1201 + column as usize];
        assert!(
            (height - expected).abs() <= bound + 1e-6,
            "{height} {expected}"
        );
        assert!(bound <= 4.0);
        assert_eq!(found["level"], 10);
    }
}

#[test]
fn a_flight_has_no_cracks_and_tells_what_it_cost() {
    let (folder, input) = (Folder::new(), sample("srtm3_N49W123.tif"));
    let repository = folder.path("a.kmb");
    kmb!["build", &input, "-o", &repository, "--max-error", "1"].succeeds();
    let by_size = ["--metric", "sampling", "--tolerance", "6"];
    for budget in [&["--tolerance", "2"][..], &by_size, &["--budget-us", "0"]] {
        let mut arguments = vec!["fly", repository.to_str().unwrap(), "--json"];
        arguments.extend(["--frames", "40", "--size", "640x480"].iter().chain(budget));
        let flown = kmb::kmb(arguments).succeeds().json();
        assert_eq!(flown["frames"], 40);
        assert_eq!(flown["cracks"], 0);
        assert_eq!(flown["budget_overruns"], 0);
        assert_numbers(&flown, &["update_us_p50", "update_us_p99", "update_us_max"]);
        assert_numbers(
            &flown,
            &["fixed_us_p50", "fixed_us_p99", "peak_memory_bytes"],
        );
        let [triangles, patches, refined] = ["triangles_mean", "patches_mean", "refined_diamonds"]
            .map(|key| flown[key].as_f64().unwrap());
        assert!(triangles > patches && patches >= 1.0, "{flown:?}");
        assert_eq!(refined > 0.0, budget[0] != "--budget-us", "{flown:?}");
    }
}

#[test]
fn bench_measures_decoding_and_look_ups() {
    let folder = Folder::new();
    let measured = kmb!["bench", &folder.small_repository("a.kmb"), "--json"]
        .succeeds()
        .json();
    assert_numbers(
        &measured,
        &["decode_msamples_per_s", "get_ns_p50", "get_ns_p99"],
    );
    assert!(measured["decode_msamples_per_s"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_raster_of_two_columns_is_a_terrain() {
    let folder = Folder::new();
    let samples: Vec<f32> = (0..2 * 300)
        .map(|index| (index % 37) as f32 * 0.25)
        .collect();
    let input = folder.write_f32("narrow.bin", &samples);
    let repository = folder.path("narrow.kmb");
    let raw = ["--raw", "2x300xf32"];
    for max_error in ["0", "0.5"] {
        let run = kmb![
            "build",
            &input,
            raw[0],
            raw[1],
            "-o",
            &repository,
            "--max-error",
            max_error
        ];
        run.succeeds();
        let run = kmb![
            "verify",
            &repository,
            "--against",
            &input,
            raw[0],
            raw[1],
            "--json"
        ];
        assert_eq!(run.succeeds().json()["ok"], true);
    }
}

#[test]
fn not_a_number_is_void() {
    let folder = Folder::new();
    let mut samples: Vec<f32> = (0..400).map(|index| index as f32).collect();
    (samples[21], samples[22], samples[399]) = (f32::NAN, f32::NAN, f32::NAN);
    let input = folder.write_f32("holes.bin", &samples);
    let (repository, raw) = (folder.path("holes.kmb"), "20x20xf32");
    kmb![
        "build",
        &input,
        "--raw",
        raw,
        "-o",
        &repository,
        "--max-error",
        "1"
    ]
    .succeeds();
    let info = kmb!["info", &repository, "--json"].succeeds().json();
    assert_eq!(info["void_samples"], 3);
    let run = kmb![
        "verify",
        &repository,
        "--against",
        &input,
        "--raw",
        raw,
        "--json"
    ];
    let found = run.succeeds().json();
    assert_eq!(
        (&found["ok"], &found["void_mismatches"]),
        (&true.into(), &0.into())
    );
}
