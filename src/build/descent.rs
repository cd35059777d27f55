//! From the root to the leaf level, each diamond going on from what the decoder returns.

use super::levels::Levels;
use super::workspace::{Records, Workspace};
use crate::codec::{Matrix, MatrixView, Outline, Refined, RootCodec, child_vertices};
use crate::lattice::Diamond;
use crate::schedule::map_in_order;
use crate::transform::Target;
use crate::{Error, Result};
use std::collections::HashMap;

/// Everything decoded so far.
pub(super) struct Descent<'a> {
    pub(super) levels: &'a Levels<'a>,
    workspace: Workspace,
    threads: usize,
    pub(super) root: Matrix,
    /// The levels coded so far.
    reached: Vec<Reached>,
    /// Least and greatest first component of what is decoded of each diamond coded so far, by rank; those of the
    /// last refinable level with its leaf heights.
    pub(super) ranges: Vec<[i32; 2]>,
}

/// The diamonds of a coded level, in their order.
struct Reached {
    /// Their vertices on their own level.
    vertices: Records,
    /// What refining them gave.
    refined: Records,
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
        workspace: Workspace,
        threads: usize,
    ) -> Result<(Descent<'a>, Vec<u8>)> {
        let (placement, side) = (
            levels.lattice.placement(levels.lattice.root()),
            levels.lattice.cells() + 1,
        );
        let mut samples = HashMap::new();
        for index in 0..side * side {
            let at = placement.vertex(index % side, index / side);
            if levels.lattice.in_raster(at) {
                samples.insert(at, levels.root_vertex(at)?);
            }
        }
        let sample = |component: usize, at: [i64; 2]| Some(samples.get(&at)?.as_ref()?[component]);
        let bytes = codec.encode(sample);
        let root = codec
            .decode(&bytes)
            .map_err(|error| disagreement("the root", error))?;
        let descent = Descent {
            levels,
            workspace,
            threads,
            root,
            reached: Vec::new(),
            ranges: Vec::new(),
        };
        Ok((descent, bytes))
    }

    fn components(&self) -> usize {
        self.levels.components.count()
    }

    /// Takes the diamonds of the next level through `code`. `consume` gets what `code` made beside the
    /// heights, in the order of ranks, and the number of samples.
    pub(super) fn code_level<T: Send>(
        &mut self,
        code: impl Fn(Input) -> Result<(T, Refined)> + Sync,
        mut consume: impl FnMut(T, u64) -> Result<()>,
    ) -> Result<()> {
        let lattice = self.levels.lattice;
        let level = self.reached.len() as u32;
        let is_last = level + 1 == lattice.levels();
        let diamonds = lattice.diamonds(level);
        let mut reached = Reached {
            vertices: Records::new(&self.workspace, &vertices_name(level))?,
            refined: Records::new(&self.workspace, &refined_name(level))?,
        };
        let mut ranges = Vec::with_capacity(diamonds.len());
        let components = self.components();
        let work = |index: usize| {
            let outline = Outline::of(lattice, diamonds[index]);
            let vertices = self.vertices_of(diamonds[index])?;
            let (made, refined) =
                self.with_input(diamonds[index], &vertices, &outline, &code)??;
            let mut range = extremes(&vertices, components);
            if is_last {
                let next = [Some(&refined.centres), refined.vertices.as_ref()];
                let next = next.into_iter().flatten();
                range = next.fold(range, |range, own| union(range, extremes(own, components)));
            }
            let samples = outline.codable_count(lattice.cells()) as u64;
            let records = (matrix_bytes(&vertices), refined_bytes(&refined));
            Ok((made, records, range, samples))
        };
        map_in_order(self.threads, diamonds.len(), work, |_, done| {
            let (made, (vertices, refined), range, samples) = done?;
            reached.vertices.push(vertices)?;
            reached.refined.push(refined)?;
            ranges.push(range);
            consume(made, samples)
        })?;
        self.reached.push(reached);
        self.ranges.append(&mut ranges);
        Ok(())
    }

    /// Entries of a working store that tell of a level that was coded.
    pub(super) fn seal(&mut self, level: u32) -> Result<Vec<(String, Vec<u8>)>> {
        let ranks = self.levels.lattice.level_ranks(level);
        let ranges = &self.ranges[ranks.start as usize..ranks.end as usize];
        let ranges = bytemuck::cast_slice(ranges).to_vec();
        let reached = &mut self.reached[level as usize];
        Ok(vec![
            (vertices_name(level), reached.vertices.seal()?),
            (refined_name(level), reached.refined.seal()?),
            (ranges_name(level), ranges),
        ])
    }

    /// Goes on after so many levels, which are in the working store.
    pub(super) fn restore(&mut self, levels: u32) -> Result<()> {
        for level in 0..levels {
            let records = |name: String| {
                let seal = self.workspace.load(&name)?.unwrap_or_default();
                Records::restore(&self.workspace, &name, &seal)
            };
            self.reached.push(Reached {
                vertices: records(vertices_name(level))?,
                refined: records(refined_name(level))?,
            });
            let ranges = self.workspace.load(&ranges_name(level))?;
            let ranges: Vec<[i32; 2]> = bytemuck::pod_collect_to_vec(&ranges.unwrap_or_default());
            self.ranges.extend(ranges);
        }
        Ok(())
    }

    /// Shows the diamonds of the next level to `look`, one in `every`, and what it makes of them, in the
    /// order of ranks, to `consume`.
    pub(super) fn observe<T: Send>(
        &self,
        every: usize,
        look: impl Fn(Input) -> T + Sync,
        mut consume: impl FnMut(T) -> Result<()>,
    ) -> Result<()> {
        let lattice = self.levels.lattice;
        let diamonds = lattice.diamonds(self.reached.len() as u32);
        let work = |index: usize| {
            let diamond = diamonds[index * every];
            let outline = Outline::of(lattice, diamond);
            let vertices = self.vertices_of(diamond)?;
            self.with_input(diamond, &vertices, &outline, &look)
        };
        let count = diamonds.len().div_ceil(every);
        map_in_order(self.threads, count, work, |_, made| consume(made?))
    }

    /// The vertices of a diamond of the next level.
    fn vertices_of(&self, diamond: Diamond) -> Result<Matrix> {
        let lattice = self.levels.lattice;
        if diamond == lattice.root() {
            return Ok(self.root.clone());
        }
        let (cells, components) = (lattice.cells(), self.components());
        let entries = [cells + 1, cells].map(|side| components * side * side);
        let mut scratch: [[Vec<u8>; 2]; 2] = Default::default();
        let mut aligned: [[Vec<i32>; 2]; 2] = Default::default();
        let mut parents = [None, None];
        let rooms = scratch.iter_mut().zip(&mut aligned);
        let both = parents.iter_mut().zip(lattice.parents(diamond));
        for ((known, parent), ([scratch, other], [vertices, centres])) in both.zip(rooms) {
            let Some((level, number)) = parent.map(|parent| self.place(parent)) else {
                continue;
            };
            let reached = &self.reached[level];
            let [centre_bytes, next] = split_refined(reached.refined.get(number, scratch)?);
            let own = if next.is_empty() {
                reached.vertices.get(number, other)?
            } else {
                next
            };
            *known = Some((
                view_of(own, entries[0], vertices),
                view_of(centre_bytes, entries[1], centres),
            ));
        }
        Ok(child_vertices(lattice, diamond, parents))
    }

    /// The vertices, on its own level, of a diamond that was coded.
    pub(super) fn vertices(&self, diamond: Diamond) -> Result<Matrix> {
        let (level, number) = self.place(diamond);
        let mut scratch = Vec::new();
        let bytes = self.reached[level].vertices.get(number, &mut scratch)?;
        let side = self.levels.lattice.cells() + 1;
        Ok(matrix_of(bytes, self.components() * side * side))
    }

    /// What refining a diamond that was coded gave.
    pub(super) fn refined(&self, diamond: Diamond) -> Result<Refined> {
        let (level, number) = self.place(diamond);
        let mut scratch = Vec::new();
        let bytes = self.reached[level].refined.get(number, &mut scratch)?;
        let cells = self.levels.lattice.cells();
        let entries = [cells * cells, (cells + 1) * (cells + 1)];
        Ok(refined_of(
            bytes,
            entries.map(|count| self.components() * count),
        ))
    }

    /// Level of a diamond, and its number there.
    fn place(&self, diamond: Diamond) -> (usize, usize) {
        let (lattice, level) = (self.levels.lattice, diamond.level());
        let number = lattice.rank(diamond) - lattice.level_ranks(level).start;
        (level as usize, number as usize)
    }

    /// Gives `code` what a diamond is coded from.
    fn with_input<T>(
        &self,
        diamond: Diamond,
        vertices: &Matrix,
        outline: &Outline,
        code: impl Fn(Input) -> T,
    ) -> Result<T> {
        let next = self.levels.next_centres(diamond, outline)?;
        let rank = self.levels.lattice.rank(diamond);
        let target = Target {
            vertices: self.levels.next_vertices(rank).unwrap_or(&vertices.values),
            centres: &next.heights,
        };
        Ok(code(Input {
            vertices,
            outline,
            target,
            voids: next.voids.as_deref(),
        }))
    }
}

