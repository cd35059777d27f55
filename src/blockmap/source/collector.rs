//! The scene while it is read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::paint::{Side, Thing, plain, seed_of};
use super::polygon::{Corner, Triangles, Triangulator};
use super::walls::{self, Wall};
use super::{SourceOptions, image};
use crate::blockmap::{Paint, Scene, Triangle};
use crate::{Error, Result};

/// What a file says about a surface's colour.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Given {
    /// Into the scene's textures.
    pub texture: Option<u32>,
    /// Where there is no texture.
    pub colour: Option<[u8; 3]>,
    /// Else its normal tells.
    pub side: Option<Side>,
}

/// A scene, and what is known of the file and the object that are being read.
pub(super) struct Collector<'a> {
    options: &'a SourceOptions,
    scene: Scene,
    path: PathBuf,
    /// By name; `None` for those that could not be read.
    images: BTreeMap<String, Option<u32>>,
    texture_bytes: usize,
    triangulator: Triangulator,
    thing: Thing,
    seed: Option<u32>,
    walls: Vec<Wall>,
    /// In the order of their first occurrence: what happened, where first, how often.
    events: Vec<(&'static str, String, usize)>,
}

impl Collector<'_> {
    pub(super) fn new(options: &SourceOptions) -> Collector<'_> {
        Collector {
            options,
            scene: Scene::default(),
            path: PathBuf::new(),
            images: BTreeMap::new(),
            texture_bytes: 0,
            triangulator: Triangulator::new(),
            thing: Thing::Building,
            seed: None,
            walls: Vec::new(),
            events: Vec::new(),
        }
    }

    pub(super) fn into_scene(self) -> Scene {
        self.scene
    }

    /// Begins a file.
    pub(super) fn open(&mut self, path: &Path) {
        self.path = path.to_path_buf();
    }

    /// Ends the file.
    pub(super) fn close(&mut self) {
        self.end_object();
        for (what, place, count) in std::mem::take(&mut self.events) {
            let text = match count {
                1 => format!("{what} at {place}"),
                _ => format!("{what} {count} times, first at {place}"),
            };
            self.warn(&text);
        }
    }

    /// Begins an object; those of one name look alike.
    pub(super) fn begin_object(&mut self, thing: Thing, name: &str) {
        self.end_object();
        self.thing = thing;
        self.seed = self.options.facades.map(|seed| seed_of(seed, name));
    }

    fn end_object(&mut self) {
        let walls = std::mem::take(&mut self.walls);
        if let Some(seed) = self.seed {
            walls::paint(&mut self.scene.triangles, &walls, seed);
        }
    }

    /// A warning about the file.
    pub(super) fn warn(&mut self, text: &str) {
        let line = format!("{}: {text}", self.path.display());
        self.scene.warnings.push(line);
    }

    /// A warning that is given once, with the number of times, when the file ends.
    pub(super) fn count(&mut self, what: &'static str, place: impl FnOnce() -> String) {
        match self.events.iter_mut().find(|event| event.0 == what) {
            Some((_, _, count)) => *count += 1,
            None => self.events.push((what, place(), 1)),
        }
    }

    /// Sets the reference system, or compares it with that of the files before.
    pub(super) fn set_crs(&mut self, crs: &str) -> Result<()> {
        if !self.scene.crs.is_empty() && self.scene.crs != crs {
            let text = format!(
                "its reference system is {crs}, that of the files before it {}",
                self.scene.crs
            );
            return Err(Error::input(&self.path, text));
        }
        self.scene.crs = crs.to_string();
        Ok(())
    }

    /// Most bytes of an image file.
    pub(super) fn most_image_bytes(&self) -> usize {
        self.options.max_texture_bytes
    }

    /// The texture of an image, decoded where its name comes for the first time; `None`, with a warning, where it cannot
    /// be read.
    pub(super) fn texture(
        &mut self,
        name: &str,
        read: impl FnOnce() -> std::result::Result<Vec<u8>, String>,
    ) -> Option<u32> {
        if let Some(known) = self.images.get(name) {
            return *known;
        }
        let most = self.options.max_texture_bytes - self.texture_bytes;
        let texture = match read().and_then(|bytes| image::decode(&bytes, most)) {
            Ok(texture) => {
                self.texture_bytes += texture.bytes();
                self.scene.textures.push(texture);
                u32::try_from(self.scene.textures.len() - 1).ok()
            }
            Err(cause) => {
                self.warn(&format!("image {name} is left out: {cause}"));
                None
            }
        };
        self.images.insert(name.to_string(), texture);
        texture
    }

    /// Adds a polygon, its outer ring first; `place` names it where it is skipped.
    pub(super) fn surface(
        &mut self,
        rings: &[Vec<Corner>],
        given: &Given,
        place: impl FnOnce() -> String,
    ) -> Result<()> {
        let Some(Triangles { normal, triangles }) = self.triangulator.triangulate(rings) else {
            self.count(
                "a polygon without an area, or that crosses itself, was skipped",
                place,
            );
            return Ok(());
        };
        let first = self.scene.triangles.len();
        if triangles.len() > self.options.max_triangles.saturating_sub(first) {
            let text = format!(
                "more than {} triangles, reached at {}",
                self.options.max_triangles,
                place()
            );
            return Err(Error::input(&self.path, text));
        }
        let side = given.side.unwrap_or_else(|| Side::of_normal(normal));
        let has_own = given.texture.is_some() || given.colour.is_some();
        let colour = given
            .colour
            .unwrap_or_else(|| plain(self.thing, side, self.seed));
        self.scene
            .triangles
            .extend(triangles.iter().map(|corners| Triangle {
                corners: corners.map(|corner| corner.at.to_array()),
                paint: match given.texture {
                    Some(index) => Paint::Texture {
                        index,
                        at: corners.map(|corner| corner.texture),
                    },
                    None => Paint::Plain(colour),
                },
            }));
        let is_upright = Side::of_normal(normal) == Side::Wall;
        if !has_own && self.thing == Thing::Building && side == Side::Wall && is_upright {
            let triangles = first..self.scene.triangles.len();
            self.walls.push(Wall { triangles, normal });
        }
        Ok(())
    }
}
