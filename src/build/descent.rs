//! From the root to the leaf level, each diamond going on from what the decoder returns.

use super::levels::Levels;
use super::workers::map_in_order;
use crate::codec::{Matrix, Outline, Refined, RootCodec, child_vertices};
use crate::lattice::Diamond;
use crate::transform::Target;
use crate::{Error, Result};

/// Everything decoded so far, in memory.
pub(super) struct Descent<'a> {
    levels: &'a Levels<'a>,
    threads: usize,
    /// Vertex matrices of all refinable levels reached, each on its diamond's own level, in the order of
    /// ranks.
    pub(super) vertices: Vec<Matrix>,
    /// The diamonds of the level coded last on the next.
    pub(super) refined: Vec<Refined>,
    /// Decoded units of all samples, each on the finest level reached, component after component.
    pub(super) heights: Vec<i32>,
}

/// What a diamond is coded from.
pub(super) struct Input<'a> {
    pub(super) vertices: &'a Matrix,
    pub(super) outline: &'a Outline,
    pub(super) target: Target<'a>,
    /// 1 for each codable centre that is void; `None` where the raster has no voids.
    pub(super) voids: Option<&'a [u8]>,
}

impl<'a> Descent<'a> {
    /// Codes the root's vertices and goes on from what they decode to; returns the bytes too.
    pub(super) fn new(
        levels: &'a Levels<'a>,
        codec: &RootCodec,
        threads: usize,
    ) -> Result<(Descent<'a>, Vec<u8>)> {
        let bytes = codec.encode(|component, at| levels.root_vertex(component, at));
        let matrix = codec
            .decode(&bytes)
            .map_err(|error| disagreement("the root", error))?;
        let (lattice, plane) = (levels.lattice, levels.plane);
        let mut heights = vec![0; levels.components * plane.count()];
        let (placement, side) = (lattice.placement(lattice.root()), lattice.cells() + 1);
        let own = matrix.values.chunks_exact(side * side);
        for (heights, own) in heights.chunks_exact_mut(plane.count()).zip(own) {
            for (index, &height) in own.iter().enumerate() {
                let at = placement.vertex(index % side, index / side);
                if lattice.in_raster(at) {
                    heights[plane.index(at)] = height;
                }
            }
        }
        let descent = Descent {
            levels,
            threads,
            vertices: vec![matrix],
            refined: Vec::new(),
            heights,
        };
        Ok((descent, bytes))
    }

    /// Takes the diamonds of one level through `code` and gathers the vertices of the next. `consume` gets
    /// what `code` made beside the heights, in the order of ranks, and the number of samples.
    pub(super) fn code_level<T: Send>(
        &mut self,
        level: u32,
        code: impl Fn(Input) -> Result<(T, Refined)> + Sync,
        mut consume: impl FnMut(T, u64) -> Result<()>,
    ) -> Result<()> {
        let levels = self.levels;
        let first = levels.lattice.level_ranks(level).start;
        let diamonds = levels.lattice.diamonds(level);
        let mut refined = Vec::with_capacity(diamonds.len());
        let vertices = &self.vertices[first as usize..];
        let work = |index: usize| {
            let outline = Outline::of(levels.lattice, diamonds[index]);
            let rank = first + index as u64;
            let coded = with_input(
                levels,
                diamonds[index],
                rank,
                &vertices[index],
                &outline,
                &code,
            );
            (coded, outline)
        };
        let heights = &mut self.heights;
        let take = |index: usize, (coded, outline): (Result<(T, Refined)>, Outline)| {
            let (made, next) = coded?;
            let samples = scatter(levels, diamonds[index], &outline, &next, heights);
            refined.push(next);
            consume(made, samples)
        };
        map_in_order(self.threads, diamonds.len(), work, take)?;
        self.refined = refined;
        if level + 1 < levels.lattice.levels() {
            self.gather_level(level + 1)?;
        }
        Ok(())
    }

    /// Shows the diamonds of a level that has been reached to `look`, one in `every`, and what it makes
    /// of them, in the order of ranks, to `consume`.
    pub(super) fn observe<T: Send>(
        &self,
        level: u32,
        every: usize,
        look: impl Fn(Input) -> T + Sync,
        mut consume: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let levels = self.levels;
        let first = levels.lattice.level_ranks(level).start;
        let diamonds = levels.lattice.diamonds(level);
        let work = |index: usize| {
            let (index, diamond) = (index * every, diamonds[index * every]);
            let outline = Outline::of(levels.lattice, diamond);
            let rank = first + index as u64;
            let vertices = &self.vertices[rank as usize];
            with_input(levels, diamond, rank, vertices, &outline, &look)
        };
        let count = diamonds.len().div_ceil(every);
        map_in_order(self.threads, count, work, |_, made| consume(made))
    }

    fn gather_level(&mut self, level: u32) -> Result<()> {
        let lattice = self.levels.lattice;
        let first = lattice.level_ranks(level - 1).start;
        let diamonds = lattice.diamonds(level);
        let gather = |index: usize| {
            let parents = lattice.parents(diamonds[index]).map(|parent| {
                let rank = lattice.rank(parent?);
                let refined = &self.refined[(rank - first) as usize];
                let vertices = refined.vertices(&self.vertices[rank as usize]);
                Some((vertices, &refined.centres))
            });
            child_vertices(lattice, diamonds[index], parents)
        };
        let mut gathered = Vec::with_capacity(diamonds.len());
        map_in_order::<_, Error>(self.threads, diamonds.len(), gather, |_, matrix| {
            gathered.push(matrix);
            Ok(())
        })?;
        self.vertices.append(&mut gathered);
        Ok(())
    }
}

/// Gives `code` what a diamond is coded from.
fn with_input<T>(
    levels: &Levels,
    diamond: Diamond,
    rank: u64,
    vertices: &Matrix,
    outline: &Outline,
    code: impl Fn(Input) -> T,
) -> T {
    let (centres, voids) = levels.next_centres(diamond, outline);
    let target = Target {
        vertices: levels.next_vertices(rank).unwrap_or(&vertices.values),
        centres: &centres,
    };
    code(Input {
        vertices,
        outline,
        target,
        voids: voids.as_deref(),
    })
}

/// Puts a diamond's heights on the next level at their places among all samples; returns how many samples
/// its centres are.
fn scatter(
    levels: &Levels,
    diamond: Diamond,
    outline: &Outline,
    refined: &Refined,
    heights: &mut [i32],
) -> u64 {
    let (lattice, plane) = (levels.lattice, levels.plane);
    let (placement, cells) = (lattice.placement(diamond), lattice.cells());
    let side = cells + 1;
    for (component, heights) in heights.chunks_exact_mut(plane.count()).enumerate() {
        let centres = &refined.centres.values[component * cells * cells..][..cells * cells];
        for (index, &height) in centres.iter().enumerate() {
            if outline.is_codable(index) {
                heights[plane.index(placement.centre(index % cells, index / cells))] = height;
            }
        }
        let Some(vertices) = &refined.vertices else {
            continue;
        };
        let vertices = &vertices.values[component * side * side..][..side * side];
        for index in (1..cells).flat_map(|j| (1..cells).map(move |i| j * side + i)) {
            let at = placement.vertex(index % side, index / side);
            if lattice.in_raster(at) {
                heights[plane.index(at)] = vertices[index];
            }
        }
    }
    outline.codable_count(cells) as u64
}

/// The encoder and the decoder contradict each other, which only a defect of this library can cause.
pub(super) fn disagreement(what: &str, error: crate::codec::BlockError) -> Error {
    Error::Argument(format!(
        "internal error: {what} just written does not decode: {error}"
    ))
}
