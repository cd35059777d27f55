//! `kmb build-city` and `render-city`, and what other commands make of a city.

use crate::kmb;
use crate::kmb::{Folder, assert_numbers};
use std::fs;
use std::path::PathBuf;

/// A house 10 m high and a shed 3 m high.
fn houses(folder: &Folder) -> PathBuf {
    let mut text = String::new();
    let mut first = 1;
    for (name, [x, y, w, top]) in [("house", [0, 0, 12, 10]), ("shed", [30, 20, 8, 3])] {
        text += &format!("o {name}\n");
        for z in [0, top] {
            for (x, y) in [(x, y), (x + w, y), (x + w, y + w), (x, y + w)] {
                text += &format!("v {} {} {z}\n", 85_000 + x, 447_000 + y);
            }
        }
        for face in [
            [0, 1, 5, 4],
            [1, 2, 6, 5],
            [2, 3, 7, 6],
            [3, 0, 4, 7],
            [4, 5, 6, 7],
        ] {
            text += &format!(
                "f {} {} {} {}\n",
                face[0] + first,
                face[1] + first,
                face[2] + first,
                face[3] + first
            );
        }
        first += 8;
    }
    folder.write("houses.obj", text.as_bytes())
}

fn city(folder: &Folder) -> PathBuf {
    let output = folder.path("city.kmb");
    kmb![
        "build-city",
        &houses(folder),
        "-o",
        &output,
        "--k",
        "32",
        "--views",
        "8",
        "--leaf",
        "16"
    ]
    .succeeds();
    output
}

#[test]
fn a_city_is_built_without_its_numbers() {
    let folder = Folder::new();
    let (input, output) = (houses(&folder), folder.path("city.kmb"));
    let run = kmb![
        "build-city",
        &input,
        "-o",
        &output,
        "--k",
        "32",
        "--views",
        "8",
        "--facades",
        "3",
        "--memory",
        "64",
        "--json"
    ];
    let built = run.succeeds().json();
    let keys = [
        "blocks",
        "leaves",
        "levels",
        "bytes",
        "seconds",
        "seconds_per_block",
        "unassigned_wall_texels",
    ];
    assert_numbers(&built, &keys);
    assert_eq!(built["bytes"], fs::metadata(&output).unwrap().len());
    assert_eq!(folder.names().len(), 2, "{:?}", folder.names());
}

#[test]
fn a_rendered_city_has_holes_or_no_likeness() {
    let folder = Folder::new();
    let (file, pictures) = (city(&folder), folder.path("pictures"));
    let run = kmb![
        "render-city",
        &file,
        "--views",
        "3",
        "--size",
        "64x48",
        "--against",
        &folder.path("houses.obj"),
        "-o",
        &pictures,
        "--json"
    ];
    let seen = run.succeeds().json();
    assert_numbers(
        &seen,
        &[
            "psnr_mean",
            "psnr_min",
            "depth_error_mean",
            "holes",
            "rays_per_second",
        ],
    );
    assert_eq!(seen["holes"], 0);
    assert!(seen["psnr_mean"].as_f64() > Some(20.0), "{seen:?}");
    assert!(
        pictures.join("view_002.png").exists() && pictures.join("view_002_original.png").exists()
    );
    let alone = kmb![
        "render-city",
        &file,
        "--views",
        "1",
        "--size",
        "32x32",
        "-o",
        &pictures,
        "--json"
    ];
    assert!(alone.succeeds().json()["psnr_mean"].is_null());
}

#[test]
fn a_city_is_described_or_verified_as_a_terrain() {
    let folder = Folder::new();
    let file = city(&folder);
    let told = kmb!["info", &file, "--json"].succeeds().json();
    assert_eq!(told["kind"], "city");
    let verdict = kmb!["verify", &file, "--json"].succeeds().json();
    assert_eq!(
        (&verdict["ok"], &verdict["damaged_blocks"]),
        (&true.into(), &0.into())
    );
    let picture = folder.path("block.png");
    kmb!["extract", &file, "--block", "0", "-o", &picture].succeeds();
    assert!(fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    kmb!["fly", &file].refuses("city.kmb", &["city"]);
}

#[test]
fn a_damaged_city_is_sound() {
    let folder = Folder::new();
    let file = city(&folder);
    let whole = fs::read(&file).unwrap();
    let mut bytes = whole.clone();
    let place = bytes.len() - 20;
    bytes[place] ^= 0x10;
    fs::write(&file, &bytes).unwrap();
    let run = kmb!["verify", &file, "--json"];
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert_eq!(run.json()["ok"], false);
    fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    assert_eq!(kmb!["verify", &file, "--json"].code, Some(1));
    kmb!["render-city", &file, "-o", &folder.path("pictures")].refuses("city.kmb", &["truncated"]);
}

#[test]
fn bad_input_of_a_city_is_taken_or_leaves_a_file() {
    let folder = Folder::new();
    let output = folder.path("out.kmb");
    let build = |input: &PathBuf| kmb!["build-city", input, "-o", &output];
    build(&folder.path("absent.obj")).refuses("absent.obj", &[]);
    build(&folder.write("city.json", b"{\"type\": \"CityJSON\"")).refuses("city.json", &["line 1"]);
    build(&folder.write("empty.obj", b"v 0 0 0\n")).refuses("empty.obj", &["no triangle"]);
    build(&folder.write("city.dwg", b"AC1032")).refuses("city.dwg", &["dwg"]);
    let input = houses(&folder);
    kmb!["build-city", &input, "-o", &output, "--k", "48"].refuses("48", &[]);
    kmb!["build-city", &input, "-o", &output, "--leaf", "-3"].refuses("", &[]);
    kmb!["build-city", &input, "-o", &output, "--views", "0"].refuses("views", &[]);
    assert!(!output.exists());
}
