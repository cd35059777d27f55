//! Heights at points, without any view.

use super::cache::{Cache, Kept};
use super::coarse::{self, CoarseHalf, matrix_indices};
use super::overview::Overview;
use super::source::DiamondSource;
use super::terrain::Terrain;
use crate::codec::{Matrix, child_vertices};
use crate::lattice::{Diamond, Lattice, Site};
use crate::{Error, Result};
use std::collections::HashMap;
use std::sync::Arc;

/// How far beside the raster, in samples, a place may lie and count as on its edge: coordinates come with
/// rounding errors.
pub(super) const EDGE_TOLERANCE: f64 = 1e-6;

/// Ranges that a handle remembers.
const MOST_RANGES: usize = 1 << 16;

/// A height of the finest surface that there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Height {
    /// Physical height: `value_scale` x sample + `value_offset`.
    pub height: f64,
    /// Largest difference from the input's surface over the leaf level's triangles, in the unit of `height`;
    /// infinite where detail is missing and a void may have been.
    pub error_bound: f64,
    /// The level it was read at: the leaf level, but where detail is missing that of the diamond which cannot be
    /// refined.
    pub level: u32,
}

/// Reads heights from a terrain through a cache of its own. One handle a thread, any number of handles
/// on a terrain.
pub struct Query {
    terrain: Arc<Terrain>,
    pub(super) cache: Cache,
    /// Once a ray was asked for.
    pub(super) overview: Option<Box<Overview>>,
    /// Ranges of units of diamonds that rays came by, as they were decoded.
    ranges: HashMap<Diamond, [i32; 2]>,
}

impl Query {
    /// A handle whose cache of decoded diamonds holds at most `byte_limit` bytes, or what one height
    /// needs if that is more.
    pub fn new(terrain: Arc<Terrain>, byte_limit: u64) -> Query {
        Query {
            terrain,
            cache: Cache::new(byte_limit),
            overview: None,
            ranges: HashMap::new(),
        }
    }

    /// The terrain that the handle reads.
    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    /// Height at world coordinates; `None` outside the raster and where it is void.
    ///
    /// # Errors
    ///
    /// Those of reading and decoding blocks.
    pub fn height_at_world(&mut self, x: f64, y: f64) -> Result<Option<Height>> {
        let [column, row] = self.terrain.frame().world_to_grid(x, y);
        self.height_at_grid(column, row)
    }

    /// Height at coordinates of the raster's reference system; `None` as for
    /// [`height_at_world`](Self::height_at_world).
    ///
    /// # Errors
    ///
    /// Those of reading and decoding blocks.
    pub fn height_at_crs(&mut self, x: f64, y: f64) -> Result<Option<Height>> {
        match self.terrain.raster_info().crs_to_sample(x, y) {
            Some([column, row]) => self.height_at_grid(column, row),
            None => Ok(None),
        }
    }

    /// Height at a fractional column and row.
    ///
    /// # Errors
    ///
    /// Those of reading and decoding blocks.
    pub fn height_at_grid(&mut self, column: f64, row: f64) -> Result<Option<Height>> {
        let lattice = self.terrain.lattice();
        let last = [lattice.width() - 1, lattice.height() - 1].map(f64::from);
        let beside =
            |place: f64, last: f64| !(-EDGE_TOLERANCE..=last + EDGE_TOLERANCE).contains(&place);
        if beside(column, last[0]) || beside(row, last[1]) {
            return Ok(None);
        }
        let at = [column.clamp(0.0, last[0]), row.clamp(0.0, last[1])];
        match self.finest_height(at, last) {
            Err(Error::Missing { .. }) => self.coarse_height(at),
            height => height,
        }
    }

