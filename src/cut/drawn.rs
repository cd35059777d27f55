//! What the finest possible cut draws, half by half, with physical heights.

use super::coarse::{CoarseHalf, matrix_indices, on_plane};
use super::query::{Height, Query};
use super::source::DiamondSource;
use super::terrain::Terrain;
use crate::Result;
use crate::codec::Matrix;
use crate::lattice::{Diamond, Placement};

/// A half of a leaf diamond, or of one that cannot be refined.
pub(super) struct DrawnHalf {
    diamond: Diamond,
    half: usize,
    placement: Placement,
    /// Of the whole diamond; only this half's mean anything.
    vertices: Matrix,
    /// As [`Height::error_bound`].
    pub error_bound: f64,
}

/// A triangle of a half: a plane over matrix indices.
#[derive(Clone, Copy)]
pub(super) struct Facet {
    diamond: Diamond,
    placement: Placement,
    error_bound: f64,
    /// Indices in the vertex matrix.
    indices: [usize; 3],
    corners: [([f64; 2], f64); 3],
}

impl Query {
    /// A half, out of the diamond's vertices.
    pub(super) fn drawn(
        &self,
        diamond: Diamond,
        half: usize,
        vertices: Matrix,
    ) -> Result<DrawnHalf> {
        let terrain = self.terrain();
        let (lattice, header) = (terrain.lattice(), terrain.header());
        let mut bound = header.max_error;
        if diamond.level() < lattice.levels() {
            let summary = terrain.summary(diamond, terrain.range())?;
            bound += summary.error * terrain.units().scale;
        }
        Ok(DrawnHalf {
            diamond,
            half,
            placement: lattice.placement(diamond),
            vertices,
            error_bound: bound * terrain.raster_info().value_scale.abs(),
        })
    }

    /// The half over a place of the raster, in samples.
    pub(super) fn drawn_around(&mut self, at: [f64; 2]) -> Result<DrawnHalf> {
        let (diamond, half, vertices) = self.drawn_half(at)?;
        self.trim();
        self.drawn(diamond, half, vertices)
    }
}

impl DrawnHalf {
    pub(super) fn level(&self) -> u32 {
        self.diamond.level()
    }

    /// Its triangles.
    pub(super) fn surface<'a>(&'a self, terrain: &'a Terrain) -> CoarseHalf<'a> {
        CoarseHalf::new(terrain.lattice(), self.diamond, self.half, &self.vertices)
    }

    /// Matrix indices of a place, in samples.
    pub(super) fn indices(&self, at: [f64; 2]) -> [f64; 2] {
        matrix_indices(&self.placement, at)
    }

    /// Area of each of its triangles, in square samples.
    pub(super) fn area_of_triangle(&self) -> f64 {
        let [u, v] =
            [self.placement.ax, self.placement.ay].map(|step| step.map(|along| along as f64));
        (u[0] * v[1] - u[1] * v[0]).abs() / 2.0
    }

    /// Column and row of a vertex.
    pub(super) fn place(&self, index: usize, side: usize) -> [f64; 2] {
        let vertex = self.placement.vertex(index % side, index / side);
        vertex.map(|along| along as f64)
    }

    /// Whether a place, in samples, is in the closed half.
    pub(super) fn contains(&self, terrain: &Terrain, at: [f64; 2]) -> bool {
        let end = terrain.lattice().cells() as f64;
        let indices = self.indices(at);
        let is_within = indices.iter().all(|along| (0.0..=end).contains(along));
        is_within && self.surface(terrain).contains(indices)
    }

    /// Physical height of a vertex: a sample's at the leaf level, as decoded at coarser ones, which may be beyond
    /// the samples' range.
    pub(super) fn height(&self, terrain: &Terrain, index: usize) -> f64 {
        let (info, units) = (terrain.raster_info(), terrain.units());
        let unit = self.vertices.values[index];
        let sample = if self.level() == terrain.lattice().levels() {
            units.to_sample(unit)
        } else {
            f64::from(unit) * units.scale + units.offset
        };
        info.value_offset + info.value_scale * sample
    }

    /// The drawn triangle at a place of the half, in samples; `None` where none is drawn.
    pub(super) fn facet(&self, terrain: &Terrain, at: [f64; 2]) -> Option<Facet> {
        let surface = self.surface(terrain);
        let corners = surface.corners(self.indices(at))?;
        let side = terrain.lattice().cells() + 1;
        let indices = corners.map(|(index, _)| index);
        Some(Facet {
            diamond: self.diamond,
            placement: self.placement,
            error_bound: self.error_bound,
            indices,
            corners: indices.map(|index| {
                let place = [(index % side) as f64, (index / side) as f64];
                (place, self.height(terrain, index))
            }),
        })
    }
}

impl Facet {
    pub(super) fn is_same(&self, other: &Facet) -> bool {
        (self.diamond, self.indices) == (other.diamond, other.indices)
    }

    /// Height of its plane over a place, in samples.
    pub(super) fn height(&self, at: [f64; 2]) -> Height {
        Height {
            height: on_plane(&self.corners, matrix_indices(&self.placement, at)),
            error_bound: self.error_bound,
            level: self.diamond.level(),
        }
    }
}
