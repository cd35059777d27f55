//! Where edges of a diamond cross edges of the leaf level between samples.
//!
//! Two piecewise linear surfaces are farthest apart at vertices of one of them or where their edges cross. Vertices are
//! samples. Edges along rows and columns cross none between samples, and those at 45 degrees only in the middle of
//! leaf cells that are split the other way.

use super::leaf::Tile;
use crate::lattice::{Diamond, Lattice};
use std::ops::Range;

/// Edges of a diamond one after the other on a line at 45 degrees.
struct Chain {
    /// Matrix indices of the first vertex, and the step to the next.
    start: [i64; 2],
    step: [i64; 2],
    /// How many.
    edges: i64,
    /// Rows grow with columns.
    is_main: bool,
}

/// All chains of a diamond, with the samples' distances from vertex to vertex.
fn chains(lattice: &Lattice, diamond: Diamond) -> (Vec<Chain>, i64) {
    let cells = lattice.cells() as i64;
    let samples = lattice.placement(diamond).ax[0];
    if diamond.level() % 2 == 1 {
        // The sides of its cells.
        let sides = (0..=cells).flat_map(|line| {
            [true, false].map(|is_main| Chain {
                start: if is_main { [line, 0] } else { [0, line] },
                step: if is_main { [0, 1] } else { [1, 0] },
                edges: cells,
                is_main,
            })
        });
        return (sides.collect(), samples);
    }
    // The diagonals of its cells.
    let is_main = lattice.has_main_hypotenuse(diamond);
    let diagonals = (1 - cells..cells).map(|line| Chain {
        start: match is_main {
            true => [line.max(0), (-line).max(0)],
            false => [line.max(0), cells.min(cells + line)],
        },
        step: if is_main { [1, 1] } else { [1, -1] },
        edges: cells - line.abs(),
        is_main,
    });
    (diagonals.collect(), samples)
}

/// The largest distance between the leaf level in a tile and the triangles of a diamond with these vertices (of one
/// component) where their edges cross between samples.
pub(super) fn greatest_distance(
    lattice: &Lattice,
    diamond: Diamond,
    vertices: &[i32],
    (tile, component): (&Tile, usize),
) -> f64 {
    let (placement, side) = (lattice.placement(diamond), lattice.cells() + 1);
    let (chains, samples) = chains(lattice, diamond);
    let mut largest = 0;
    for chain in chains {
        let [i, j] = chain.start.map(|index| index as usize);
        let line = Line {
            first: placement.vertex(i, j),
            is_main: chain.is_main,
        };
        let (first, step) = (j * side + i, chain.step[1] * side as i64 + chain.step[0]);
        let own = Edges {
            vertices,
            first,
            step: step as isize,
            samples,
        };
        let mut cells = line.cells_in(tile, chain.edges * samples);
        while !cells.is_empty() {
            let run = line.run(lattice, cells.clone());
            cells.start = run.end;
            if lattice.has_main_leaf_cell(line.cell(run.start)) != line.is_main {
                let leaf = tile.sums(component, line.ends(run.start), line.step());
                largest = largest.max(own.greatest_difference(run, leaf));
            }
        }
    }
    largest as f64 / (2 * samples) as f64
}

/// The edges of a chain.
struct Edges<'a> {
    vertices: &'a [i32],
    /// Index of the first vertex, and the step to the next.
    first: usize,
    step: isize,
    /// From vertex to vertex, a power of two.
    samples: i64,
}

impl Edges<'_> {
    /// The largest `2 samples |distance|` in the middles of these cells, given the sums of the leaf level's two heights around
    /// each.
    fn greatest_difference(
        &self,
        cells: Range<i64>,
        leaf: impl Iterator<Item = Option<i64>>,
    ) -> i64 {
        let (shift, mask) = (self.samples.trailing_zeros(), self.samples - 1);
        let mut largest = 0;
        for (at, leaf) in cells.zip(leaf) {
            let Some(leaf) = leaf else { continue };
            let from = self
                .first
                .wrapping_add_signed((at >> shift) as isize * self.step);
            let [from, to] = [from, from.wrapping_add_signed(self.step)]
                .map(|index| i64::from(self.vertices[index]));
            let along = 2 * (at & mask) + 1;
            let own = 2 * self.samples * from + along * (to - from);
            largest = largest.max((self.samples * leaf - own).abs());
        }
        largest
    }
}

/// A line through samples at 45 degrees, followed from its first one to growing columns; rows grow too where it is main.
struct Line {
    first: [i64; 2],
    is_main: bool,
}

impl Line {
    /// From sample to sample.
    fn step(&self) -> [i64; 2] {
        [1, if self.is_main { 1 } else { -1 }]
    }

    /// The leaf cell that a step leads through: its first column and row.
    fn cell(&self, at: i64) -> [i64; 2] {
        let [column, row] = self.first;
        match self.is_main {
            true => [column + at, row + at],
            false => [column + at, row - at - 1],
        }
    }

    /// The two corners of that cell beside the line.
    fn ends(&self, at: i64) -> [[i64; 2]; 2] {
        let [column, row] = self.cell(at);
        match self.is_main {
            true => [[column + 1, row], [column, row + 1]],
            false => [[column, row], [column + 1, row + 1]],
        }
    }

    /// The steps, of `count`, through leaf cells of a tile.
    fn cells_in(&self, tile: &Tile, count: i64) -> Range<i64> {
        let ([left, top], [right, bottom]) = (tile.first, tile.last);
        let [column, row] = self.first;
        let (from, to) = match self.is_main {
            true => (top - row, bottom - row),
            false => (row - bottom, row - top),
        };
        let first = from.max(left - column).max(0);
        first..to.min(right - column).min(count)
    }

    /// The first of these steps, as long as all of their cells are split alike.
    fn run(&self, lattice: &Lattice, cells: Range<i64>) -> Range<i64> {
        let (block, [column, row]) = (lattice.cells() as i64, self.cell(cells.start));
        let along = |place: i64| place & (block - 1);
        let rows = match self.is_main {
            true => block - along(row),
            false => along(row) + 1,
        };
        let end = cells.start + rows.min(block - along(column));
        cells.start..end.min(cells.end)
    }
}
