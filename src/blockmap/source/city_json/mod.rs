//! CityJSON 1.0, 1.1 and 2.0, as one document or as a text sequence.

mod appearance;
mod geometry;

use std::path::Path;

use glam::DVec3;
use serde_json::Value;

use super::bytes_of;
use super::collector::Collector;
use super::paint::Thing;
use crate::{Error, Result};
use appearance::Appearance;
use geometry::{Geometry, Vertices};

/// What the parts of a file have in common.
struct Header<'v> {
    /// Of the integers that vertices are stored as.
    scale: DVec3,
    translate: DVec3,
    /// Geometries that are placed more than once.
    templates: &'v [Value],
    template_vertices: Vec<DVec3>,
    appearance: Appearance<'v>,
}

/// A document, or a feature of a sequence.
struct Part<'v> {
    path: &'v Path,
    header: &'v Header<'v>,
    vertices: Vec<DVec3>,
    appearance: Appearance<'v>,
    /// What comes before `CityObjects` in the name of a place.
    prefix: String,
}

/// Adds a document to the scene.
pub(super) fn read(path: &Path, collector: &mut Collector) -> Result<()> {
    let root: Value = serde_json::from_slice(&bytes_of(path)?)
        .map_err(|error| Error::input(path, format!("not JSON: {error}")))?;
    let header = Header::read(path, &root, "", collector)?;
    Part::read(path, &header, &root, String::new())?.add_objects(&root, collector)
}

/// Adds a sequence: a document in the first line, a feature in each of the others.
pub(super) fn read_sequence(path: &Path, collector: &mut Collector) -> Result<()> {
    let bytes = bytes_of(path)?;
    let mut lines = bytes
        .split(|&byte| byte == b'\n')
        .enumerate()
        .filter(|(_, line)| !line.trim_ascii().is_empty());
    let parse = |number: usize, line: &[u8]| {
        serde_json::from_slice::<Value>(line).map_err(|error| {
            let column = error.column();
            let text = format!("line {}, column {column}: not JSON: {error}", number + 1);
            Error::input(path, text)
        })
    };
    let Some((number, line)) = lines.next() else {
        return Err(Error::input(path, "an empty file"));
    };
    let root = parse(number, line)?;
    let header = Header::read(path, &root, "line 1: ", collector)?;
    for (number, line) in lines {
        let feature = parse(number, line)?;
        let prefix = format!("line {}: ", number + 1);
        Part::read(path, &header, &feature, prefix)?.add_objects(&feature, collector)?;
    }
    Ok(())
}

impl<'v> Header<'v> {
    fn read(
        path: &Path,
        root: &'v Value,
        prefix: &str,
        collector: &mut Collector,
    ) -> Result<Header<'v>> {
        let refuse = |text: String| Error::input(path, format!("{prefix}{text}"));
        if root.get("type").and_then(Value::as_str) != Some("CityJSON") {
            return Err(refuse(
                "not CityJSON: its \"type\" is another one".to_string(),
            ));
        }
        let version = root
            .get("version")
            .and_then(Value::as_str)
            .unwrap_or("none");
        if !["1.0", "1.1", "2.0"]
            .iter()
            .any(|known| version.starts_with(known))
        {
            return Err(refuse(format!(
                "version {version} of CityJSON; 1.0, 1.1 and 2.0 are read"
            )));
        }
        let transform = |name: &str, default: f64| match root.get("transform") {
            None => Ok(DVec3::splat(default)),
            Some(transform) => point(transform.get(name).unwrap_or(&Value::Null))
                .ok_or_else(|| refuse(format!("transform.{name}: three numbers are needed"))),
        };
        let (scale, translate) = (transform("scale", 1.0)?, transform("translate", 0.0)?);
        set_crs(root, collector)?;
        let templates = root.get("geometry-templates");
        let list = templates
            .and_then(|all| all.get("templates"))
            .and_then(Value::as_array);
        let template_vertices = match templates.and_then(|all| all.get("vertices-templates")) {
            None => Vec::new(),
            Some(list) => points(list, "geometry-templates.vertices-templates").map_err(refuse)?,
        };
        Ok(Header {
            scale,
            translate,
            templates: list.map_or(&[], Vec::as_slice),
            template_vertices,
            appearance: Appearance::read(root).map_err(refuse)?,
        })
    }
}

/// From `https://www.opengis.net/def/crs/EPSG/0/7415` and its like.
fn set_crs(root: &Value, collector: &mut Collector) -> Result<()> {
    let metadata = root.get("metadata");
    let Some(system) = metadata
        .and_then(|data| data.get("referenceSystem"))
        .and_then(Value::as_str)
    else {
        return Ok(());
    };
    let code = system
        .rsplit(['/', ':'])
        .next()
        .filter(|code| !code.is_empty() && code.bytes().all(|byte| byte.is_ascii_digit()));
    match code {
        Some(code) if system.to_ascii_uppercase().contains("EPSG") => {
            collector.set_crs(&format!("EPSG:{code}"))
        }
        _ => {
            collector.warn(&format!(
                "metadata.referenceSystem {system} is not one of EPSG and is left out"
            ));
            Ok(())
        }
    }
}

