//! An image on the domain of its heights, through the command line.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name)
}

fn kmb(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kmb"));
    command.args(arguments).output().unwrap()
}

fn json(arguments: &[&str]) -> Value {
    let output = kmb(&[arguments, &["--json"]].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The one line that a command that cannot be done says.
fn refusal(arguments: &[&str]) -> String {
    let output = kmb(arguments);
    let line = String::from_utf8(output.stderr).unwrap();
    assert_eq!(
        (output.status.code(), line.lines().count()),
        (Some(2), 1),
        "{line}"
    );
    line
}

struct Scene {
    folder: tempfile::TempDir,
}

impl Scene {
    fn new() -> Scene {
        let scene = Scene {
            folder: tempfile::tempdir().unwrap(),
        };
        let (dem, heights) = (
            scene.input("rocky_mountain_np_dem.tif"),
            scene.path("h.kmb"),
        );
        json(&["build", &dem, "-o", &heights, "--max-error", "5"]);
        scene
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn input(&self, name: &str) -> String {
        sample(name).to_str().unwrap().to_owned()
    }
}

/// The corners of the heights in their reference system, as text.
fn corners(heights: &str) -> Vec<String> {
    let info = json(&["info", heights]);
    let number = |key: &str| info[key].as_f64().unwrap();
    let g: Vec<f64> = info["geotransform"]
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect();
    let (right, bottom) = (
        g[0] + number("width") * g[1],
        g[3] + number("height") * g[5],
    );
    [g[0], g[3], right, bottom]
        .map(|number| number.to_string())
        .to_vec()
}

#[test]
fn an_image_takes_over_place_and_reference_system_of_its_heights() {
    let scene = Scene::new();
    let (heights, colours) = (scene.path("h.kmb"), scene.path("c.kmb"));
    let image = scene.input("rocky_mountain_np_landsat_rgb.png");
    let bounds = corners(&heights);
    let bounds: Vec<&str> = bounds.iter().map(String::as_str).collect();
    let georeference = [&["--bounds"][..], &bounds].concat();
    let how = ["--colour", "--domain-of", &heights, "--max-error", "0"];
    let build = ["build", &image, "-o", &colours];
    let built = json(&[&build[..], &how, &georeference].concat());
    let texels = built["texels_per_sample"].as_u64().unwrap();
    let (info, ground) = (json(&["info", &colours]), json(&["info", &heights]));
    for (side, key) in [(&info["width"], "width"), (&info["height"], "height")] {
        let samples = ground[key].as_u64().unwrap();
        assert_eq!(side.as_u64(), Some((samples - 1) * texels + 1));
    }
    assert_eq!(info["kind"], "colours");
    for key in ["crs", "geographic", "georeferenced", "registration"] {
        assert_eq!(info[key], ground[key], "{key}");
    }
    let against = [
        "verify",
        &colours,
        "--against",
        &image,
        "--domain-of",
        &heights,
    ];
    let verdict = json(&[&against[..], &georeference].concat());
    assert_eq!(verdict["max_error"], 0.0);
    assert_eq!(verdict["ok"], true);
    let (extracted, again) = (scene.path("c.tif"), scene.path("again.kmb"));
    json(&["extract", &colours, "-o", &extracted]);
    json(&[
        "build",
        &extracted,
        "-o",
        &again,
        "--colour",
        "--max-error",
        "0",
    ]);
    assert_eq!(
        json(&["info", &again])["geotransform"],
        info["geotransform"]
    );
    let verdict = json(&["verify", &colours, "--against", &extracted]);
    assert_eq!(verdict["ok"], true);
}

#[test]
fn what_is_not_an_image_over_heights_is_refused_in_one_line() {
    let scene = Scene::new();
    let (heights, output) = (scene.path("h.kmb"), scene.path("out.kmb"));
    let image = scene.input("rocky_mountain_np_landsat_rgb.png");
    let dem = scene.input("rocky_mountain_np_dem.tif");
    let build = |input: &str, more: &[&str]| {
        refusal(&[&["build", input, "-o", &output, "--max-error", "0"], more].concat())
    };
    assert!(build(&dem, &["--colour"]).contains("colours have three"));
    assert!(build(&image, &[]).contains("rocky_mountain_np_landsat_rgb.png"));
    assert!(build(&image, &["--domain-of", &heights]).contains("--colour"));
    let over = ["--colour", "--domain-of", &heights];
    assert!(build(&image, &over).contains("no georeference"));
    let elsewhere = ["--bounds", "0", "0", "1", "1"];
    let line = build(&image, &[&over[..], &elsewhere].concat());
    assert!(line.contains("rocky_mountain_np_landsat_rgb.png"), "{line}");
    let colours = scene.path("c.kmb");
    json(&[
        "build",
        &image,
        "-o",
        &colours,
        "--colour",
        "--max-error",
        "9",
    ]);
    let over = [
        "--colour",
        "--domain-of",
        &colours,
        "--bounds",
        "0",
        "0",
        "1",
        "1",
    ];
    assert!(build(&image, &over).contains("it holds colours"));
    assert!(refusal(&["fly", &colours]).contains("it holds colours"));
    assert!(refusal(&["height", &colours, "1", "1"]).contains("it holds colours"));
    assert!(json(&["bench", &colours])["decode_msamples_per_s"].is_number());
    assert!(!Path::new(&output).exists());
}