fn vertices_name(level: u32) -> String {
    format!("vertices-{level}")
}

fn refined_name(level: u32) -> String {
    format!("refined-{level}")
}

fn ranges_name(level: u32) -> String {
    format!("ranges-{level}")
}

/// A matrix as bytes: its heights, and its mask if it has one.
fn matrix_bytes(matrix: &Matrix) -> Vec<u8> {
    let values: &[u8] = bytemuck::cast_slice(&matrix.values);
    [values, matrix.valid.as_deref().unwrap_or_default()].concat()
}

/// The matrix of `count` heights that has these bytes.
fn matrix_of(bytes: &[u8], count: usize) -> Matrix {
    let (values, valid) = bytes.split_at(4 * count);
    let (values, _) = values.as_chunks::<4>();
    Matrix {
        values: values.iter().map(|&own| i32::from_ne_bytes(own)).collect(),
        valid: (!valid.is_empty()).then(|| valid.into()),
    }
}

/// The same where it lies, or where bytes are not aligned, in `room`.
fn view_of<'a>(bytes: &'a [u8], count: usize, room: &'a mut Vec<i32>) -> MatrixView<'a> {
    let (values, valid) = bytes.split_at(4 * count);
    let values = bytemuck::try_cast_slice(values).unwrap_or_else(|_| {
        *room = bytemuck::pod_collect_to_vec(values);
        room
    });
    MatrixView {
        values,
        valid: (!valid.is_empty()).then_some(valid),
    }
}

