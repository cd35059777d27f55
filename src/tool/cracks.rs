//! Whether the buffers that a cut hands out fit together.

use crate::cut::{Patch, PatchColours};
use crate::lattice::Lattice;
use std::collections::HashSet;

/// Counts the places where patches that cover the domain do not fit together to the bit:
///
/// - a border vertex whose height, slopes or normal, colour or birth differ in two patches that have it;
/// - a side with a corner of another patch in its middle (a T-junction), or with more than two patches;
/// - a border segment that one patch alone draws, unless it may be open.
///
/// A segment may be open on the domain's border; where both its ends are outside the raster, since a
/// coarse triangle without any vertex in the raster is not drawn; and where `may_be_open`, given the
/// grid positions of its ends, says that it borders on a void. All patches must be of one cut.
pub fn count_cracks<'a>(
    patches: impl Iterator<Item = &'a Patch>,
    lattice: &Lattice,
    may_be_open: impl Fn([i64; 2], [i64; 2]) -> bool,
) -> u64 {
    let cells = lattice.cells();
    let grid = sides_of_grid(cells);
    let mut borders = Borders::default();
    for patch in patches {
        borders.add(patch, cells, &grid);
    }
    borders.sort();
    let is_open = |ends: [u64; 2]| {
        let [a, b] = ends.map(place);
        !meets_domain(lattice, a, b)
            || !(lattice.in_raster(a) || lattice.in_raster(b))
            || may_be_open(a, b)
    };
    let mut cracks = borders.differing_corners();
    for same in borders.sides.chunk_by(|a, b| a.ends == b.ends) {
        cracks += match same {
            [alone] => borders.lonely_side(alone, is_open),
            [one, other] => borders.common_side(one, other, is_open),
            _ => same.len() as u64,
        };
    }
    cracks
}

/// A vertex on a patch's border: its place and everything else it holds, to the bit.
#[derive(Clone, Copy, PartialEq, Eq)]
struct BorderVertex {
    key: u64,
    bits: [u32; 7],
    /// The patch draws the segment from here to the next vertex of the side.
    is_drawn: bool,
}

/// One of a patch's three sides.
struct Side {
    /// Keys of the first and last vertex, the lesser first.
    ends: [u64; 2],
    /// Place of its vertices among all.
    vertices: std::ops::Range<usize>,
}

/// The borders of all patches.
#[derive(Default)]
struct Borders {
    vertices: Vec<BorderVertex>,
    sides: Vec<Side>,
    corners: Vec<BorderVertex>,
}

impl Borders {
    fn add(&mut self, patch: &Patch, cells: usize, grid: &[Vec<GridVertex>; 3]) {
        let drawn = patch
            .indices
            .as_ref()
            .map(|indices| drawn_edges(indices, grid));
        let is_drawn = |a: usize, b: usize| {
            drawn
                .as_ref()
                .is_none_or(|drawn| drawn.contains(&(a.min(b), a.max(b))))
        };
        for side in grid {
            let first = self.vertices.len();
            let found = side.iter().map(|&at| border_vertex(patch, cells, at));
            self.vertices.extend(found);
            let [begin, end] = [first, self.vertices.len() - 1].map(|at| self.vertices[at].key);
            if begin > end {
                self.vertices[first..].reverse();
            }
            for step in 0..cells {
                let at = if begin > end { cells - 1 - step } else { step };
                self.vertices[first + step].is_drawn = is_drawn(side[at].index, side[at + 1].index);
            }
            self.corners.push(self.vertices[first]);
            self.sides.push(Side {
                ends: [begin.min(end), begin.max(end)],
                vertices: first..self.vertices.len(),
            });
        }
        // Each side gave its lesser end; this gives the rest.
        let lasts = self.sides[self.sides.len() - 3..]
            .iter()
            .map(|side| side.vertices.end - 1);
        self.corners.extend(lasts.map(|at| self.vertices[at]));
    }

    fn sort(&mut self) {
        self.corners.sort_unstable_by_key(|corner| corner.key);
        self.sides.sort_unstable_by_key(|side| side.ends);
    }

    fn differing_corners(&self) -> u64 {
        let pairs = self.corners.windows(2);
        pairs
            .filter(|pair| pair[0].key == pair[1].key && pair[0].bits != pair[1].bits)
            .count() as u64
    }

