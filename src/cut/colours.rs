//! Colours on a cut's ground: a second repository, over the same domain.

use super::layer::Layer;
use super::source::DiamondSource;
use crate::codec::{Components, Matrix, Refined};
use crate::geo::Frame;
use crate::lattice::{Apex, Diamond, Lattice};
use crate::log::{LogLevel, log};
use crate::{Error, Result};
use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

/// How far two places, in samples, may be apart and count as one.
const SAME_PLACE: f64 = 1e-4;

/// What patches have as colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColourForm {
    /// 4 bytes for each vertex: red, green, blue, 255.
    Vertices,
    /// A square of texels, 3 bytes each, over the whole diamond; beyond the hypotenuse of the patch it only serves filters.
    Texture,
}

/// Colours for a cut.
#[derive(Clone, Debug)]
pub struct Colouring {
    /// A layer of colours with the domain of the cut's heights.
    pub layer: Arc<Layer>,
    /// What patches have.
    pub form: ColourForm,
    /// The size on the screen, in pixels, up to which texels need not be finer: the side of a square as large as the mean
    /// texel of a half.
    pub texel_pixels: f64,
}

/// Where a cut gets its colours from.
pub(super) struct Colours {
    layer: Arc<Layer>,
    pub form: ColourForm,
    pub texel_pixels: f64,
    /// As deep as the cut's.
    lattice: Lattice,
    all_valid: Box<[u8]>,
    /// Diamonds whose failure has been told.
    failed: Mutex<HashSet<Diamond>>,
}

/// The colours of a diamond on its own level.
#[derive(Clone)]
pub(super) struct Texels {
    pub matrix: Matrix,
    /// Not all of them are of the repository: those of finer levels cannot be decoded.
    pub is_estimated: bool,
}

/// The colours of a diamond on the next level.
#[derive(Clone)]
pub(super) struct RefinedTexels {
    pub refined: Refined,
    pub is_estimated: bool,
}

impl Colours {
    /// `levels` are those of the cut, at least those of the colours.
    ///
    /// # Errors
    ///
    /// [`Error::Input`] for a layer of heights, or of another domain; [`Error::Argument`] for no size of texels, or for a
    /// colour of each vertex where diamonds have fewer texels than vertices.
    pub fn new(colouring: &Colouring, heights: &dyn DiamondSource, levels: u32) -> Result<Colours> {
        let Colouring {
            layer,
            form,
            texel_pixels,
        } = colouring;
        let (own, other) = (layer.lattice(), heights.lattice());
        let cannot = |problem: String| Error::input(layer.store().path(), problem);
        if !(*texel_pixels > 0.0 && texel_pixels.is_finite()) {
            return Err(Error::Argument(format!(
                "texels of {texel_pixels} pixels are not above 0"
            )));
        }
        if let Components::Height(_) = layer.components() {
            return Err(cannot("it holds heights, and colours are needed".into()));
        }
        if !has_domain_of(layer, heights) {
            return Err(cannot(
                "its colours do not have the domain of the heights: build them with --domain-of"
                    .into(),
            ));
        }
        if *form == ColourForm::Vertices && own.cells() < other.cells() {
            return Err(cannot(format!(
                "its diamonds of {} cells do not colour each vertex of {} cells",
                own.cells(),
                other.cells()
            )));
        }
        let side = own.cells() + 1;
        Ok(Colours {
            lattice: own.finer(levels.saturating_sub(own.levels()))?,
            layer: layer.clone(),
            form: *form,
            texel_pixels: *texel_pixels,
            all_valid: vec![1; side * side].into(),
            failed: Mutex::default(),
        })
    }

    /// The diamonds, as deep as the cut's.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// A mask of vertices, all of them valid.
    pub fn all_valid(&self) -> &[u8] {
        &self.all_valid
    }

    pub fn root(&self) -> Texels {
        Texels {
            matrix: self.layer.root().clone(),
            is_estimated: false,
        }
    }

    /// Storage for the colours of a diamond.
    pub fn empty(&self) -> Texels {
        let side = self.lattice.cells() + 1;
        Texels {
            matrix: Matrix {
                values: vec![0; 3 * side * side].into(),
                valid: None,
            },
            is_estimated: false,
        }
    }

    /// Whether the repository has other colours for a diamond than those of its own level's.
    ///
    /// # Errors
    ///
    /// Those of reading the index.
    pub fn has_finer(&self, diamond: Diamond) -> Result<bool> {
        if diamond.level() >= self.layer.lattice().levels() {
            return Ok(false);
        }
        let summary = self.layer.summary(diamond, [0, 0])?;
        Ok(summary.error > 0.0 && !summary.is_missing)
    }

    /// The next level: decoded, or where the repository has no more the mean of the four texels around. What cannot
    /// be decoded is told once.
    pub fn refine(&self, diamond: Diamond, texels: &Texels) -> RefinedTexels {
        let has_data = !texels.is_estimated && diamond.level() < self.layer.lattice().levels();
        if has_data {
            match self.layer.refine(diamond, &texels.matrix) {
                Ok(refined) => {
                    return RefinedTexels {
                        refined,
                        is_estimated: false,
                    };
                }
                Err(Error::Missing { .. }) => {}
                Err(error) => self.tell(diamond, &error),
            }
        }
        RefinedTexels {
            refined: Refined {
                vertices: None,
                centres: self.means(&texels.matrix),
            },
            is_estimated: true,
        }
    }

