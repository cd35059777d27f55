//! Filtered levels: each made from the next finer one by the transform, in memory.

use super::levels::Mask;
use super::plane::{Plane, is_void};
use crate::codec::{Components, Outline};
use crate::lattice::{Diamond, Lattice, reflect_absent_half};
use crate::schedule::map_in_order;
use crate::transform::{Transform, Validity};
use crate::{Error, Result};

/// The heights that a filtering transform makes of a raster.
pub(super) struct Filtered<'a> {
    lattice: &'a Lattice,
    components: usize,
    /// Samples, valid and void.
    samples: usize,
    voids: Vec<bool>,
    /// Heights in units, row by row, component after component, each on the level that it is first a vertex
    /// of: a sample that is a root vertex on level 0, one that is a centre of a diamond on the level after the
    /// diamond's.
    units: Vec<i32>,
    /// For each diamond by rank its vertices on the level after its own, component after component, an
    /// absent half reflected.
    next_vertices: Vec<Box<[i32]>>,
}

impl<'a> Filtered<'a> {
    /// Bytes that a component of a sample takes, about.
    pub(super) const BYTES: u64 = 10;

    /// Filters all levels. `step` is told of samples done.
    pub(super) fn new(
        lattice: &'a Lattice,
        plane: &Plane,
        components: &Components,
        transforms: &[Box<dyn Transform>],
        threads: usize,
        step: &mut dyn FnMut(u64) -> Result<()>,
    ) -> Result<Filtered<'a>> {
        let mut filtered = Filtered::leaf(lattice, plane, components)?;
        for level in (0..lattice.levels()).rev() {
            filtered.filter(level, transforms, threads, step)?;
        }
        Ok(filtered)
    }

    /// The heights of the leaf level: the samples', 0 for voids.
    fn leaf(lattice: &'a Lattice, plane: &Plane, components: &Components) -> Result<Filtered<'a>> {
        let (samples, count) = (plane.count(), components.count());
        let mut units = vec![0; count * samples];
        let mut voids = Vec::with_capacity(samples);
        plane.all_rows(|row| {
            for sample in row.chunks_exact(plane.bands) {
                for component in 0..if is_void(sample) { 0 } else { count } {
                    let unit = components.to_unit(component, sample);
                    units[component * samples + voids.len()] = unit;
                }
                voids.push(is_void(sample));
            }
            true
        })?;
        Ok(Filtered {
            lattice,
            components: count,
            samples,
            voids,
            units,
            next_vertices: vec![Box::default(); lattice.diamond_count() as usize],
        })
    }

    /// The heights that the vertices of the diamond of this rank should have on the next level, (N+1)^2 of
    /// each component.
    pub(super) fn next_vertices(&self, rank: u64) -> &[i32] {
        &self.next_vertices[rank as usize]
    }

    /// The components of the height at a position in the raster; `None` for a void.
    pub(super) fn height(&self, at: [i64; 2]) -> Option<Vec<i32>> {
        let index = self.index(at);
        let own = self.units[index..].iter().step_by(self.samples);
        (!self.voids[index]).then(|| own.copied().collect())
    }

    /// Where the sample at a position in the raster is among all.
    fn index(&self, [column, row]: [i64; 2]) -> usize {
        row as usize * self.lattice.width() as usize + column as usize
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
        let (count, entries) = (self.samples, (cells + 1) * (cells + 1));
        for j in 1..cells {
            for i in 1..cells {
                let at = placement.vertex(i, j);
                if self.lattice.in_raster(at) {
                    let (index, entry) = (self.index(at), j * (cells + 1) + i);
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
    pub(super) fn centres(&self, diamond: Diamond, outline: &Outline) -> (Box<[i32]>, Mask) {
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
            if let Some(at) = place(index).filter(|&at| !self.voids[self.index(at)]) {
                let own = self.units[self.index(at)..].iter();
                let own = own.step_by(self.samples);
                for (heights, &unit) in heights.chunks_exact_mut(count).zip(own) {
                    heights[index] = unit;
                }
                valid[index] = 1;
            }
        }
        (heights, valid)
    }
}
