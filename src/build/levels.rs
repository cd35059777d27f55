//! The heights that each level should have: the input's, and where the transform filters, those that it
//! makes of them from fine to coarse.

use super::plane::Plane;
use super::workers::map_in_order;
use crate::codec::{Outline, Units};
use crate::lattice::{Diamond, Lattice, reflect_absent_half};
use crate::transform::{Transform, Validity};
use crate::{Error, Result};

/// What the coding of every diamond should lead to.
pub(super) struct Levels<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) plane: &'a Plane,
    /// Heights in units, row by row, each on the level that it is first a vertex of: a sample that is a
    /// root vertex on level 0, one that is a centre of a diamond on the level after the diamond's.
    units: Vec<i32>,
    /// For each diamond by rank its vertices on the level after its own, an absent half reflected; empty
    /// where levels are not filtered.
    next_vertices: Vec<Box<[i32]>>,
}

/// 1 where an entry of a matrix is a sample that is not void; `None` when all are.
type Mask = Option<Box<[u8]>>;

impl<'a> Levels<'a> {
    /// The levels of a raster under a transform. `step` is told of samples done.
    pub(super) fn new(
        lattice: &'a Lattice,
        plane: &'a Plane,
        units: &Units,
        transform: &dyn Transform,
        threads: usize,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Levels<'a>> {
        let unit = |sample: &f64| {
            if sample.is_nan() {
                0
            } else {
                units.to_unit(*sample)
            }
        };
        let mut levels = Levels {
            lattice,
            plane,
            units: plane.samples.iter().map(unit).collect(),
            next_vertices: Vec::new(),
        };
        if transform.is_filtering() {
            levels.next_vertices = vec![Box::default(); lattice.diamond_count() as usize];
            for level in (0..lattice.levels()).rev() {
                levels.filter(level, transform, threads, step)?;
            }
        }
        Ok(levels)
    }

    /// Turns the heights on the level after `level` into those on `level`, keeping the former ones of
    /// each diamond's vertices.
    fn filter(
        &mut self,
        level: u32,
        transform: &dyn Transform,
        threads: usize,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<()> {
        let first = self.lattice.level_ranks(level).start as usize;
        let diamonds = self.lattice.diamonds(level);
        let mut filtered: Vec<Box<[i32]>> = Vec::with_capacity(diamonds.len());
        let work = |index: usize| {
            let (diamond, outline) = (diamonds[index], Outline::of(self.lattice, diamonds[index]));
            let (next, valid) = self.vertices(diamond, &outline);
            let (centres, valid_centres) = self.centres(diamond, &outline);
            let validity = Validity {
                vertices: valid.as_deref(),
                centres: valid_centres.as_deref(),
                absent: outline.absent,
            };
            let mut own = next.clone();
            transform.filter(&validity, &mut own, &centres);
            let cells = self.lattice.cells();
            (next, own, outline.codable_count(cells) as u64)
        };
        let mut former: Vec<Box<[i32]>> = Vec::with_capacity(diamonds.len());
        map_in_order::<_, Error>(threads, diamonds.len(), work, |_, (next, own, samples)| {
            former.push(next);
            filtered.push(own);
            step(samples)
        })?;
        for (diamond, own) in diamonds.into_iter().zip(filtered) {
            self.put_inner(diamond, &own);
        }
        self.next_vertices[first..first + former.len()].swap_with_slice(&mut former);
        Ok(())
    }

    /// Writes a diamond's inner vertices, which no other diamond of its level has inside.
    fn put_inner(&mut self, diamond: Diamond, vertices: &[i32]) {
        let (placement, cells) = (self.lattice.placement(diamond), self.lattice.cells());
        for j in 1..cells {
            for i in 1..cells {
                let at = placement.vertex(i, j);
                if self.lattice.in_raster(at) {
                    self.units[self.plane.index(at)] = vertices[j * (cells + 1) + i];
                }
            }
        }
    }

    /// A diamond's vertices as they are among all heights now, (N+1)^2, and which are valid.
    fn vertices(&self, diamond: Diamond, outline: &Outline) -> (Box<[i32]>, Mask) {
        let (placement, side) = (self.lattice.placement(diamond), self.lattice.cells() + 1);
        let place = |index: usize| placement.vertex(index % side, index / side);
        let (mut heights, mut valid) = self.collect(side * side, |index| {
            Some(place(index)).filter(|&at| self.lattice.in_raster(at))
        });
        if let Some(absent) = outline.absent {
            reflect_absent_half(side - 1, absent, &mut heights);
            reflect_absent_half(side - 1, absent, &mut valid);
        }
        (heights, Some(valid).filter(|valid| valid.contains(&0)))
    }

    /// The heights that a diamond's centres should have on the next level, N^2, and which are valid.
    fn centres(&self, diamond: Diamond, outline: &Outline) -> (Box<[i32]>, Mask) {
        let (placement, cells) = (self.lattice.placement(diamond), self.lattice.cells());
        let (heights, valid) = self.collect(cells * cells, |index| {
            let place = || placement.centre(index % cells, index / cells);
            outline.is_codable(index).then(place)
        });
        (heights, Some(valid).filter(|valid| valid.contains(&0)))
    }

    /// Heights of samples, 0 where there is none, and 1 for each that is valid.
    fn collect(
        &self,
        count: usize,
        place: impl Fn(usize) -> Option<[i64; 2]>,
    ) -> (Box<[i32]>, Box<[u8]>) {
        let mut heights = vec![0; count].into_boxed_slice();
        let mut valid = vec![0; count].into_boxed_slice();
        for index in 0..count {
            if let Some(at) = place(index).filter(|&at| !self.plane.is_void(at)) {
                (heights[index], valid[index]) = (self.units[self.plane.index(at)], 1);
            }
        }
        (heights, valid)
    }

    /// Visits the heights of all samples that are not void, as they are now.
    pub(super) fn for_each_height(&self, visit: impl FnMut(i32)) {
        let heights = self.units.iter().zip(&self.plane.samples);
        let valid = heights.filter(|(_, sample)| !sample.is_nan());
        valid.map(|(&height, _)| height).for_each(visit);
    }

    /// The height of a root vertex at a position in the raster; `None` for a void.
    pub(super) fn root_vertex(&self, at: [i64; 2]) -> Option<i32> {
        (!self.plane.is_void(at)).then(|| self.units[self.plane.index(at)])
    }

    /// The heights that a diamond's centres should have on the next level, N^2, 0 where not valid; and,
    /// where the raster has voids, 1 for each codable one that is void.
    pub(super) fn next_centres(
        &self,
        diamond: Diamond,
        outline: &Outline,
    ) -> (Box<[i32]>, Option<Box<[u8]>>) {
        let (heights, valid) = self.centres(diamond, outline);
        let has_voids = self.plane.void_samples > 0;
        let is_void = |index: usize| {
            let valid = valid.as_ref().is_none_or(|valid| valid[index] != 0);
            u8::from(!valid && outline.is_codable(index))
        };
        let voids = has_voids.then(|| (0..heights.len()).map(is_void).collect());
        (heights, voids)
    }

    /// The heights that the vertices of the diamond of this rank should have on the next level, (N+1)^2;
    /// `None` where they are those on its own.
    pub(super) fn next_vertices(&self, rank: u64) -> Option<&[i32]> {
        self.next_vertices.get(rank as usize).map(|next| &**next)
    }
}