    fn tell(&self, diamond: Diamond, error: &Error) {
        // No thread panics while it holds the lock.
        let mut failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner);
        if failed.insert(diamond) {
            let message = format!("colours that cannot be refined: {error}");
            log(LogLevel::Warning, &message);
        }
    }

    fn means(&self, vertices: &Matrix) -> Matrix {
        let (cells, side) = (self.lattice.cells(), self.lattice.cells() + 1);
        let mut values = Vec::with_capacity(3 * cells * cells);
        for own in vertices.values.chunks_exact(side * side) {
            for (near, far) in own.chunks_exact(side).zip(own[side..].chunks_exact(side)) {
                let mean = |i: usize| {
                    let around = [near[i], near[i + 1], far[i], far[i + 1]].map(i64::from);
                    ((around.iter().sum::<i64>() + 2) >> 2) as i32
                };
                values.extend((0..cells).map(mean));
            }
        }
        Matrix {
            values: values.into(),
            valid: None,
        }
    }

    /// Bytes of a diamond's colours on one level, and of a mask of them.
    pub fn own_bytes(&self) -> [u64; 2] {
        let count = self.all_valid.len() as u64;
        [3 * count * size_of::<i32>() as u64, count]
    }

    /// Bytes of a half's colours of so many vertices.
    pub fn bytes(&self, vertices: usize) -> u64 {
        let side = self.lattice.cells() + 1;
        let bytes = match self.form {
            ColourForm::Vertices => 4 * vertices,
            ColourForm::Texture => 3 * side * side,
        };
        bytes as u64
    }

    /// Texels along a side of a texture.
    pub fn texture_side(&self) -> usize {
        self.lattice.cells() + 1
    }

    /// Red, green and blue at an index of a vertex matrix.
    fn rgb(&self, texels: &Matrix, index: usize) -> [u8; 3] {
        let count = self.all_valid.len();
        match self.layer.components() {
            Components::Colour(units) => {
                let own = [0, 1, 2].map(|component| texels.values[component * count + index]);
                units.to_bytes(own)
            }
            Components::Height(_) => [0; 3],
        }
    }

    /// The colour of each vertex of a half, whose indices in a matrix of `cells` are in this order.
    pub fn of_vertices(&self, texels: &Matrix, cells: usize, order: &[u16]) -> Box<[u8]> {
        let stride = self.lattice.cells() / cells;
        let colours = order.iter().flat_map(|&index| {
            let (i, j) = (
                usize::from(index) % (cells + 1),
                usize::from(index) / (cells + 1),
            );
            let [red, green, blue] = self.rgb(texels, (j * self.texture_side() + i) * stride);
            [red, green, blue, 255]
        });
        colours.collect()
    }

    /// The texture of a half. Beyond the hypotenuse it is mirrored, but for the texels next to it: those are such that
    /// bilinear filters are linear along the hypotenuse, so that the textures on both sides meet there.
    pub fn texture(&self, texels: &Matrix, apex: Apex) -> Box<[u8]> {
        let (cells, side) = (self.lattice.cells(), self.texture_side());
        let mut texture = vec![[0u8; 3]; side * side];
        let rows = || (0..side).map(|j| (j, apex.row(cells as i64, j as i64)));
        for (j, (first, last)) in rows() {
            for i in first as usize..=last as usize {
                let (a, b) = apex.mirrored(cells, i, j);
                let colour = self.rgb(texels, j * side + i);
                texture[j * side + i] = colour;
                texture[b * side + a] = colour;
            }
        }
        for (j, (first, last)) in rows() {
            for i in [first + 1, last - 1].map(|i| i as usize) {
                let (a, b) = apex.mirrored(cells, i.min(cells), j);
                if a.abs_diff(i) == 1 && (first..=last).contains(&(i as i64)) {
                    let ends = [texture[j * side + a], texture[b * side + i]];
                    let own = texture[j * side + i];
                    texture[b * side + a] = std::array::from_fn(|band| {
                        let sum = i16::from(ends[0][band]) + i16::from(ends[1][band]);
                        (sum - i16::from(own[band])).clamp(0, 255) as u8
                    });
                }
            }
        }
        texture.into_flattened().into()
    }
}

/// Whether a layer of colours lies where heights do, corner on corner.
fn has_domain_of(colours: &Layer, heights: &dyn DiamondSource) -> bool {
    let (own, other) = (colours.lattice(), heights.lattice());
    let (info, frames) = (
        colours.raster_info(),
        [Frame::of(colours.raster_info()), *heights.frame()],
    );
    let last =
        |lattice: &Lattice| [lattice.width(), lattice.height()].map(|side| f64::from(side - 1));
    let ([width, height], [columns, rows]) = (last(own), last(other));
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
    let is_same_place = |[x, y]: [f64; 2]| {
        let [a, b] = frames[0].grid_to_world(x * width, y * height);
        let place = frames[1].world_to_grid(a, b);
        let there = [x * columns, y * rows];
        let is_near =
            |[a, b]: [f64; 2]| (a - there[0]).abs().max((b - there[1]).abs()) < SAME_PLACE;
        // Frames of geographic rasters have their origin in the middle of each.
        let on_earth = heights.georeference().map(|heights| {
            let [x, y] = info.sample_to_crs(x * width, y * height);
            heights.crs_to_sample(x, y).is_some_and(is_near)
        });
        is_near(place) && on_earth.unwrap_or(true)
    };
    own.has_domain_of(other) && corners.into_iter().all(is_same_place)
}
