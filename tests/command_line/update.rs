//! `kmb update` beside a build of the mosaic that it stands for.

use crate::kmb;
use crate::kmb::{Folder, assert_numbers, sample};
use std::fs;
use std::path::{Path, PathBuf};

/// Samples of a lossy build in a box of a shipped raster, as GeoTIFF, and the box.
fn patch(folder: &Folder, input: &Path) -> (PathBuf, [String; 4]) {
    let (lossy, patch) = (folder.path("lossy.kmb"), folder.path("patch.tif"));
    kmb!["build", input, "-o", &lossy, "--max-error", "9"].succeeds();
    let info = kmb!["info", &lossy, "--json"].succeeds().json();
    let numbers = |key: &str| -> Vec<f64> {
        let numbers = info[key].as_array().unwrap().iter();
        numbers.map(|number| number.as_f64().unwrap()).collect()
    };
    let (origin, size) = (
        numbers("geotransform"),
        ["width", "height"].map(|key| info[key].as_f64().unwrap()),
    );
    let at = |share: [f64; 2]| {
        let [column, row] = [share[0] * size[0], share[1] * size[1]];
        [
            origin[0] + column * origin[1] + row * origin[2],
            origin[3] + column * origin[4] + row * origin[5],
        ]
    };
    let [[x0, y0], [x1, y1]] = [at([0.31, 0.42]), at([0.38, 0.5])];
    let corners = [x0, y0, x1, y1].map(|number| number.to_string());
    let [x0, y0, x1, y1] = &corners;
    kmb!["extract", &lossy, "-o", &patch, "--bbox", x0, y0, x1, y1].succeeds();
    (patch, corners)
}

#[test]
fn an_update_is_the_mosaic_and_a_reader_without_the_originals_is_told() {
    let (folder, input) = (Folder::new(), sample("jacksboro_fault_srtm3.tif"));
    let (patch, [x0, y0, x1, y1]) = patch(&folder, &input);
    let (file, mosaic) = (folder.path("a.kmb"), folder.path("mosaic.kmb"));
    for error in ["0", "3"] {
        kmb![
            "build",
            &input,
            "-o",
            &file,
            "--max-error",
            error,
            "--cells",
            "16"
        ]
        .succeeds();
        let old = fs::read(&file).unwrap();
        kmb![
            "build",
            &input,
            &patch,
            "-o",
            &mosaic,
            "--max-error",
            error,
            "--cells",
            "16",
            "--tables-from",
            &file
        ]
        .succeeds();
        if error == "3" {
            kmb!["update", &file, "--region", &x0, &y0, &x1, &y1, &patch]
                .refuses("a.kmb", &["not lossless", "original"]);
            assert_eq!(fs::read(&file).unwrap(), old);
        }
        let both = [&patch, &input];
        let given = if error == "0" { &both[..1] } else { &both[..] };
        let mut words: Vec<&std::ffi::OsStr> = ["update", "--json", "--region", &x0, &y0, &x1, &y1]
            .map(str::as_ref)
            .into();
        words.insert(1, file.as_ref());
        // Later ones lie over earlier ones.
        words.extend(given.iter().rev().map(|path| path.as_os_str()));
        let report = kmb::kmb(words).succeeds().json();
        assert_numbers(
            &report,
            &["diamonds_recomputed", "diamonds", "seconds", "bytes"],
        );
        let [recomputed, all] =
            ["diamonds_recomputed", "diamonds"].map(|key| report[key].as_u64().unwrap());
        assert!(
            recomputed > 0 && (error == "3" || recomputed < all / 4),
            "{recomputed} of {all}"
        );
        let new = fs::read(&file).unwrap();
        assert!(new == fs::read(&mosaic).unwrap() && new != old);
        assert_eq!(kmb!["verify", &file, "--json"].json()["ok"], true);
    }
}

#[test]
fn what_a_repair_lost_comes_back_with_the_originals() {
    let (folder, input) = (Folder::new(), sample("jacksboro_fault_srtm3.tif"));
    let (patch, [x0, y0, x1, y1]) = patch(&folder, &input);
    let (file, mosaic) = (folder.path("a.kmb"), folder.path("mosaic.kmb"));
    kmb![
        "build",
        &input,
        "-o",
        &file,
        "--max-error",
        "0",
        "--cells",
        "16"
    ]
    .succeeds();
    kmb![
        "build",
        &input,
        &patch,
        "-o",
        &mosaic,
        "--max-error",
        "0",
        "--cells",
        "16",
        "--tables-from",
        &file
    ]
    .succeeds();
    let mut bytes = fs::read(&file).unwrap();
    let place = bytes.len() - 99;
    bytes[place] ^= 4;
    fs::write(&file, bytes).unwrap();
    kmb!["update", &file, "--region", &x0, &y0, &x1, &y1, &patch].refuses("a.kmb", &["checksum"]);
    kmb!["repair", &file].succeeds();
    kmb!["update", &file, "--region", &x0, &y0, &x1, &y1, &patch]
        .refuses("a.kmb", &["missing", "original"]);
    kmb![
        "update", &file, "--region", &x0, &y0, &x1, &y1, &input, &patch
    ]
    .succeeds();
    assert!(fs::read(&file).unwrap() == fs::read(&mosaic).unwrap());
}
