//! glTF 2.0, as text or binary, y up turned to z up.

mod parts;

use std::path::Path;

use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf::mesh::{Mode, Primitive};
use gltf::{Document, Gltf, Material, Node};
use serde_json::Value;

use super::bytes_of;
use super::collector::{Collector, Given};
use super::paint::Thing;
use super::polygon::Corner;
use crate::{Error, Result};
use parts::Parts;

/// Bytes before the first chunk of a binary file.
const BINARY_HEADER: usize = 12;

/// Adds a glTF file to the scene: the default one of its own scenes, else the first, else all nodes without parents.
pub(super) fn read(path: &Path, collector: &mut Collector) -> Result<()> {
    let bytes = bytes_of(path)?;
    let refuse = |text: String| Error::input(path, text);
    let (Gltf { document, blob }, root) = parse(&bytes).map_err(refuse)?;
    let parts = Parts::read(path, &document, blob).map_err(refuse)?;
    let mut stack: Vec<(usize, DMat4)> = roots(&document)
        .into_iter()
        .rev()
        .map(|node| (node, upright()))
        .collect();
    let mut is_placed = vec![false; document.nodes().len()];
    while let Some((number, parent)) = stack.pop() {
        let (Some(node), Some(placed)) = (document.nodes().nth(number), is_placed.get_mut(number))
        else {
            continue;
        };
        if std::mem::replace(placed, true) {
            return Err(refuse(format!("nodes[{number}] has several parents")));
        }
        let own = root.get("nodes").and_then(|nodes| nodes.get(number));
        let own = matrix(own.unwrap_or(&Value::Null))
            .map_err(|cause| refuse(format!("nodes[{number}]: {cause}")))?;
        let matrix = parent * own;
        add_mesh(&parts, &node, matrix, collector)?;
        let children: Vec<usize> = node.children().map(|child| child.index()).collect();
        stack.extend(children.iter().rev().map(|&child| (child, matrix)));
    }
    Ok(())
}

/// The document, and its text again: the document keeps single precision, which is too little for a place on the Earth.
fn parse(bytes: &[u8]) -> std::result::Result<(Gltf, Value), String> {
    let not_gltf = |error: gltf::Error| format!("not glTF: {error}");
    let root = if bytes.starts_with(b"glTF") {
        let length = bytes
            .get(8..BINARY_HEADER)
            .and_then(|length| length.try_into().ok());
        if length.map_or(0, u32::from_le_bytes) < BINARY_HEADER as u32 {
            return Err("its header is not complete".to_string());
        }
        serde_json::from_slice(&gltf::Glb::from_slice(bytes).map_err(not_gltf)?.json)
    } else {
        serde_json::from_slice(bytes)
    };
    let root: Value = root.map_err(|error| format!("not JSON: {error}"))?;
    check_positions(&root)?;
    let gltf = Gltf::from_slice(bytes).map_err(not_gltf)?;
    Ok((gltf, root))
}

/// Whether the positions of all primitives are there, which has to be known before the document is made.
fn check_positions(root: &Value) -> std::result::Result<(), String> {
    fn list<'v>(value: &'v Value, name: &str) -> &'v [Value] {
        let list = value.get(name).and_then(Value::as_array);
        list.map_or(&[], Vec::as_slice)
    }
    let count = list(root, "accessors").len() as u64;
    for (mesh, value) in list(root, "meshes").iter().enumerate() {
        for (primitive, value) in list(value, "primitives").iter().enumerate() {
            let attributes = value.get("attributes");
            let number = attributes.and_then(|all| all.get("POSITION")?.as_u64());
            if let Some(number) = number.filter(|&number| number >= count) {
                let place = format!("meshes[{mesh}].primitives[{primitive}]");
                return Err(format!(
                    "{place}: accessor {number} is missing: there are {count}"
                ));
            }
        }
    }
    Ok(())
}

fn add_mesh(parts: &Parts, node: &Node, matrix: DMat4, collector: &mut Collector) -> Result<()> {
    let Some(mesh) = node.mesh() else {
        return Ok(());
    };
    let name = node
        .name()
        .or(mesh.name())
        .map_or_else(|| format!("node {}", node.index()), str::to_string);
    collector.begin_object(Thing::Building, &name);
    for primitive in mesh.primitives() {
        let place = format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
        add_primitive(parts, &primitive, matrix, &place, collector)?;
    }
    Ok(())
}

/// From x east, y up, z south to x east, y north, z up.
fn upright() -> DMat4 {
    DMat4::from_cols(DVec4::X, DVec4::Z, -DVec4::Y, DVec4::W)
}

fn roots(document: &Document) -> Vec<usize> {
    if let Some(scene) = document
        .default_scene()
        .or_else(|| document.scenes().next())
    {
        return scene.nodes().map(|node| node.index()).collect();
    }
    let mut is_root = vec![true; document.nodes().len()];
    for child in document.nodes().flat_map(|node| node.children()) {
        if let Some(is_root) = is_root.get_mut(child.index()) {
            *is_root = false;
        }
    }
    (0..is_root.len()).filter(|&node| is_root[node]).collect()
}

