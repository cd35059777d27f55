//! What commands say of input that they cannot use.

use crate::kmb;
use crate::kmb::{Folder, sample};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::tool::raster_file::write_geotiff;
use std::fs;
use std::path::Path;

/// Builds from raw f32 samples, which must be refused, and leaves nothing.
fn refused_raw(shape: &str, samples: &[f32], parts: &[&str]) {
    let folder = Folder::new();
    let input = folder.write_f32("raw.bin", samples);
    let output = folder.path("raw.kmb");
    let run = kmb![
        "build",
        &input,
        "--raw",
        shape,
        "-o",
        &output,
        "--max-error",
        "1"
    ];
    run.refuses("raw.bin", parts);
    assert_eq!(folder.names(), ["raw.bin"]);
}

#[test]
fn a_missing_file() {
    let folder = Folder::new();
    let (missing, output) = (folder.path("missing.tif"), folder.path("a.kmb"));
    let run = kmb!["build", &missing, "-o", &output, "--max-error", "1"];
    run.refuses("missing.tif", &["No such file"]);
    for command in ["info", "verify", "bench", "fly"] {
        kmb![command, &folder.path("missing.kmb")].refuses("missing.kmb", &["No such file"]);
    }
}

#[test]
fn a_text_file_named_tif_or_kmb() {
    let folder = Folder::new();
    let text = folder.write("text.tif", b"This is no picture.\n");
    let run = kmb![
        "build",
        &text,
        "-o",
        &folder.path("a.kmb"),
        "--max-error",
        "1"
    ];
    run.refuses("text.tif", &[]);
    let text = folder.write("text.kmb", b"This is no terrain.\n");
    kmb!["info", &text].refuses("text.kmb", &["not a Kimberlite repository"]);
    kmb!["verify", &text].refuses("text.kmb", &["not a Kimberlite repository"]);
    assert!(!folder.path("a.kmb").exists());
}

/// Verifies damaged bytes, which must fail with code 1, both for people and for programs.
fn found_damaged(folder: &Folder, bytes: &[u8], parts: &[&str]) {
    let file = folder.write("damaged.kmb", bytes);
    let run = kmb!["verify", &file];
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    run.complains("damaged.kmb", parts);
    let run = kmb!["verify", &file, "--json"];
    assert_eq!((run.code, &run.json()["ok"]), (Some(1), &false.into()));
    assert_ne!(run.json()["damaged_blocks"], 0);
    assert!(!run.json()["damage"].as_array().unwrap().is_empty());
}

#[test]
fn a_truncated_repository() {
    let folder = Folder::new();
    let bytes = fs::read(folder.small_repository("a.kmb")).unwrap();
    for length in [0, 7, 100, 303, 304, bytes.len() / 2, bytes.len() - 1] {
        found_damaged(&folder, &bytes[..length], &["truncated"]);
        kmb!["info", &folder.path("damaged.kmb")].refuses("damaged.kmb", &["truncated"]);
    }
}

#[test]
fn one_flipped_bit_in_header_index_or_block() {
    let folder = Folder::new();
    let bytes = fs::read(folder.small_repository("a.kmb")).unwrap();
    // Where the header says that the sections begin (docs/format.md).
    let offset =
        |field: usize| u64::from_le_bytes(bytes[field..field + 8].try_into().unwrap()) as usize;
    let (index, blocks) = (offset(256), offset(272));
    let flipped = |place: usize| {
        let mut bytes = bytes.clone();
        bytes[place] ^= 4;
        bytes
    };
    for place in [16, 30, 200] {
        found_damaged(&folder, &flipped(place), &["header", "checksum mismatch"]);
    }
    found_damaged(
        &folder,
        &flipped(index + 9),
        &["level 0 diamond (536870912, 536870912)"],
    );
    for place in [blocks, (blocks + bytes.len()) / 2, bytes.len() - 1] {
        found_damaged(
            &folder,
            &flipped(place),
            &["level", "diamond (", "checksum mismatch"],
        );
    }
    // What cannot be told of damaged ground is not told.
    let output = folder.path("a.tif");
    let run = kmb!["extract", &folder.path("damaged.kmb"), "-o", &output];
    run.refuses("damaged.kmb", &["damaged"]);
    assert!(!output.exists());
}