/// What refining gave as bytes: the length of the centres', those, and the vertices' if there are any.
fn refined_bytes(refined: &Refined) -> Vec<u8> {
    let length =
        |matrix: &Matrix| 4 * matrix.values.len() + matrix.valid.as_ref().map_or(0, |v| v.len());
    let centres = length(&refined.centres);
    let all = size_of::<usize>() + centres + refined.vertices.as_ref().map_or(0, length);
    let mut bytes = Vec::with_capacity(all);
    bytes.extend(centres.to_ne_bytes());
    for matrix in [Some(&refined.centres), refined.vertices.as_ref()]
        .into_iter()
        .flatten()
    {
        bytes.extend_from_slice(bytemuck::cast_slice(&matrix.values));
        bytes.extend_from_slice(matrix.valid.as_deref().unwrap_or_default());
    }
    bytes
}

/// The bytes of the centres, and those of the vertices if there are any.
fn split_refined(bytes: &[u8]) -> [&[u8]; 2] {
    let (length, rest) = bytes.split_at(size_of::<usize>());
    let mut own = [0; size_of::<usize>()];
    own.copy_from_slice(length);
    rest.split_at(usize::from_ne_bytes(own)).into()
}

/// What has these bytes, with so many centres and vertices.
fn refined_of(bytes: &[u8], [centres, vertices]: [usize; 2]) -> Refined {
    let [centre_bytes, vertex_bytes] = split_refined(bytes);
    Refined {
        vertices: (!vertex_bytes.is_empty()).then(|| matrix_of(vertex_bytes, vertices)),
        centres: matrix_of(centre_bytes, centres),
    }
}

/// Least and greatest height of a matrix; of colours, of the first of their components.
pub(super) fn extremes(matrix: &Matrix, components: usize) -> [i32; 2] {
    crate::transform::adaptive::extremes(&matrix.values[..matrix.values.len() / components])
}

/// The least range that contains both.
pub(super) fn union(a: [i32; 2], b: [i32; 2]) -> [i32; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// The encoder and the decoder contradict each other, which only a defect of this library can cause.
pub(super) fn disagreement(what: &str, error: crate::codec::BlockError) -> Error {
    Error::Argument(format!(
        "internal error: {what} just written does not decode: {error}"
    ))
}
