//! The triangles of a city's files as nothing but numbers: nine doubles a triangle.
//!
//!     triangles OUT IN...

use kimberlite::blockmap::source::{SourceOptions, read};
use kimberlite::{Error, Result};
use std::path::PathBuf;

fn main() -> Result<()> {
    let mut words = std::env::args_os().skip(1).map(PathBuf::from);
    let output = words.next().ok_or_else(|| Error::Argument("triangles OUT IN...".to_owned()))?;
    let scene = read(&words.collect::<Vec<_>>(), &SourceOptions::default())?;
    let corners = scene.triangles.iter().flat_map(|triangle| triangle.corners);
    let bytes: Vec<u8> = corners.flatten().flat_map(f64::to_le_bytes).collect();
    std::fs::write(&output, bytes).map_err(Error::io(&output, "cannot write"))
}