    /// Height of the leaf level at a place in the raster, whose last column and row are `last`.
    fn finest_height(&mut self, [column, row]: [f64; 2], last: [f64; 2]) -> Result<Option<Height>> {
        // The cell, its last column and row being closed.
        let cell = [
            column.min(last[0] - 1.0).floor(),
            row.min(last[1] - 1.0).floor(),
        ];
        let (a, b) = (column - cell[0], row - cell[1]);
        let [x, y] = cell.map(|index| index as i64);
        let main = self.terrain.lattice().has_main_leaf_cell([x, y]);
        let corners = coarse::triangle(main, coarse::is_in_first(main, a, b), a, b);
        let mut sample = 0.0;
        for (corner, weight) in corners {
            let at = [x + corner[0], y + corner[1]];
            match self.sample(at)? {
                Some(corner) => sample += weight * corner,
                // A vertex without weight does not bear the point.
                None if weight == 0.0 => {}
                None => return Ok(None),
            }
        }
        let terrain = &self.terrain;
        let info = terrain.raster_info();
        Ok(Some(Height {
            height: info.value_offset + info.value_scale * sample,
            error_bound: terrain.header().max_error * info.value_scale.abs(),
            level: terrain.lattice().levels(),
        }))
    }

    /// The half of a diamond that the finest possible cut draws over a place, and the diamond's vertices, of which
    /// those of this half are there.
    pub(super) fn drawn_half(&mut self, at: [f64; 2]) -> Result<(Diamond, usize, Matrix)> {
        let terrain = self.terrain.clone();
        let (lattice, root) = (terrain.lattice(), terrain.root());
        let indices = |diamond: Diamond| matrix_indices(&lattice.placement(diamond), at);
        let mut diamond = lattice.root();
        let is_in_first = CoarseHalf::new(lattice, diamond, 0, root).contains(indices(diamond));
        let mut half = usize::from(!is_in_first);
        let mut above = None;
        while diamond.level() < lattice.levels() {
            let refined = match self.refined(diamond) {
                Err(Error::Missing { .. }) => break,
                refined => refined?,
            };
            let Some(child) = child_around(lattice, diamond, indices(diamond)) else {
                break;
            };
            half = usize::from(lattice.parents(child)[1] == Some(diamond));
            above = Some((diamond, refined));
            diamond = child;
        }
        let vertices = self.vertices_below(diamond, above.as_ref());
        Ok((diamond, half, vertices))
    }

    /// Height at a place under which detail is missing: that of the triangle which the finest possible cut draws.
    fn coarse_height(&mut self, at: [f64; 2]) -> Result<Option<Height>> {
        let (diamond, half, vertices) = self.drawn_half(at)?;
        self.cache.trim();
        let terrain = &self.terrain;
        let lattice = terrain.lattice();
        let surface = CoarseHalf::new(lattice, diamond, half, &vertices);
        let indices = matrix_indices(&lattice.placement(diamond), at);
        let Some(corners) = surface.corners(indices) else {
            return Ok(None);
        };
        let weighted = |height: &dyn Fn(i32) -> f64| -> f64 {
            let each = corners.map(|(index, weight)| weight * height(vertices.values[index]));
            each.iter().sum()
        };
        let (info, units) = (terrain.raster_info(), terrain.units());
        let mut bound = terrain.header().max_error;
        let sample = if diamond.level() == lattice.levels() {
            // On the edge of what is missing, the other side being there.
            weighted(&|unit| units.to_sample(unit))
        } else {
            bound += terrain.summary(diamond, terrain.range())?.error * units.scale;
            let [low, high] = units.sample_range;
            (weighted(&f64::from) * units.scale + units.offset).clamp(low, high)
        };
        Ok(Some(Height {
            height: info.value_offset + info.value_scale * sample,
            error_bound: bound * info.value_scale.abs(),
            level: diamond.level(),
        }))
    }

    /// A decoded sample of the raster; `None` for a void.
    fn sample(&mut self, at: [i64; 2]) -> Result<Option<f64>> {
        let unit = self.unit(at)?;
        Ok(unit.map(|unit| self.terrain.units().to_sample(unit)))
    }

    fn unit(&mut self, at: [i64; 2]) -> Result<Option<i32>> {
        let lattice = self.terrain.lattice();
        let Some((diamond, place)) = lattice.finest_around(at) else {
            let side = lattice.cells() as i64 + 1;
            let step = 1i64 << (lattice.levels() / 2);
            let index = (at[1] / step * side + at[0] / step) as usize;
            let root = self.terrain.root();
            return Ok(root.is_valid(index).then(|| root.values[index]));
        };
        let refined = self.refined(diamond)?;
        self.cache.trim();
        let (matrix, index) = match place {
            Site::Vertex(index) => (&refined.vertices, index),
            Site::Centre(index) => (&refined.centres, index),
        };
        Ok(matrix.is_valid(index).then(|| matrix.values[index]))
    }

