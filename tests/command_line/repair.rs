//! `kmb repair`, and what the other commands make of its result.

use crate::kmb;
use crate::kmb::{Folder, sample};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// A repository of a shipped raster with one wrong byte this far from its end.
fn damaged(folder: &Folder, input: &Path, from_end: usize) -> PathBuf {
    let file = folder.path("damaged.kmb");
    let built = kmb![
        "build",
        input,
        "-o",
        &file,
        "--max-error",
        "2",
        "--cells",
        "16"
    ];
    built.succeeds();
    let mut bytes = fs::read(&file).unwrap();
    let place = bytes.len() - from_end;
    bytes[place] ^= 0x10;
    fs::write(&file, bytes).unwrap();
    file
}

#[test]
fn a_damaged_file_stays_damaged_or_a_repaired_one_is_called_so() {
    let (folder, input) = (Folder::new(), sample("jacksboro_fault_srtm3.tif"));
    let file = damaged(&folder, &input, 3000);
    let found = kmb!["verify", &file, "--json"].json();
    assert_eq!(
        (&found["ok"], &found["missing_blocks"]),
        (&false.into(), &0.into())
    );
    let damaged_blocks = found["damaged_blocks"].as_u64().unwrap();
    let line = found["damage"][0].as_str().unwrap();
    assert!(
        (1..=8).contains(&damaged_blocks) && line.starts_with("level "),
        "{line}"
    );

    let out = folder.path("out.kmb");
    let report = kmb!["repair", &file, "-o", &out, "--json"]
        .succeeds()
        .json();
    for key in ["damaged_blocks", "lost_blocks", "missing_blocks"] {
        assert_eq!(report[key], damaged_blocks, "{key}");
    }
    let coarse = report["coarse_samples"].as_u64().unwrap();
    assert!(coarse > 0 && report["blocked_blocks"].as_u64() >= Some(damaged_blocks));
    let info = kmb!["info", &out, "--json"].succeeds().json();
    assert_eq!(info["missing_detail"], true);
    let samples = info["samples"].as_f64().unwrap();
    let percent = report["coarse_percent"].as_f64().unwrap();
    assert!((percent - 100.0 * coarse as f64 / samples).abs() < 1e-9);
    assert_eq!(report["bytes"], fs::metadata(&out).unwrap().len());
    assert!(report["coarsest_level"].is_u64() && report["area_left_coarse"].is_number());

    let found = kmb!["verify", &out, "--against", &input, "--json"]
        .succeeds()
        .json();
    assert_eq!(
        (&found["ok"], &found["damaged_blocks"]),
        (&true.into(), &0.into())
    );
    assert_eq!(
        (&found["missing_blocks"], &found["coarse_samples"]),
        (&damaged_blocks.into(), &coarse.into())
    );
    assert!(found["max_error"].as_f64().unwrap() <= 2.0);
    assert!(found["missing"][0].as_str().unwrap().starts_with("level "));
    let tiff = folder.path("out.tif");
    let found = kmb!["extract", &out, "-o", &tiff, "--json"]
        .succeeds()
        .json();
    assert_eq!(found["coarse_samples"], coarse);
    let found = kmb!["fly", &out, "--frames", "5", "--json"]
        .succeeds()
        .json();
    assert_eq!(found["cracks"], 0);
    kmb!["bench", &out, "--json"].succeeds();

    let again = kmb!["repair", &file, "--json"].succeeds().json();
    assert_eq!(again, report);
    assert!(fs::read(&file).unwrap() == fs::read(&out).unwrap());
    let again = kmb!["repair", &file, "--json"].succeeds().json();
    assert_eq!(
        (&again["damaged_blocks"], &again["missing_blocks"]),
        (&0.into(), &damaged_blocks.into())
    );
    assert!(fs::read(&file).unwrap() == fs::read(&out).unwrap());
    let mut names = folder.names();
    names.sort();
    assert_eq!(names, ["damaged.kmb", "out.kmb", "out.tif"]);
}

#[test]
fn a_truncated_file_is_given_up() {
    let (folder, input) = (Folder::new(), sample("jacksboro_fault_srtm3.tif"));
    let file = damaged(&folder, &input, 1);
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let found = kmb!["verify", &file, "--json"].json();
    assert_eq!(found["missing_blocks"], Value::Null);
    let report = kmb!["repair", &file, "--json"].succeeds().json();
    assert!(report["lost_blocks"].as_u64() > Some(8));
    assert_eq!(
        kmb!["verify", &file, "--json"].succeeds().json()["ok"],
        true
    );
}

#[test]
fn what_cannot_be_repaired_is_not_named() {
    let (folder, input) = (Folder::new(), sample("jacksboro_fault_srtm3.tif"));
    let file = damaged(&folder, &input, 1);
    let mut bytes = fs::read(&file).unwrap();
    bytes[100] ^= 1;
    fs::write(&file, &bytes).unwrap();
    let parts = ["header: checksum mismatch", "nothing can be repaired"];
    kmb!["repair", &file].refuses("damaged.kmb", &parts);
    assert!(fs::read(&file).unwrap() == bytes);
}