#[test]
fn a_repository_of_another_raster() {
    let folder = Folder::new();
    let repository = folder.small_repository("a.kmb");
    let other = sample("rocky_mountain_np_dem.tif");
    let run = kmb!["verify", &repository, "--against", &other];
    run.refuses("a.kmb", &["403 x 344", "152 x 187"]);
    let mut samples: Vec<f32> = (0..64).map(|index| index as f32).collect();
    let input = folder.write_f32("a.bin", &samples);
    let output = folder.path("b.kmb");
    kmb![
        "build",
        &input,
        "--raw",
        "8x8xf32",
        "-o",
        &output,
        "--max-error",
        "1"
    ]
    .succeeds();
    samples[9] += 5.0;
    let changed = folder.write_f32("b.bin", &samples);
    let run = kmb!["verify", &output, "--against", &changed, "--raw", "8x8xf32"];
    assert_eq!(run.code, Some(1));
    run.complains("b.kmb", &["exceeds the stored bound 1"]);
    samples[9] = f32::NAN;
    let changed = folder.write_f32("b.bin", &samples);
    let run = kmb![
        "verify",
        &output,
        "--against",
        &changed,
        "--raw",
        "8x8xf32",
        "--json"
    ];
    assert_eq!(
        (run.code, &run.json()["void_mismatches"]),
        (Some(1), &1.into())
    );
}

#[test]
fn rasters_without_area() {
    refused_raw("1x1xf32", &[1.0], &["1 x 1", "both sides need at least 2"]);
    refused_raw(
        "1x5xf32",
        &[1.0; 5],
        &["1 x 5", "both sides need at least 2"],
    );
    refused_raw(
        "5x1xf32",
        &[1.0; 5],
        &["5 x 1", "both sides need at least 2"],
    );
}

#[test]
fn an_infinite_sample() {
    let mut samples = [1.0; 64];
    samples[8 * 5 + 3] = f32::INFINITY;
    refused_raw("8x8xf32", &samples, &["infinit", "column 3", "row 5"]);
}

#[test]
fn a_max_error_that_is_none() {
    let folder = Folder::new();
    let (input, output) = (sample("rocky_mountain_np_dem.tif"), folder.path("a.kmb"));
    for value in ["-1", "-0.5", "nan", "inf", "one", ""] {
        let run = kmb!["build", &input, "-o", &output, "--max-error", value];
        run.refuses("--max-error", &[value]);
    }
    kmb!["build", &input, "-o", &output].refuses("--max-error", &["required"]);
    assert!(folder.names().is_empty());
}

#[test]
fn options_that_do_not_exist_yet() {
    let folder = Folder::new();
    let (input, output) = (sample("rocky_mountain_np_dem.tif"), folder.path("a.kmb"));
    for [option, value] in [
        ["--transform", "two-lifted"],
        ["--entropy", "huffman"],
        ["--cells", "48"],
    ] {
        let run = kmb![
            "build",
            &input,
            "-o",
            &output,
            "--max-error",
            "1",
            option,
            value
        ];
        run.refuses(option, &[value, "possible values"]);
    }
}

#[test]
fn errors_that_a_transform_cannot_keep() {
    let folder = Folder::new();
    let (input, output) = (sample("jacksboro_fault_srtm3.tif"), folder.path("a.kmb"));
    for (transform, option, value, cause) in [
        ("interpolating", "--rms", "1", "needs the transform lifted"),
        ("two-stage", "--rms", "1", "needs the transform lifted"),
        ("lifted", "--max-error", "1", "keeps no maximum error"),
    ] {
        let run = kmb![
            "build",
            &input,
            "-o",
            &output,
            "--transform",
            transform,
            option,
            value
        ];
        run.refuses("jacksboro_fault_srtm3.tif", &[cause]);
    }
    let both = kmb![
        "build",
        &input,
        "-o",
        &output,
        "--max-error",
        "0",
        "--rms",
        "1"
    ];
    both.refuses("--rms", &["cannot be used with"]);
    kmb!["build", &input, "-o", &output, "--rms", "nan"].refuses("--rms", &["nan"]);
    assert!(folder.names().is_empty());
}