/// Of a node relative to its parent.
fn matrix(node: &Value) -> std::result::Result<DMat4, String> {
    fn numbers<const COUNT: usize>(
        node: &Value,
        name: &str,
        default: [f64; COUNT],
    ) -> std::result::Result<[f64; COUNT], String> {
        let Some(value) = node.get(name) else {
            return Ok(default);
        };
        let list = value.as_array().map_or(&[] as &[Value], Vec::as_slice);
        let numbers: Vec<f64> = list.iter().filter_map(Value::as_f64).collect();
        numbers
            .try_into()
            .map_err(|_| format!("{name}: {COUNT} numbers are needed"))
    }
    if node.get("matrix").is_some() {
        return Ok(DMat4::from_cols_array(&numbers(node, "matrix", [0.0; 16])?));
    }
    let rotation = DQuat::from_array(numbers(node, "rotation", [0.0, 0.0, 0.0, 1.0])?);
    if rotation.length_squared() <= 0.0 {
        return Err("rotation: a unit quaternion is needed".to_string());
    }
    Ok(DMat4::from_scale_rotation_translation(
        DVec3::from_array(numbers(node, "scale", [1.0; 3])?),
        rotation.normalize(),
        DVec3::from_array(numbers(node, "translation", [0.0; 3])?),
    ))
}

fn add_primitive(
    parts: &Parts,
    primitive: &Primitive,
    matrix: DMat4,
    place: &str,
    collector: &mut Collector,
) -> Result<()> {
    let refuse = |cause: String| Error::input(parts.path, format!("{place}: {cause}"));
    if !matches!(
        primitive.mode(),
        Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan
    ) {
        collector.count("points and lines were left out", || place.to_string());
        return Ok(());
    }
    let positions = parts.positions(primitive).map_err(refuse)?;
    let order = match parts.indices(primitive).map_err(refuse)? {
        Some(indices) => indices,
        None => (0..positions.len()).collect(),
    };
    let (given, coordinates) = appearance(parts, primitive, place, collector).map_err(refuse)?;
    let corner = |vertex: usize| {
        let position = positions.get(vertex).ok_or_else(|| {
            refuse(format!(
                "vertex {vertex} is missing: there are {}",
                positions.len()
            ))
        })?;
        let at = matrix.transform_point3(*position);
        if !at.is_finite() {
            return Err(refuse(format!("vertex {vertex} is not finite")));
        }
        let texture = coordinates.get(vertex).copied().unwrap_or([0.0; 2]);
        Ok(Corner { at, texture })
    };
    for (number, triangle) in triples(primitive.mode(), &order).enumerate() {
        let ring = triangle
            .iter()
            .map(|&vertex| corner(vertex))
            .collect::<Result<Vec<_>>>()?;
        collector.surface(&[ring], &given, || format!("{place}, triangle {number}"))?;
    }
    Ok(())
}

/// The paint of a primitive, and the texture coordinates of its vertices where it has a texture.
fn appearance(
    parts: &Parts,
    primitive: &Primitive,
    place: &str,
    collector: &mut Collector,
) -> std::result::Result<(Given, Vec<[f32; 2]>), String> {
    let material = primitive.material();
    let mut given = Given {
        colour: colour(&material),
        ..Given::default()
    };
    let mut coordinates = Vec::new();
    if let Some(texture) = material.pbr_metallic_roughness().base_color_texture() {
        let found = parts.texture_coordinates(primitive, &texture)?;
        match found {
            Some(found) => {
                coordinates = found;
                given.texture = parts.texture(&texture, collector);
                if given.texture.is_some() && given.colour.is_some() {
                    collector.count(
                        "the colour of a material with a texture was left out",
                        || place.to_string(),
                    );
                }
            }
            None => collector.count("a texture without coordinates was left out", || {
                place.to_string()
            }),
        }
    }
    Ok((given, coordinates))
}

/// The base colour as an image would store it; white, the default, is none.
fn colour(material: &Material) -> Option<[u8; 3]> {
    let [red, green, blue, _] = material.pbr_metallic_roughness().base_color_factor();
    let encode = |linear: f32| {
        let linear = f64::from(linear).clamp(0.0, 1.0);
        let encoded = match linear <= 0.003_130_8 {
            true => 12.92 * linear,
            false => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
        };
        (255.0 * encoded).round() as u8
    };
    let is_given = material.index().is_some() && [red, green, blue] != [1.0; 3];
    is_given.then(|| [red, green, blue].map(encode))
}

/// Triangles, all turned the same way.
fn triples(mode: Mode, order: &[usize]) -> impl Iterator<Item = [usize; 3]> + '_ {
    let count = match mode {
        Mode::Triangles => order.len() / 3,
        _ => order.len().saturating_sub(2),
    };
    (0..count).map(move |number| {
        let places = match mode {
            Mode::Triangles => [3 * number, 3 * number + 1, 3 * number + 2],
            Mode::TriangleFan => [0, number + 1, number + 2],
            _ if number % 2 == 1 => [number + 1, number, number + 2],
            _ => [number, number + 1, number + 2],
        };
        places.map(|place| order[place])
    })
}
