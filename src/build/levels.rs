//! The heights that each level should have: the input's, and where the transform filters, those that it
//! makes of them from fine to coarse.

use super::plane::Plane;
use super::workers::map_in_order;
use crate::codec::{Components, Outline};
use crate::lattice::{Diamond, Lattice, reflect_absent_half};
use crate::transform::{Transform, Validity};
use crate::{Error, Result};

/// What the coding of every diamond should lead to.
pub(super) struct Levels<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) plane: &'a Plane,
    /// Components of a sample.
    pub(super) components: usize,
    /// Heights in units, row by row, component after component, each on the level that it is first a vertex
    /// of: a sample that is a root vertex on level 0, one that is a centre of a diamond on the level after the
    /// diamond's.
    units: Vec<i32>,
    /// For each diamond by rank its vertices on the level after its own, component after component, an
    /// absent half reflected; empty where levels are not filtered.
    next_vertices: Vec<Box<[i32]>>,
}

/// 1 where an entry of a matrix is a sample that is not void; `None` when all are.
type Mask = Option<Box<[u8]>>;

impl<'a> Levels<'a> {
    /// The levels of a raster under the transform of each component. `step` is told of samples done.
    pub(super) fn new(
        lattice: &'a Lattice,
        plane: &'a Plane,
        components: &Components,
        transforms: &[Box<dyn Transform>],
        threads: usize,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Levels<'a>> {
        let unit = |component: usize| {
            let samples = plane.samples();
            samples.map(move |sample| sample.map_or(0, |s| components.to_unit(component, s)))
        };
        let mut levels = Levels {
            lattice,
            plane,
            components: components.count(),
            units: (0..components.count()).flat_map(unit).collect(),
            next_vertices: Vec::new(),
        };
        if transforms.iter().any(|transform| transform.is_filtering()) {
            levels.next_vertices = vec![Box::default(); lattice.diamond_count() as usize];
            for level in (0..lattice.levels()).rev() {
                levels.filter(level, transforms, threads, step)?;
            }
        }
        Ok(levels)
    }

    /// Turns the heights on the level after `level` into those on `level`, keeping the former ones of
    /// each diamond's vertices.
    fn filter(
        &mut self,
        level: u32,
        transforms: &[Box<dyn Transform>],
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
            let cells = self.lattice.cells();
            let vertices = own.chunks_exact_mut((cells + 1) * (cells + 1));
            let both = vertices.zip(centres.chunks_exact(cells * cells));
            for (transform, (vertices, centres)) in transforms.iter().zip(both) {
                transform.filter(&validity, vertices, centres);
            }
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
        let (count, entries) = (self.plane.count(), (cells + 1) * (cells + 1));
        for j in 1..cells {
            for i in 1..cells {
                let at = placement.vertex(i, j);
                if self.lattice.in_raster(at) {
                    let (index, entry) = (self.plane.index(at), j * (cells + 1) + i);
                    for component in 0..self.components {
                        self.units[component * count + index] =
                            vertices[component * entries + entry];
                    }
                }
            }
        }
    }

    /// A diamond's vertices as they are among all heights now, (N+1)^2 of each component, and which are
    /// valid.
    fn vertices(&self, diamond: Diamond, outline: &Outline) -> (Box<[i32]>, Mask) {
        let (placement, side) = (self.lattice.placement(diamond), self.lattice.cells() + 1);
        let place = |index: usize| placement.vertex(index % side, index / side);
        let (mut heights, mut valid) = self.collect(side * side, |index| {
            Some(place(index)).filter(|&at| self.lattice.in_raster(at))
        });
        if let Some(absent) = outline.absent {
            for heights in heights.chunks_exact_mut(side * side) {
                reflect_absent_half(side - 1, absent, heights);
            }
            reflect_absent_half(side - 1, absent, &mut valid);
        }
        (heights, Some(valid).filter(|valid| valid.contains(&0)))
    }

    /// The heights that a diamond's centres should have on the next level, N^2 of each component, and which
    /// are valid.
    fn centres(&self, diamond: Diamond, outline: &Outline) -> (Box<[i32]>, Mask) {
        let (placement, cells) = (self.lattice.placement(diamond), self.lattice.cells());
        let (heights, valid) = self.collect(cells * cells, |index| {
            let place = || placement.centre(index % cells, index / cells);
            outline.is_codable(index).then(place)
        });
        (heights, Some(valid).filter(|valid| valid.contains(&0)))
    }

    /// Heights of samples, component after component, 0 where there is none, and 1 for each that is valid.
    fn collect(
        &self,
        count: usize,
        place: impl Fn(usize) -> Option<[i64; 2]>,
    ) -> (Box<[i32]>, Box<[u8]>) {
        let mut heights = vec![0; self.components * count].into_boxed_slice();
        let mut valid = vec![0; count].into_boxed_slice();
        for index in 0..count {
            if let Some(at) = place(index).filter(|&at| !self.plane.is_void(at)) {
                let own = self.units[self.plane.index(at)..].iter();
                let own = own.step_by(self.plane.count());
                for (heights, &unit) in heights.chunks_exact_mut(count).zip(own) {
                    heights[index] = unit;
                }
                valid[index] = 1;
            }
        }
        (heights, valid)
    }

    /// Visits the heights of all samples that are not void, as they are now.
    pub(super) fn for_each_height(&self, visit: impl FnMut(i32)) {
        let heights = self.units.iter().zip(self.plane.samples());
        let valid = heights.filter(|(_, sample)| sample.is_some());
        valid.map(|(&height, _)| height).for_each(visit);
    }

    /// A component of the root vertex at a position in the raster; `None` for a void.
    pub(super) fn root_vertex(&self, component: usize, at: [i64; 2]) -> Option<i32> {
        let index = component * self.plane.count() + self.plane.index(at);
        (!self.plane.is_void(at)).then(|| self.units[index])
    }

    /// The heights that a diamond's centres should have on the next level, N^2 of each component, 0 where not
    /// valid; and, where the raster has voids, N^2: 1 for each codable one that is void.
    pub(super) fn next_centres(
        &self,
        diamond: Diamond,
        outline: &Outline,
    ) -> (Box<[i32]>, Option<Box<[u8]>>) {
        let (heights, valid) = self.centres(diamond, outline);
        let (has_voids, cells) = (self.plane.void_samples > 0, self.lattice.cells());
        let is_void = |index: usize| {
            let valid = valid.as_ref().is_none_or(|valid| valid[index] != 0);
            u8::from(!valid && outline.is_codable(index))
        };
        let voids = has_voids.then(|| (0..cells * cells).map(is_void).collect());
        (heights, voids)
    }

    /// The heights that the vertices of the diamond of this rank should have on the next level, (N+1)^2 of
    /// each component; `None` where they are those on its own.
    pub(super) fn next_vertices(&self, rank: u64) -> Option<&[i32]> {
        self.next_vertices.get(rank as usize).map(|next| &**next)
    }
}
