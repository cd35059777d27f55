//! The heights that each level should have: the samples' own, or where the transform filters, those that it
//! makes of them.

use super::filtered::Filtered;
use super::plane::{Plane, Scratch, is_void};
use crate::Result;
use crate::codec::{Components, Outline};
use crate::lattice::{Diamond, Lattice, centre_runs};
use crate::transform::Transform;

/// What the coding of every diamond should lead to.
pub(super) struct Levels<'a> {
    pub(super) lattice: &'a Lattice,
    pub(super) plane: &'a Plane,
    /// What a sample is inside, but for the bounds of quantisers.
    pub(super) components: Components,
    /// Where the transform filters, the heights that it makes; else they are the samples' own.
    filtered: Option<Filtered<'a>>,
}

/// What a diamond's centres should be on the next level.
pub(super) struct NextCentres {
    /// N^2 of each component, 0 where not valid.
    pub(super) heights: Box<[i32]>,
    /// Where the raster has voids, N^2: 1 for each codable centre that is void.
    pub(super) voids: Option<Box<[u8]>>,
}

/// 1 where an entry of a matrix is a sample that is not void; `None` when all are.
pub(super) type Mask = Option<Box<[u8]>>;

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
        let mut levels = Levels {
            lattice,
            plane,
            components: components.clone(),
            filtered: None,
        };
        if transforms.iter().any(|transform| transform.is_filtering()) {
            let filtered = Filtered::new(lattice, plane, components, transforms, threads, step)?;
            levels.filtered = Some(filtered);
        }
        Ok(levels)
    }

    /// The heights that a diamond's centres should have on the next level.
    pub(super) fn next_centres(&self, diamond: Diamond, outline: &Outline) -> Result<NextCentres> {
        let (heights, valid) = match &self.filtered {
            Some(filtered) => filtered.centres(diamond, outline),
            None => self.centres(diamond, outline)?,
        };
        let (has_voids, cells) = (self.plane.void_samples > 0, self.lattice.cells());
        let voids = has_voids.then(|| {
            let Some(valid) = &valid else {
                return vec![0; cells * cells].into();
            };
            let is_void = |index: usize| u8::from(valid[index] == 0 && outline.is_codable(index));
            (0..cells * cells).map(is_void).collect()
        });
        Ok(NextCentres { heights, voids })
    }

    /// The samples at a diamond's codable centres in units, N^2 of each component, and which are valid.
    fn centres(&self, diamond: Diamond, outline: &Outline) -> Result<(Box<[i32]>, Mask)> {
        let (lattice, plane) = (self.lattice, self.plane);
        let cells = lattice.cells();
        let count = cells * cells;
        let mut heights = vec![0; self.components.count() * count].into_boxed_slice();
        // Without voids all that can be coded is valid.
        let mut valid = (plane.void_samples > 0).then(|| vec![0; count].into_boxed_slice());
        let (mut scratch, mut units) = (Scratch::default(), Vec::new());
        let rows = 0..i64::from(lattice.height());
        for run in centre_runs(lattice.placement(diamond), cells) {
            let run = run.within(0, i64::from(lattice.width()) - 1);
            let Some(run) = run.filter(|run| rows.contains(&run.row)) else {
                continue;
            };
            let samples = plane.read_run(run, &mut scratch)?;
            units.resize(run.count, 0);
            for (component, heights) in heights.chunks_exact_mut(count).enumerate() {
                self.components.to_units(component, samples, &mut units);
                for (k, &unit) in units.iter().enumerate() {
                    heights[run.index + k * run.stride] = unit;
                }
            }
            let Some(valid) = &mut valid else { continue };
            for (k, sample) in samples.chunks_exact(plane.bands).enumerate() {
                let index = run.index + k * run.stride;
                if is_void(sample) {
                    let own = heights[index..].iter_mut().step_by(count);
                    own.for_each(|height| *height = 0);
                } else {
                    valid[index] = 1;
                }
            }
        }
        if let Some(codable) = &outline.codable {
            for heights in heights.chunks_exact_mut(count) {
                let both = heights.iter_mut().zip(codable);
                both.for_each(|(height, &codable)| *height *= i32::from(codable));
            }
            valid = Some(match valid {
                Some(valid) => valid.iter().zip(codable).map(|(a, b)| a & b).collect(),
                None => codable.clone(),
            });
        }
        Ok((heights, valid.filter(|valid| valid.contains(&0))))
    }

    /// The heights that the vertices of the diamond of this rank should have on the next level, (N+1)^2 of
    /// each component; `None` where they are those on its own.
    pub(super) fn next_vertices(&self, rank: u64) -> Option<&[i32]> {
        let filtered = self.filtered.as_ref();
        filtered.map(|filtered| filtered.next_vertices(rank))
    }

    /// The components of the root vertex at a position in the raster; `None` for a void.
    pub(super) fn root_vertex(&self, at: [i64; 2]) -> Result<Option<Vec<i32>>> {
        if let Some(filtered) = &self.filtered {
            return Ok(filtered.height(at));
        }
        let mut scratch = Scratch::default();
        let sample = self.plane.read_row(at[1], at[0], 1, &mut scratch)?;
        let own = |component| self.components.to_unit(component, sample);
        Ok((!is_void(sample)).then(|| (0..self.components.count()).map(own).collect()))
    }
}
