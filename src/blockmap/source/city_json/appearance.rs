//! Textures and materials of CityJSON.

use serde_json::Value;

use super::{Part, index, short};
use crate::blockmap::source::collector::Collector;
use crate::blockmap::source::polygon::Corner;
use crate::blockmap::source::{beside, bytes_beside};

/// The member `appearance`; empty where there is none.
#[derive(Default)]
pub(super) struct Appearance<'v> {
    textures: &'v [Value],
    materials: &'v [Value],
    /// Texture coordinates.
    vertices: Vec<[f32; 2]>,
}

impl<'v> Appearance<'v> {
    pub(super) fn read(root: &'v Value) -> Result<Appearance<'v>, String> {
        let Some(appearance) = root.get("appearance") else {
            return Ok(Appearance::default());
        };
        let list = |name: &str| match appearance.get(name) {
            None => Ok(&[] as &[Value]),
            Some(list) => list
                .as_array()
                .map(Vec::as_slice)
                .ok_or_else(|| format!("appearance.{name}: an array is needed")),
        };
        let vertex = |(number, value): (usize, &Value)| {
            let numbers = [0, 1].map(|axis| value.get(axis).and_then(Value::as_f64));
            let [Some(u), Some(v)] = numbers else {
                let text = short(value);
                return Err(format!(
                    "appearance.vertices-texture[{number}]: two numbers are needed, not {text}"
                ));
            };
            Ok([u as f32, v as f32])
        };
        Ok(Appearance {
            textures: list("textures")?,
            materials: list("materials")?,
            vertices: list("vertices-texture")?
                .iter()
                .enumerate()
                .map(vertex)
                .collect::<Result<_, _>>()?,
        })
    }

    /// Gives the corners their texture coordinates, and tells which texture they are of; `None` without one, or where it
    /// does not match the rings.
    pub(super) fn lay(
        &self,
        texture: &[Value],
        rings: &mut [Vec<Corner>],
    ) -> Result<Option<usize>, String> {
        let Some(number) = texture
            .first()
            .and_then(|ring| ring.get(0))
            .filter(|value| !value.is_null())
        else {
            return Ok(None);
        };
        let image = index(number, self.textures.len(), "texture")?;
        if texture.len() != rings.len() {
            return Ok(None);
        }
        for (ring, corners) in texture.iter().zip(rings) {
            let ring = ring.as_array().map_or(&[] as &[Value], Vec::as_slice);
            if ring.len() != corners.len() + 1 {
                return Ok(None);
            }
            for (value, corner) in ring.iter().skip(1).zip(corners) {
                corner.texture =
                    self.vertices[index(value, self.vertices.len(), "texture vertex")?];
            }
        }
        Ok(Some(image))
    }

    /// The file of a texture.
    pub(super) fn image(&self, number: usize) -> Result<&'v str, String> {
        let name = self
            .textures
            .get(number)
            .and_then(|texture| texture.get("image"));
        name.and_then(Value::as_str)
            .ok_or_else(|| format!("appearance.textures[{number}].image: a text is needed"))
    }

    /// The diffuse colour of a material, if it has one.
    pub(super) fn colour(&self, material: &Value) -> Result<Option<[u8; 3]>, String> {
        let number = index(material, self.materials.len(), "material")?;
        let Some(colour) = self.materials[number].get("diffuseColor") else {
            return Ok(None);
        };
        let bands = [0, 1, 2].map(|band| colour.get(band).and_then(Value::as_f64));
        let [Some(red), Some(green), Some(blue)] = bands else {
            return Err(format!(
                "appearance.materials[{number}].diffuseColor: three numbers are needed"
            ));
        };
        Ok(Some([red, green, blue].map(|band| {
            (255.0 * band).round().clamp(0.0, 255.0) as u8
        })))
    }
}

impl Part<'_> {
    /// The texture of an image beside the file.
    pub(super) fn texture(&self, name: &str, collector: &mut Collector) -> Option<u32> {
        let path = beside(self.path, name);
        let most = collector.most_image_bytes();
        collector.texture(&path.display().to_string(), || bytes_beside(&path, most))
    }
}