/// Three finite numbers.
fn point(value: &Value) -> Option<DVec3> {
    let [x, y, z] = value.as_array()?.as_slice() else {
        return None;
    };
    let point = DVec3::new(x.as_f64()?, y.as_f64()?, z.as_f64()?);
    point.is_finite().then_some(point)
}

fn points(list: &Value, place: &str) -> std::result::Result<Vec<DVec3>, String> {
    let list = list
        .as_array()
        .ok_or_else(|| format!("{place}: an array is needed"))?;
    let read = |(number, value): (usize, &Value)| {
        point(value).ok_or_else(|| {
            format!(
                "{place}[{number}]: three numbers are needed, not {}",
                short(value)
            )
        })
    };
    list.iter().enumerate().map(read).collect()
}

/// A value as it is written, or its beginning.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// An index below `count`.
fn index(value: &Value, count: usize, what: &str) -> std::result::Result<usize, String> {
    let number = value
        .as_u64()
        .ok_or_else(|| format!("{} is no index of {what}", short(value)))?;
    usize::try_from(number)
        .ok()
        .filter(|&number| number < count)
        .ok_or_else(|| format!("{what} {number} is missing: there are {count}"))
}

impl<'v> Part<'v> {
    fn read(
        path: &'v Path,
        header: &'v Header<'v>,
        root: &'v Value,
        prefix: String,
    ) -> Result<Part<'v>> {
        let refuse = |text: String| Error::input(path, format!("{prefix}{text}"));
        let mut vertices =
            points(root.get("vertices").unwrap_or(&Value::Null), "vertices").map_err(refuse)?;
        for vertex in &mut vertices {
            *vertex = *vertex * header.scale + header.translate;
        }
        if let Some(number) = vertices.iter().position(|vertex| !vertex.is_finite()) {
            return Err(refuse(format!(
                "vertices[{number}]: not finite after the transform"
            )));
        }
        Ok(Part {
            path,
            header,
            vertices,
            appearance: Appearance::read(root).map_err(refuse)?,
            prefix,
        })
    }

    fn refuse(&self, text: &str) -> Error {
        Error::input(self.path, format!("{}{text}", self.prefix))
    }

    fn add_objects(&self, root: &'v Value, collector: &mut Collector) -> Result<()> {
        let objects = root
            .get("CityObjects")
            .and_then(Value::as_object)
            .ok_or_else(|| self.refuse("CityObjects: an object is needed"))?;
        for (name, object) in objects {
            self.add_object(name, object, collector)?;
        }
        Ok(())
    }

    fn add_object(&self, name: &str, object: &'v Value, collector: &mut Collector) -> Result<()> {
        let kind = object
            .get("type")
            .and_then(Value::as_str)
            .ok_or_else(|| self.refuse(&format!("CityObjects.{name}.type: a text is needed")))?;
        let geometries = match object.get("geometry") {
            None | Some(Value::Null) => return Ok(()),
            Some(list) => list.as_array().ok_or_else(|| {
                self.refuse(&format!("CityObjects.{name}.geometry: an array is needed"))
            })?,
        };
        // The parts of a building look alike.
        let parent = object.get("parents").and_then(|parents| parents.get(0));
        let family = parent.and_then(Value::as_str).unwrap_or(name);
        collector.begin_object(Thing::of_type(kind), family);
        let mut solid = Vec::new();
        for (number, geometry) in geometries.iter().enumerate() {
            let place = format!("CityObjects.{name}.geometry[{number}]");
            solid.extend(self.geometry(geometry, place)?);
        }
        let finest = solid
            .iter()
            .map(|geometry| geometry.detail)
            .fold(f64::NEG_INFINITY, f64::max);
        for geometry in solid.iter().filter(|geometry| geometry.detail == finest) {
            geometry.add(collector)?;
        }
        Ok(())
    }

    /// `None` for one without surfaces.
    fn geometry(&self, geometry: &'v Value, place: String) -> Result<Option<Geometry<'_, 'v>>> {
        if geometry.get("type").and_then(Value::as_str) != Some("GeometryInstance") {
            let vertices = Vertices::of(&self.vertices);
            return Geometry::read(self, geometry, vertices, &self.appearance, place);
        }
        let told = |text: String| self.refuse(&format!("{place}: {text}"));
        let templates = self.header.templates;
        let template = geometry.get("template").unwrap_or(&Value::Null);
        let template = index(template, templates.len(), "template").map_err(told)?;
        let anchor = geometry.get("boundaries").and_then(|list| list.get(0));
        let anchor = index(
            anchor.unwrap_or(&Value::Null),
            self.vertices.len(),
            "vertex",
        )
        .map_err(told)?;
        let matrix = geometry::matrix(geometry.get("transformationMatrix")).ok_or_else(|| {
            told("transformationMatrix: 16 finite numbers are needed".to_string())
        })?;
        let vertices = Vertices {
            list: &self.header.template_vertices,
            placed: Some((matrix, self.vertices[anchor])),
        };
        let place = format!("{place} (template {template})");
        Geometry::read(
            self,
            &templates[template],
            vertices,
            &self.header.appearance,
            place,
        )
    }
}
