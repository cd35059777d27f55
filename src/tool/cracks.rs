//! Whether the buffers that a cut hands out fit together.

use crate::cut::Patch;
use crate::lattice::Lattice;

/// Counts the places where patches that cover the domain do not fit together to the bit:
///
/// - a border vertex whose height, slopes or normal differ in two patches that have it;
/// - a border segment with more than two triangles, or with one where another patch has a vertex inside
///   it (a T-junction);
/// - a border segment with one triangle inside the domain, unless `may_be_open` says that the other
///   side may be void. It gets the grid positions of the two ends.
///
/// Segments whose two ends are outside the raster may always be open: a coarse triangle without any
/// vertex in the raster is not drawn. All patches must be of one cut, in one vertex form.
pub fn count_cracks<'a>(
    patches: impl Iterator<Item = &'a Patch>,
    lattice: &Lattice,
    may_be_open: impl Fn([i64; 2], [i64; 2]) -> bool,
) -> u64 {
    let cells = lattice.cells();
    let borders = borders(cells);
    let (mut vertices, mut segments) = (Vec::new(), Vec::new());
    for patch in patches {
        add_border(patch, cells, &borders, &mut vertices, &mut segments);
    }
    vertices.sort_unstable();
    segments.sort_unstable();
    let differing = vertices
        .windows(2)
        .filter(|pair| pair[0].key == pair[1].key && pair[0].bits != pair[1].bits);
    let mut cracks = differing.count() as u64;
    let is_vertex = |key: u64| {
        vertices
            .binary_search_by_key(&key, |vertex| vertex.key)
            .is_ok()
    };
    for same in segments.chunk_by(|a, b| a == b) {
        let (a, b) = (place(same[0].0), place(same[0].1));
        let fits = match same.len() {
            2 => true,
            1 => {
                let middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
                let has_middle = (a[0] + b[0]) % 2 == 0 && (a[1] + b[1]) % 2 == 0;
                let is_junction = has_middle && is_vertex(key(middle));
                let is_edge =
                    !meets_domain(lattice, a, b) || !(lattice.in_raster(a) || lattice.in_raster(b));
                !is_junction && (is_edge || may_be_open(a, b))
            }
            _ => false,
        };
        cracks += u64::from(!fits);
    }
    cracks
}

/// A border vertex: its place and everything else it holds, to the bit.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct BorderVertex {
    key: u64,
    bits: [u32; 4],
}

/// Ends of a border segment, the lesser first.
type Segment = (u64, u64);

/// Grid positions are not negative and below 2^31, the lattice beginning at the first sample.
fn key([column, row]: [i64; 2]) -> u64 {
    (column as u64) << 32 | row as u64
}

fn place(key: u64) -> [i64; 2] {
    [(key >> 32) as i64, (key & 0xffff_ffff) as i64]
}

/// One vertex on a patch's border.
#[derive(Clone, Copy)]
struct Place {
    p: usize,
    q: usize,
    index: usize,
}

/// The three borders of a patch, each a chain of vertices: q = 0, p = 0, p + q = N.
fn borders(cells: usize) -> [Vec<Place>; 3] {
    let place = |p: usize, q: usize| Place {
        p,
        q,
        index: index(cells, p, q),
    };
    [
        (0..=cells).map(|p| place(p, 0)).collect(),
        (0..=cells).map(|q| place(0, q)).collect(),
        (0..=cells).map(|q| place(cells - q, q)).collect(),
    ]
}

fn index(cells: usize, p: usize, q: usize) -> usize {
    (0..q).map(|row| cells + 1 - row).sum::<usize>() + p
}

fn add_border(
    patch: &Patch,
    cells: usize,
    borders: &[Vec<Place>; 3],
    vertices: &mut Vec<BorderVertex>,
    segments: &mut Vec<Segment>,
) {
    let drawn = patch
        .indices
        .as_ref()
        .map(|indices| drawn_segments(indices, borders));
    for (number, border) in borders.iter().enumerate() {
        let found = border
            .iter()
            .map(|&place| border_vertex(patch, cells, place));
        let first = vertices.len();
        vertices.extend(found);
        for (step, ends) in vertices[first..].windows(2).enumerate() {
            if drawn.as_ref().is_none_or(|drawn| drawn[number][step]) {
                let (a, b) = (ends[0].key, ends[1].key);
                segments.push((a.min(b), a.max(b)));
            }
        }
    }
}

/// For each step along each border whether a triangle drawn has it for an edge.
fn drawn_segments(indices: &[u16], borders: &[Vec<Place>; 3]) -> [Vec<bool>; 3] {
    let edges: std::collections::HashSet<(usize, usize)> = indices
        .chunks_exact(3)
        .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
        .flat_map(|(a, b)| {
            [
                (usize::from(a), usize::from(b)),
                (usize::from(b), usize::from(a)),
            ]
        })
        .collect();
    [0, 1, 2].map(|number: usize| {
        let steps = borders[number].windows(2);
        steps
            .map(|ends| edges.contains(&(ends[0].index, ends[1].index)))
            .collect()
    })
}

fn border_vertex(patch: &Patch, cells: usize, place: Place) -> BorderVertex {
    let floats = patch.vertices.len() / ((cells + 1) * (cells + 2) / 2);
    let vertex = &patch.vertices[place.index * floats..][..floats];
    let (p, q) = (place.p as f64, place.q as f64);
    let position = [0, 1].map(|axis| {
        let step = if floats == 6 {
            f64::from(vertex[axis])
        } else {
            p * f64::from(patch.legs[0][axis]) + q * f64::from(patch.legs[1][axis])
        };
        (patch.origin[axis] + step) as i64
    });
    let held = if floats == 6 { &vertex[2..] } else { vertex };
    let mut bits = [0; 4];
    for (bits, value) in bits.iter_mut().zip(held) {
        *bits = value.to_bits();
    }
    BorderVertex {
        key: key(position),
        bits,
    }
}

/// Whether a segment, along an axis or a diagonal, has a point in the open domain.
fn meets_domain(lattice: &Lattice, a: [i64; 2], b: [i64; 2]) -> bool {
    let ends = [
        i64::from(lattice.width()) - 1,
        i64::from(lattice.height()) - 1,
    ];
    let length = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
    // The part 0..length of the segment that is inside, in steps of one along each moving axis.
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