    /// A diamond's matrices, from the cache or by decoding what they need.
    pub(super) fn refined(&mut self, diamond: Diamond) -> Result<Arc<Matrices>> {
        if let Some(found) = self.cache.refined(diamond) {
            return Ok(found);
        }
        let vertices = self.vertices(diamond)?;
        let refined = self.terrain.refine(diamond, &vertices)?;
        let (vertices, centres) = refined.into_matrices(vertices);
        let refined = Arc::new(Matrices { vertices, centres });
        self.cache.put(diamond, Kept::Refined(refined.clone()));
        Ok(refined)
    }

    /// A diamond's vertices, whose parents are decoded for it.
    pub(super) fn vertices(&mut self, diamond: Diamond) -> Result<Matrix> {
        let terrain = self.terrain.clone();
        let lattice = terrain.lattice();
        if diamond == lattice.root() {
            return Ok(terrain.root().clone());
        }
        let mut parents = [None, None];
        for (slot, parent) in parents.iter_mut().zip(lattice.parents(diamond)) {
            *slot = parent.map(|parent| self.refined(parent)).transpose()?;
        }
        let matrices = parents
            .each_ref()
            .map(|parent| parent.as_ref().map(|p| (&p.vertices, &p.centres)));
        Ok(child_vertices(lattice, diamond, matrices))
    }

    /// The vertices of a diamond, of which those that come from one parent, refined, are there; `None` stands for the root's.
    pub(super) fn vertices_below(
        &self,
        diamond: Diamond,
        above: Option<&(Diamond, Arc<Matrices>)>,
    ) -> Matrix {
        let lattice = self.terrain.lattice();
        let Some((above, refined)) = above else {
            return self.terrain.root().clone();
        };
        let matrices = (&refined.vertices, &refined.centres);
        let from = |parent| (parent == Some(*above)).then_some(matrices);
        child_vertices(lattice, diamond, lattice.parents(diamond).map(from))
    }

    /// Keeps the byte limit.
    pub(super) fn trim(&mut self) {
        self.cache.trim();
    }

    /// Range of units of all that is drawn for a diamond.
    pub(super) fn range(&mut self, diamond: Diamond) -> Result<[i32; 2]> {
        if let Some(&found) = self.ranges.get(&diamond) {
            return Ok(found);
        }
        let terrain = self.terrain.clone();
        let lattice = terrain.lattice();
        let parents = lattice.parents(diamond);
        let range = if diamond == lattice.root() && lattice.levels() == 0 {
            terrain.range()
        } else if diamond.level() == lattice.levels() {
            let mut hull = [i32::MAX, i32::MIN];
            for parent in parents.into_iter().flatten() {
                let [low, high] = self.range(parent)?;
                hull = [hull[0].min(low), hull[1].max(high)];
            }
            hull
        } else {
            let above = match parents.into_iter().flatten().next() {
                Some(parent) => self.range(parent)?,
                None => terrain.range(),
            };
            terrain.summary(diamond, above)?.range
        };
        if self.ranges.len() >= MOST_RANGES {
            self.ranges.clear();
        }
        self.ranges.insert(diamond, range);
        Ok(range)
    }
}

/// The existing child over the quarter of a diamond that has these matrix indices.
fn child_around(lattice: &Lattice, diamond: Diamond, [i, j]: [f64; 2]) -> Option<Diamond> {
    let middle = lattice.cells() as f64 / 2.0;
    let (x, y) = (i - middle, j - middle);
    // How far towards the edge of each child.
    let towards = [-y, x, y, -x];
    let children = lattice.children(diamond).into_iter().zip(towards);
    children
        .filter_map(|(child, towards)| Some((child?, towards)))
        .max_by(|(_, a), (_, b)| a.total_cmp(b))
        .map(|(child, _)| child)
}

/// A diamond's heights on the next level.
pub(super) struct Matrices {
    pub vertices: Matrix,
    pub centres: Matrix,
}

impl Matrices {
    pub(super) fn bytes(&self) -> u64 {
        let matrix = |m: &Matrix| m.values.len() * 4 + m.valid.as_ref().map_or(0, |v| v.len());
        (matrix(&self.vertices) + matrix(&self.centres)) as u64
    }
}
