//! The surfaces of one geometry.

use glam::{DMat4, DVec3};
use serde_json::Value;

use super::appearance::Appearance;
use super::{Part, index, short};
use crate::Result;
use crate::blockmap::source::collector::{Collector, Given};
use crate::blockmap::source::paint::Side;
use crate::blockmap::source::polygon::Corner;

/// Numbers of kinds of geometry that have no surfaces.
const WITHOUT_SURFACES: [&str; 2] = ["MultiPoint", "MultiLineString"];

/// What indices in boundaries refer to.
#[derive(Clone, Copy)]
pub(super) struct Vertices<'a> {
    pub list: &'a [DVec3],
    /// A template is turned by the matrix, then moved to the place.
    pub placed: Option<(DMat4, DVec3)>,
}

/// A geometry with surfaces.
pub(super) struct Geometry<'a, 'v> {
    part: &'a Part<'v>,
    appearance: &'a Appearance<'v>,
    vertices: Vertices<'a>,
    place: String,
    /// Level of detail.
    pub detail: f64,
    boundaries: &'v Value,
    /// Arrays around a surface.
    depth: usize,
    surface_kinds: &'v [Value],
    attached: Attached<'v>,
    /// The material of all surfaces.
    material: Option<&'v Value>,
}

/// What goes along with boundaries, level by level.
#[derive(Clone, Copy, Default)]
pub(super) struct Attached<'v> {
    semantics: Option<&'v Value>,
    material: Option<&'v Value>,
    texture: Option<&'v Value>,
}

impl<'v> Attached<'v> {
    fn child(self, number: usize) -> Attached<'v> {
        let child = |value: Option<&'v Value>| value.and_then(|value| value.get(number));
        Attached {
            semantics: child(self.semantics),
            material: child(self.material),
            texture: child(self.texture),
        }
    }
}

impl<'a> Vertices<'a> {
    pub(super) fn of(list: &'a [DVec3]) -> Vertices<'a> {
        Vertices { list, placed: None }
    }

    fn at(&self, number: usize) -> DVec3 {
        match self.placed {
            None => self.list[number],
            Some((matrix, place)) => matrix.transform_point3(self.list[number]) + place,
        }
    }
}

/// 16 numbers, row by row; the identity where there is none.
pub(super) fn matrix(value: Option<&Value>) -> Option<DMat4> {
    let Some(value) = value else {
        return Some(DMat4::IDENTITY);
    };
    let numbers: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
    let numbers: [f64; 16] = numbers.try_into().ok()?;
    let matrix = DMat4::from_cols_array(&numbers).transpose();
    matrix.is_finite().then_some(matrix)
}

/// The first theme by name, and what it says.
fn theme(value: Option<&Value>) -> Option<&Value> {
    let themes = value?.as_object()?.iter();
    themes.min_by(|a, b| a.0.cmp(b.0)).map(|(_, theme)| theme)
}

fn detail(value: Option<&Value>) -> Option<f64> {
    match value {
        None => Some(0.0),
        Some(Value::String(text)) => text.parse().ok().filter(|number: &f64| number.is_finite()),
        Some(other) => other.as_f64(),
    }
}

impl<'a, 'v> Geometry<'a, 'v> {
    /// `None` for one without surfaces.
    pub(super) fn read(
        part: &'a Part<'v>,
        value: &'v Value,
        vertices: Vertices<'a>,
        appearance: &'a Appearance<'v>,
        place: String,
    ) -> Result<Option<Geometry<'a, 'v>>> {
        let refuse = |text: String| part.refuse(&format!("{place}{text}"));
        let kind = value.get("type").and_then(Value::as_str).unwrap_or("");
        let depth = match kind {
            "MultiSurface" | "CompositeSurface" => 0,
            "Solid" => 1,
            "MultiSolid" | "CompositeSolid" => 2,
            kind if WITHOUT_SURFACES.contains(&kind) => return Ok(None),
            other => return Err(refuse(format!(".type: \"{other}\" is not known"))),
        };
        let detail = detail(value.get("lod"))
            .ok_or_else(|| refuse(".lod: a number is needed".to_string()))?;
        let boundaries = value.get("boundaries").unwrap_or(&Value::Null);
        let list = boundaries
            .as_array()
            .ok_or_else(|| refuse(".boundaries: an array is needed".to_string()))?;
        if list.is_empty() {
            return Ok(None);
        }
        let semantics = value.get("semantics");
        let kinds = semantics
            .and_then(|all| all.get("surfaces"))
            .and_then(Value::as_array);
        let material = theme(value.get("material"));
        let texture = theme(value.get("texture"));
        Ok(Some(Geometry {
            part,
            appearance,
            vertices,
            detail,
            boundaries,
            depth,
            surface_kinds: kinds.map_or(&[], Vec::as_slice),
            attached: Attached {
                semantics: semantics.and_then(|all| all.get("values")),
                material: material.and_then(|theme| theme.get("values")),
                texture: texture.and_then(|theme| theme.get("values")),
            },
            material: material.and_then(|theme| theme.get("value")),
            place,
        }))
    }

