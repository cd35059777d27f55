//! Files of cities.

mod city_json;
mod collector;
mod gltf;
mod image;
mod obj;
mod paint;
mod polygon;
mod procedural;
mod walls;

use std::fs;
use std::path::{Path, PathBuf};

use super::Scene;
use crate::{Error, Result};
use collector::Collector;

pub use procedural::{ProceduralCity, generate};

const SUPPORTED: &str = "CityJSON (.json, .city.json), CityJSON text sequences (.jsonl), OBJ (.obj), glTF (.gltf, .glb)";

/// How files of cities are read.
#[derive(Clone, Debug)]
pub struct SourceOptions {
    /// With a seed, buildings without textures and colours get procedural facades and roofs that depend on it; without
    /// one they are plain.
    pub facades: Option<u32>,
    /// More triangles than this are an error.
    pub max_triangles: usize,
    /// Bytes of all textures' pixels, three each: an image beyond them is left out with a warning.
    pub max_texture_bytes: usize,
}

impl Default for SourceOptions {
    /// Facades of seed 0, at most 50 million triangles and 4 GiB of textures.
    fn default() -> SourceOptions {
        SourceOptions {
            facades: Some(0),
            max_triangles: 50_000_000,
            max_texture_bytes: usize::try_from(4_u64 << 30).unwrap_or(usize::MAX),
        }
    }
}

/// Reads files of cities into one scene; the extension decides on the format. Coordinates are metres, z up; those of
/// glTF, y up, are turned.
///
/// # Errors
///
/// [`Error::Io`] where a file cannot be opened; [`Error::Input`] where it is not what its extension says, with the place
/// in it, where two files are of different reference systems, and where there is no triangle in all of them;
/// [`Error::Argument`] where `paths` is empty. What can be left out, such as an image, is a warning of the scene.
pub fn read(paths: &[PathBuf], options: &SourceOptions) -> Result<Scene> {
    let Some(first) = paths.first() else {
        return Err(Error::Argument("no file of a city is given".to_string()));
    };
    let mut collector = Collector::new(options);
    for path in paths {
        collector.open(path);
        read_one(path, &mut collector)?;
        collector.close();
    }
    let scene = collector.into_scene();
    if scene.triangles.is_empty() {
        let others = match paths.len() {
            1 => String::new(),
            count => format!(" nor in the {} other files", count - 1),
        };
        return Err(Error::input(first, format!("no triangle in it{others}")));
    }
    Ok(scene)
}

fn read_one(path: &Path, collector: &mut Collector) -> Result<()> {
    let extension = path
        .extension()
        .map(|text| text.to_string_lossy().to_ascii_lowercase())
        .unwrap_or_default();
    match extension.as_str() {
        "json" => city_json::read(path, collector),
        "jsonl" => city_json::read_sequence(path, collector),
        "obj" => obj::read(path, collector),
        "gltf" | "glb" => gltf::read(path, collector),
        "" => Err(Error::input(
            path,
            format!("no file extension; supported: {SUPPORTED}"),
        )),
        other => Err(Error::input(
            path,
            format!("extension .{other} is unknown; supported: {SUPPORTED}"),
        )),
    }
}

/// The whole file.
fn bytes_of(path: &Path) -> Result<Vec<u8>> {
    fs::read(path).map_err(Error::io(path, "cannot read"))
}

/// The bytes of a file that another one refers to, or why there are none.
fn bytes_beside(path: &Path, most: usize) -> std::result::Result<Vec<u8>, String> {
    let about = fs::metadata(path).map_err(|error| error.to_string())?;
    if !about.is_file() {
        return Err("not a file".to_string());
    }
    if about.len() > most as u64 {
        return Err(format!("{} bytes; {most} are allowed", about.len()));
    }
    fs::read(path).map_err(|error| error.to_string())
}

/// A file named in `file`, which may use the path separators of another system.
fn beside(file: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    file.parent()
        .map_or_else(|| PathBuf::from(&name), |folder| folder.join(&name))
}