    /// Cracks at a side that no other patch has.
    fn lonely_side(&self, side: &Side, is_open: impl Fn([u64; 2]) -> bool) -> u64 {
        let [a, b] = side.ends.map(place);
        let middle = key([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
        let is_junction = self
            .corners
            .binary_search_by_key(&middle, |corner| corner.key)
            .is_ok();
        let steps = self.vertices[side.vertices.clone()].windows(2);
        let torn = steps.filter(|step| step[0].is_drawn && !is_open([step[0].key, step[1].key]));
        torn.count() as u64 + u64::from(is_junction)
    }

    /// Cracks at a side that two patches have.
    fn common_side(&self, one: &Side, other: &Side, is_open: impl Fn([u64; 2]) -> bool) -> u64 {
        let [one, other] = [one, other].map(|side| &self.vertices[side.vertices.clone()]);
        let pairs = one.iter().zip(other);
        let differing = pairs
            .filter(|(a, b)| a.key != b.key || a.bits != b.bits)
            .count();
        let steps = one.windows(2).zip(other);
        let torn = steps.filter(|(step, other)| {
            step[0].is_drawn != other.is_drawn && !is_open([step[0].key, step[1].key])
        });
        (differing + torn.count()) as u64
    }
}

/// Grid positions are not negative and below 2^31, the lattice beginning at the first sample.
fn key([column, row]: [i64; 2]) -> u64 {
    (column as u64) << 32 | row as u64
}

fn place(key: u64) -> [i64; 2] {
    [(key >> 32) as i64, (key & 0xffff_ffff) as i64]
}

/// One vertex on a side of the patch grid.
#[derive(Clone, Copy)]
struct GridVertex {
    p: usize,
    q: usize,
    index: usize,
}

/// The sides q = 0, p = 0, p + q = N.
fn sides_of_grid(cells: usize) -> [Vec<GridVertex>; 3] {
    let vertex = |p: usize, q: usize| {
        let index = (0..q).map(|row| cells + 1 - row).sum::<usize>() + p;
        GridVertex { p, q, index }
    };
    [
        (0..=cells).map(|p| vertex(p, 0)).collect(),
        (0..=cells).map(|q| vertex(0, q)).collect(),
        (0..=cells).map(|q| vertex(cells - q, q)).collect(),
    ]
}

/// Edges of all triangles between vertices of the sides, the lesser vertex first.
fn drawn_edges(indices: &[u16], grid: &[Vec<GridVertex>; 3]) -> HashSet<(usize, usize)> {
    let on_sides = || grid.iter().flatten().map(|vertex| vertex.index);
    let last = on_sides().max().unwrap_or(0);
    let mut is_on_side = vec![false; last + 1];
    for index in on_sides() {
        is_on_side[index] = true;
    }
    let triangles = indices.chunks_exact(3);
    let edges = triangles.flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])]);
    edges
        .map(|(a, b)| (usize::from(a.min(b)), usize::from(a.max(b))))
        .filter(|&(a, b)| is_on_side[a] && is_on_side[b])
        .collect()
}

fn border_vertex(patch: &Patch, cells: usize, at: GridVertex) -> BorderVertex {
    let floats = patch.vertices.len() / ((cells + 1) * (cells + 2) / 2);
    let vertex = &patch.vertices[at.index * floats..][..floats];
    let is_expanded = floats == 6;
    let position = [0, 1].map(|axis| {
        let step = if is_expanded {
            vertex[axis]
        } else {
            at.p as f32 * patch.legs[0][axis] + at.q as f32 * patch.legs[1][axis]
        };
        (patch.origin[axis] + f64::from(step)) as i64
    });
    let mut bits = [0; 7];
    let held = if is_expanded { &vertex[2..] } else { vertex };
    for (bits, value) in bits.iter_mut().zip(held) {
        *bits = value.to_bits();
    }
    bits[4] = patch
        .colours
        .as_ref()
        .map_or(0, |all| colour(all, cells, at));
    if let Some(births) = &patch.births {
        bits[5..].copy_from_slice(&births[at.index].map(f32::to_bits));
    }
    BorderVertex {
        key: key(position),
        bits,
        is_drawn: false,
    }
}

/// The colour of a vertex; of a texture with fewer texels than vertices none, since not every vertex has one.
fn colour(colours: &PatchColours, cells: usize, at: GridVertex) -> u32 {
    let side = colours.texture_side;
    if side == 0 {
        let own = &colours.bytes[4 * at.index..];
        return u32::from_be_bytes([own[0], own[1], own[2], own[3]]);
    }
    if side <= cells {
        return 0;
    }
    let [origin, p, q] = colours.texture_corners;
    let texel = [0, 1].map(|axis| {
        let along =
            |step: usize, end: [f32; 2]| step as f32 / cells as f32 * (end[axis] - origin[axis]);
        ((origin[axis] + along(at.p, p) + along(at.q, q)) * side as f32) as usize
    });
    let own = &colours.bytes[3 * (texel[1] * side + texel[0])..];
    u32::from_be_bytes([own[0], own[1], own[2], 255])
}

/// Whether a segment, along an axis or a diagonal, has a point in the open domain.
fn meets_domain(lattice: &Lattice, a: [i64; 2], b: [i64; 2]) -> bool {
    let ends = [
        i64::from(lattice.width()) - 1,
        i64::from(lattice.height()) - 1,
    ];
    let length = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
    // The part of 0..length that is inside, in steps of one along each axis that moves.
    let (mut first, mut last) = (0, length);
    for axis in 0..2 {
        match (b[axis] - a[axis]).signum() {
            0 if a[axis] <= 0 || a[axis] >= ends[axis] => return false,
            0 => {}
            1 => (first, last) = (first.max(-a[axis]), last.min(ends[axis] - a[axis])),
            _ => (first, last) = (first.max(a[axis] - ends[axis]), last.min(a[axis])),
        }
    }
    first < last
}