    /// Adds its surfaces to the scene.
    pub(super) fn add(&self, collector: &mut Collector) -> Result<()> {
        self.walk(
            self.boundaries,
            self.depth,
            self.attached,
            &mut Vec::new(),
            collector,
        )
    }

    fn walk(
        &self,
        boundaries: &'v Value,
        depth: usize,
        attached: Attached<'v>,
        place: &mut Vec<usize>,
        collector: &mut Collector,
    ) -> Result<()> {
        let list = boundaries.as_array().ok_or_else(|| {
            self.refuse(
                place,
                &format!("an array is needed, not {}", short(boundaries)),
            )
        })?;
        for (number, value) in list.iter().enumerate() {
            place.push(number);
            let attached = attached.child(number);
            match depth {
                0 => self.add_surface(value, attached, place, collector)?,
                _ => self.walk(value, depth - 1, attached, place, collector)?,
            }
            place.pop();
        }
        Ok(())
    }

    /// The name of a place in the boundaries.
    fn name(&self, place: &[usize]) -> String {
        let numbers: String = place.iter().map(|number| format!("[{number}]")).collect();
        format!("{}.boundaries{numbers}", self.place)
    }

    fn refuse(&self, place: &[usize], text: &str) -> crate::Error {
        self.part.refuse(&format!("{}: {text}", self.name(place)))
    }

    fn add_surface(
        &self,
        surface: &'v Value,
        attached: Attached<'v>,
        place: &[usize],
        collector: &mut Collector,
    ) -> Result<()> {
        let refuse = |text: String| self.refuse(place, &text);
        let mut rings = self.rings(surface, place)?;
        let mut given = Given {
            side: self.side(attached.semantics).map_err(refuse)?,
            ..Given::default()
        };
        if let Some(texture) = attached.texture.and_then(Value::as_array) {
            match self.appearance.lay(texture, &mut rings).map_err(refuse)? {
                Some(image) => {
                    let image = self.appearance.image(image).map_err(refuse)?;
                    given.texture = self.part.texture(image, collector);
                }
                None if texture.iter().any(|ring| ring.get(1).is_some()) => {
                    collector.count(
                        "texture coordinates that do not match a surface were left out",
                        || self.name(place),
                    );
                }
                None => {}
            }
        }
        if let Some(material) = self
            .material
            .or(attached.material)
            .filter(|value| !value.is_null())
        {
            given.colour = self.appearance.colour(material).map_err(refuse)?;
        }
        collector.surface(&rings, &given, || {
            format!("{}{}", self.part.prefix, self.name(place))
        })
    }

    fn rings(&self, surface: &Value, place: &[usize]) -> Result<Vec<Vec<Corner>>> {
        let wanted = || {
            self.refuse(
                place,
                &format!("a surface is an array of arrays, not {}", short(surface)),
            )
        };
        let mut rings = Vec::new();
        for (number, ring) in surface.as_array().ok_or_else(wanted)?.iter().enumerate() {
            let mut corners = Vec::new();
            for vertex in ring.as_array().ok_or_else(wanted)? {
                let vertex = index(vertex, self.vertices.list.len(), "vertex")
                    .map_err(|text| self.refuse(&[place, &[number]].concat(), &text))?;
                let at = self.vertices.at(vertex);
                corners.push(Corner {
                    at,
                    texture: [0.0; 2],
                });
            }
            rings.push(corners);
        }
        Ok(rings)
    }

    fn side(&self, semantics: Option<&Value>) -> std::result::Result<Option<Side>, String> {
        let Some(value) = semantics.filter(|value| !value.is_null()) else {
            return Ok(None);
        };
        let number = index(value, self.surface_kinds.len(), "surface of the semantics")?;
        let kind = self.surface_kinds[number]
            .get("type")
            .and_then(Value::as_str);
        Ok(match kind {
            Some("RoofSurface" | "OuterFloorSurface") => Some(Side::Roof),
            Some("WallSurface") => Some(Side::Wall),
            Some("GroundSurface" | "OuterCeilingSurface") => Some(Side::Floor),
            _ => None,
        })
    }
}
