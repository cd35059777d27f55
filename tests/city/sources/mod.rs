//! Files of cities become scenes.

mod city_json;
mod damage;
mod facades;
mod faults;
mod gltf;
mod images;
mod obj;
mod polygons;
mod procedural;

use std::path::{Path, PathBuf};

use kimberlite::blockmap::source::{SourceOptions, read};
use kimberlite::blockmap::{Paint, Scene, Triangle};
use kimberlite::{Error, Result};
use tempfile::TempDir;

/// A folder with files in it.
struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    fn read(&self, name: &str, content: impl AsRef<[u8]>) -> Result<Scene> {
        read(&[self.write(name, content)], &SourceOptions::default())
    }
}

fn area(triangle: &Triangle) -> f64 {
    let [a, b, c] = triangle.corners.map(glam::DVec3::from_array);
    (b - a).cross(c - a).length() / 2.0
}

fn total_area(scene: &Scene) -> f64 {
    scene.triangles.iter().map(area).sum()
}

/// Whether a file is refused with a message that names it and has all of these parts.
#[track_caller]
fn assert_refused(result: Result<Scene>, parts: &[&str]) {
    let error = result.expect_err("it was read");
    assert!(
        matches!(error, Error::Input { .. } | Error::Io { .. }),
        "{error:?}"
    );
    let text = error.to_string();
    for part in parts {
        assert!(text.contains(part), "\"{part}\" is not in: {text}");
    }
    assert!(!text.contains('\n'), "{text}");
}

#[track_caller]
fn assert_warned(scene: &Scene, parts: &[&str]) {
    let matching = scene
        .warnings
        .iter()
        .filter(|line| parts.iter().all(|part| line.contains(part)));
    assert_eq!(matching.count(), 1, "{parts:?} in {:#?}", scene.warnings);
}

fn is_textured(triangle: &Triangle) -> bool {
    matches!(triangle.paint, Paint::Texture { .. })
}

/// A small PNG of red, green and blue.
fn png_image() -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().unwrap();
    writer
        .write_image_data(&[200, 0, 0, 0, 200, 0, 0, 0, 200, 9, 9, 9])
        .unwrap();
    writer.finish().unwrap();
    bytes
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name)
}

#[test]
fn several_files_become_one_scene() {
    let folder = Folder::new();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1 4/1\n";
    let [first, second] = ["first", "second"].map(|name| {
        folder.write(&format!("{name}.png"), png_image());
        folder.write(
            &format!("{name}.mtl"),
            format!("newmtl m\nmap_Kd {name}.png\n"),
        );
        folder.write(
            &format!("{name}.obj"),
            format!("mtllib {name}.mtl\n{square}"),
        )
    });
    let scene = read(&[first, second], &SourceOptions::default()).unwrap();
    assert_eq!(scene.warnings, [""; 0]);
    assert_eq!(scene.textures.len(), 2);
    let index = |triangle: &Triangle| match triangle.paint {
        Paint::Texture { index, .. } => index,
        _ => panic!("no texture"),
    };
    assert_eq!(
        scene.triangles.iter().map(index).collect::<Vec<_>>(),
        [0, 0, 1, 1]
    );
}

#[test]
fn files_of_two_reference_systems_are_refused() {
    let folder = Folder::new();
    let [first, second] = [7415, 28992].map(|code| {
        let mut city = city_json::wall();
        city["metadata"]["referenceSystem"] =
            format!("https://www.opengis.net/def/crs/EPSG/0/{code}").into();
        folder.write(&format!("{code}.city.json"), city.to_string())
    });
    let options = SourceOptions::default();
    assert_eq!(
        read(std::slice::from_ref(&first), &options).unwrap().crs,
        "EPSG:7415"
    );
    assert_refused(
        read(&[first, second], &options),
        &["28992.city.json", "EPSG:28992", "EPSG:7415"],
    );
}

#[test]
fn what_has_no_triangle_is_refused() {
    let folder = Folder::new();
    assert_refused(
        folder.read("empty.obj", "v 0 0 0\n"),
        &["empty.obj", "no triangle"],
    );
    assert_refused(
        folder.read("city.xyz", ""),
        &["city.xyz", "extension .xyz", "CityJSON"],
    );
    let missing = folder.0.path().join("missing.obj");
    assert_refused(
        read(&[missing], &SourceOptions::default()),
        &["missing.obj"],
    );
    assert!(matches!(
        read(&[], &SourceOptions::default()),
        Err(Error::Argument(_))
    ));
}

#[test]
fn more_triangles_than_allowed_are_refused() {
    let options = SourceOptions {
        max_triangles: 1000,
        ..SourceOptions::default()
    };
    let result = read(&[shipped("city/delft_lod1.city.json")], &options);
    assert_refused(result, &["more than 1000 triangles", "CityObjects."]);
}