#[test]
fn an_output_folder_that_does_not_exist() {
    let folder = Folder::new();
    let input = sample("rocky_mountain_np_dem.tif");
    let output = folder.path("nowhere").join("a.kmb");
    let run = kmb!["build", &input, "-o", &output, "--max-error", "1"];
    run.refuses("nowhere", &["No such file"]);
    let repository = folder.small_repository("a.kmb");
    let output = folder.path("nowhere").join("a.tif");
    kmb!["extract", &repository, "-o", &output].refuses("nowhere", &["No such file"]);
    assert_eq!(folder.names(), ["a.kmb"]);
}

#[test]
fn levels_and_boxes_without_samples() {
    let folder = Folder::new();
    let (repository, output) = (folder.small_repository("a.kmb"), folder.path("a.tif"));
    for level in ["3", "8"] {
        let run = kmb!["extract", &repository, "-o", &output, "--level", level];
        run.refuses("a.kmb", &[level, "even", "0 to 6"]);
    }
    let run = kmb![
        "extract",
        &repository,
        "-o",
        &output,
        "--bbox",
        "-1",
        "-2",
        "-3",
        "-4"
    ];
    run.refuses("a.kmb", &["no sample", "-1 -2 -3 -4"]);
    assert!(!output.exists());
}

#[test]
fn a_height_outside_and_one_that_is_void() {
    let folder = Folder::new();
    let mut samples = [7.0; 64];
    samples[..3].fill(f32::NAN);
    let input = folder.write_f32("a.bin", &samples);
    let output = folder.path("a.kmb");
    kmb![
        "build",
        &input,
        "--raw",
        "8x8xf32",
        "-o",
        &output,
        "--max-error",
        "1"
    ]
    .succeeds();
    kmb!["height", &output, "3.5", "0"].succeeds();
    kmb!["height", &output, "1", "7"].refuses("a.kmb", &["(1, 7) is void"]);
    kmb!["height", &output, "-0.5", "0"].refuses("a.kmb", &["(-0.5, 0) is outside"]);
}

/// An integer tile without a value for voids, its left side at `x`.
fn tile(path: &Path, x: f64) {
    let mut info = RasterInfo::new(20, 20, SampleType::I16);
    info.georeferenced = true;
    info.geotransform = [x, 1.0, 0.0, 0.0, 0.0, -1.0];
    write_geotiff(path, &info, |_, samples| {
        samples.fill(5.0);
        Ok(())
    })
    .unwrap();
}

#[test]
fn voids_that_an_integer_raster_cannot_say() {
    let folder = Folder::new();
    let (west, east) = (folder.path("west.tif"), folder.path("east.tif"));
    tile(&west, 0.0);
    tile(&east, 30.0);
    let (repository, output) = (folder.path("a.kmb"), folder.path("a.tif"));
    kmb!["build", &west, &east, "-o", &repository, "--max-error", "0"].succeeds();
    kmb!["extract", &repository, "-o", &output].refuses("a.kmb", &["void", "--nodata V"]);
    assert!(!output.exists());
    let nodata = ["--nodata", "-32768"];
    let run = kmb![
        "build",
        &west,
        &east,
        nodata[0],
        nodata[1],
        "-o",
        &repository,
        "--max-error",
        "0"
    ];
    run.succeeds();
    kmb!["extract", &repository, "-o", &output].succeeds();
    let info = kmb!["info", &repository, "--json"].succeeds().json();
    assert_eq!(
        (&info["void_samples"], &info["nodata"]),
        (&200.into(), &(-32768.0).into())
    );
}
