//! Wavefront OBJ, with materials. Coordinates are taken as they lie, z up, in double precision.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;

use super::collector::{Collector, Given};
use super::paint::Thing;
use super::polygon::Corner;
use super::{beside, bytes_beside, bytes_of};
use crate::{Error, Result};

/// What is known so far of a file.
struct Reader<'a, 'c> {
    path: &'a Path,
    collector: &'a mut Collector<'c>,
    vertices: Vec<DVec3>,
    texture_vertices: Vec<[f32; 2]>,
    materials: BTreeMap<String, Given>,
    /// Of the faces that follow.
    given: Given,
}

/// Adds an OBJ file to the scene.
pub(super) fn read(path: &Path, collector: &mut Collector) -> Result<()> {
    let bytes = bytes_of(path)?;
    collector.begin_object(Thing::Building, "");
    let mut reader = Reader {
        path,
        collector,
        vertices: Vec::new(),
        texture_vertices: Vec::new(),
        materials: BTreeMap::new(),
        given: Given::default(),
    };
    for (number, line) in lines(&bytes) {
        reader.line(&line, number)?;
    }
    Ok(())
}

/// Lines with their numbers, from 1, without comments; one that ends in a backslash goes on in the next.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, String)> + '_ {
    let mut lines = bytes.split(|&byte| byte == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (number, first) = lines.next()?;
        let text = |line: &[u8]| String::from_utf8_lossy(line).trim().to_string();
        let mut whole = text(first);
        while whole.ends_with('\\') {
            whole.pop();
            let Some((_, next)) = lines.next() else { break };
            whole.push(' ');
            whole.push_str(&text(next));
        }
        let content = whole.split('#').next().unwrap_or("").trim();
        // A file name may have the sign of a comment.
        let keeps_sign =
            whole.starts_with("mtllib") || whole.starts_with("map_") || whole.starts_with("usemtl");
        Some((
            number + 1,
            if keeps_sign {
                whole
            } else {
                content.to_string()
            },
        ))
    })
}

/// The first word and the rest.
fn parted(line: &str) -> (&str, &str) {
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    (word, rest.trim())
}

/// The first so many words as finite numbers.
fn numbers<const COUNT: usize>(text: &str) -> std::result::Result<[f64; COUNT], String> {
    let mut numbers = [0.0; COUNT];
    let mut words = text.split_whitespace();
    for number in &mut numbers {
        let word = words
            .next()
            .ok_or_else(|| format!("{COUNT} numbers are needed"))?;
        *number = word
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .ok_or_else(|| format!("\"{word}\" is not a finite number"))?;
    }
    Ok(numbers)
}

impl Reader<'_, '_> {
    fn line(&mut self, line: &str, number: usize) -> Result<()> {
        let path = self.path;
        let told = |cause: String| Error::input(path, format!("line {number}: {cause}"));
        let (word, rest) = parted(line);
        match word {
            "v" => {
                let vertex = numbers(rest).map_err(told)?;
                self.vertices.push(DVec3::from_array(vertex));
            }
            "vt" => {
                let [u] = numbers::<1>(rest).map_err(told)?;
                let v = numbers::<2>(rest).map_or(0.0, |both| both[1]);
                self.texture_vertices.push([u as f32, v as f32]);
            }
            "f" => {
                let (ring, given) = self.face(rest).map_err(told)?;
                let place = || format!("line {number}");
                return self.collector.surface(&[ring], &given, place);
            }
            "o" | "g" => self.collector.begin_object(Thing::Building, rest),
            "mtllib" => self.library(rest),
            "usemtl" => self.given = self.material(rest),
            _ => {}
        }
        Ok(())
    }

    fn face(&self, text: &str) -> std::result::Result<(Vec<Corner>, Given), String> {
        let mut given = self.given;
        let mut ring = Vec::new();
        for word in text.split_whitespace() {
            let mut parts = word.split('/');
            let vertex = index(parts.next().unwrap_or(""), self.vertices.len(), "vertex")?;
            let texture = match parts.next() {
                None | Some("") => None,
                Some(part) => Some(index(part, self.texture_vertices.len(), "texture vertex")?),
            };
            if texture.is_none() {
                given.texture = None;
            }
            ring.push(Corner {
                at: self.vertices[vertex],
                texture: texture.map_or([0.0; 2], |texture| self.texture_vertices[texture]),
            });
        }
        Ok((ring, given))
    }

    fn material(&mut self, name: &str) -> Given {
        if let Some(given) = self.materials.get(name) {
            return *given;
        }
        self.collector.warn(&format!("material {name} is missing"));
        self.materials.insert(name.to_string(), Given::default());
        Given::default()
    }

    /// Reads a file of materials; a name may have blanks.
    fn library(&mut self, name: &str) {
        let path = beside(self.path, name);
        let bytes = match bytes_beside(&path, usize::MAX) {
            Ok(bytes) => bytes,
            Err(cause) => {
                let text = format!("materials {} are left out: {cause}", path.display());
                return self.collector.warn(&text);
            }
        };
        let mut current = None;
        for (number, line) in lines(&bytes) {
            let (word, rest) = parted(&line);
            if word == "newmtl" {
                current = Some(rest.to_string());
                self.materials.insert(rest.to_string(), Given::default());
                continue;
            }
            let Some(name) = &current else { continue };
            let mut given = self.materials.get(name).copied().unwrap_or_default();
            match word {
                "Kd" => match numbers::<3>(rest) {
                    Ok(colour) => {
                        given.colour =
                            Some(colour.map(|band| (255.0 * band).round().clamp(0.0, 255.0) as u8))
                    }
                    Err(cause) => {
                        let text = format!(
                            "{}: line {number}: {cause}; the colour is left out",
                            path.display()
                        );
                        self.collector.warn(&text);
                    }
                },
                "map_Kd" => given.texture = self.texture(&path, rest),
                _ => continue,
            }
            self.materials.insert(name.clone(), given);
        }
    }

    fn texture(&mut self, library: &Path, text: &str) -> Option<u32> {
        // Options come before the name.
        let name = match text.starts_with('-') {
            true => text.split_whitespace().last().unwrap_or(""),
            false => text,
        };
        let path = beside(library, name);
        let most = self.collector.most_image_bytes();
        self.collector
            .texture(&path.display().to_string(), || bytes_beside(&path, most))
    }
}

/// An index from 1, or from the last one, -1, backwards.
fn index(word: &str, count: usize, what: &str) -> std::result::Result<usize, String> {
    let number: i64 = word
        .parse()
        .map_err(|_| format!("\"{word}\" is no index of a {what}"))?;
    let place = match number {
        1.. => usize::try_from(number - 1).ok(),
        _ => usize::try_from(number.unsigned_abs())
            .ok()
            .and_then(|back| count.checked_sub(back)),
    };
    place
        .filter(|&place| place < count)
        .ok_or_else(|| format!("{what} {number} is missing: there are {count}"))
}
