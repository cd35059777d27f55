//! The leaf level as decoded, tile by tile, beside the samples that it stands for.

use super::descent::Descent;
use super::diagonals::Diagonals;
use super::plane::{Scratch, is_void};
use crate::Result;
use crate::codec::{Components, Matrix};
use crate::lattice::{Diamond, Lattice, centre_runs};
use crate::schedule::map_in_order;
use crate::vectors::widened;
use std::cell::OnceCell;

/// Samples along a tile's side, the last of which are the first of the next tile.
const TILE: i64 = 256;

/// A closed rectangle of samples.
pub(super) struct Tile {
    pub(super) first: [i64; 2],
    pub(super) last: [i64; 2],
    /// Decoded heights in units, row by row, component after component; meaningless at voids.
    heights: Vec<i32>,
    /// Row by row.
    voids: Vec<bool>,
    pub(super) any_void: bool,
    /// The samples as given: `[sample * bands + band]`, row by row.
    given: Vec<f64>,
    diagonals: OnceCell<Diagonals>,
}

/// How far decoded samples are from the given ones, in numbers of the raster.
#[derive(Clone, Copy, Default)]
pub(super) struct Deviation {
    pub(super) largest: f64,
    sum_of_squares: f64,
    count: u64,
}

impl Deviation {
    /// Takes in decoded numbers, which become errors. Their squares add up as one after the other would.
    fn add(&mut self, decoded: &mut [f64], given: &[f64]) {
        let (largest, are_whole) = subtract(decoded, given);
        let most = self.sum_of_squares + largest * largest * decoded.len() as f64;
        if are_whole && self.sum_of_squares.fract() == 0.0 && most < GREATEST_EXACT {
            self.sum_of_squares += sum_of_squares(decoded);
        } else {
            for error in &*decoded {
                self.sum_of_squares += error * error;
            }
        }
        self.largest = self.largest.max(largest);
        self.count += decoded.len() as u64;
    }

    fn merge(&mut self, other: Deviation) {
        self.largest = self.largest.max(other.largest);
        self.sum_of_squares += other.sum_of_squares;
        self.count += other.count;
    }

    /// Root of the mean square.
    pub(super) fn rms(&self) -> f64 {
        (self.sum_of_squares / self.count.max(1) as f64).sqrt()
    }
}

/// Shows every tile of a raster whose levels are all coded to `look`, and what it makes of them, in order, to
/// `consume`, with the count of its samples. Measures the error on the way.
pub(super) fn walk_tiles<T: Send>(
    descent: &Descent,
    components: &Components,
    threads: usize,
    look: impl Fn(&Tile) -> Result<T> + Sync,
    mut consume: impl FnMut(T, u64) -> Result<()>,
) -> Result<Deviation> {
    let lattice = descent.levels.lattice;
    let ends = [lattice.width(), lattice.height()].map(|side| i64::from(side) - 1);
    let [columns, rows] = ends.map(|end| (end as u64).div_ceil(TILE as u64) as usize);
    let work = |index: usize| {
        let at = [index % columns, index / columns];
        let first = at.map(|place| place as i64 * TILE);
        let last = [0, 1].map(|axis| (first[axis] + TILE).min(ends[axis]));
        let tile = Tile::new(descent, first, last)?;
        // The last row and column are the next tile's, unless there is none.
        let owned = [0, 1].map(|axis| last[axis] - i64::from(last[axis] < ends[axis]));
        let samples = (owned[0] - first[0] + 1) * (owned[1] - first[1] + 1);
        let deviation = tile.deviation(components, owned);
        Ok((look(&tile)?, deviation, samples as u64))
    };
    let mut all = Deviation::default();
    map_in_order(threads, columns * rows, work, |_, done| {
        let (made, deviation, samples) = done?;
        all.merge(deviation);
        consume(made, samples)
    })?;
    Ok(all)
}

impl Tile {
    fn new(descent: &Descent, first: [i64; 2], last: [i64; 2]) -> Result<Tile> {
        let plane = descent.levels.plane;
        let (width, height) = (last[0] - first[0] + 1, last[1] - first[1] + 1);
        let count = (width * height) as usize;
        let mut tile = Tile {
            first,
            last,
            heights: vec![0; descent.levels.components.count() * count],
            voids: Vec::new(),
            any_void: false,
            given: Vec::with_capacity(count * plane.bands),
            diagonals: OnceCell::new(),
        };
        let mut scratch = Scratch::default();
        for row in first[1]..=last[1] {
            let given = plane.read_row(row, first[0], width as usize, &mut scratch)?;
            tile.given.extend_from_slice(given);
        }
        tile.voids = tile.given.chunks_exact(plane.bands).map(is_void).collect();
        tile.any_void = tile.voids.contains(&true);
        tile.decode(descent)?;
        Ok(tile)
    }

    /// A tile of heights beside no samples, out of the vertices and centres, on the leaf level, of each diamond
    /// of the last refinable level, which have them all.
    pub(super) fn of_heights(
        lattice: &Lattice,
        [first, last]: [[i64; 2]; 2],
        mut matrices: impl FnMut(Diamond, &mut dyn FnMut(&Matrix, &Matrix)) -> Result<()>,
    ) -> Result<Tile> {
        let count = ((last[0] - first[0] + 1) * (last[1] - first[1] + 1)) as usize;
        let mut tile = Tile {
            first,
            last,
            heights: vec![0; count],
            voids: vec![false; count],
            any_void: false,
            given: Vec::new(),
            diagonals: OnceCell::new(),
        };
        let side = lattice.cells() + 1;
        for diamond in lattice.diamonds_around(lattice.levels() - 1, first, last) {
            matrices(diamond, &mut |vertices, centres| {
                tile.put_vertices(lattice, diamond, vertices, 0..side);
                tile.put_centres(lattice, diamond, centres);
            })?;
        }
        tile.any_void = tile.voids.contains(&true);
        Ok(tile)
    }

    /// The part of a tile of heights in a smaller rectangle.
    pub(super) fn part(&self, [first, last]: [[i64; 2]; 2]) -> Tile {
        let rows = || (first[1]..=last[1]).map(|row| self.index([first[0], row]));
        let width = (last[0] - first[0] + 1) as usize;
        let voids: Vec<bool> = rows()
            .flat_map(|start| self.voids[start..start + width].iter().copied())
            .collect();
        Tile {
            first,
            last,
            heights: rows()
                .flat_map(|start| self.heights[start..start + width].iter().copied())
                .collect(),
            any_void: voids.contains(&true),
            voids,
            given: Vec::new(),
            diagonals: OnceCell::new(),
        }
    }

    /// Gives a sample of a tile of heights another one; `None` makes it void.
    pub(super) fn set(&mut self, at: [i64; 2], height: Option<i32>) {
        let index = self.index(at);
        self.voids[index] = height.is_none();
        self.heights[index] = height.unwrap_or_default();
        self.any_void = self.any_void || height.is_none();
        self.diagonals.take();
    }

    /// The height of a sample; `None` for a void.
    pub(super) fn height(&self, at: [i64; 2]) -> Option<i32> {
        let index = self.index(at);
        (!self.voids[index]).then(|| self.heights[index])
    }

    /// Puts all heights that were decoded at their places, those of finer levels over those of coarser ones.
    fn decode(&mut self, descent: &Descent) -> Result<()> {
        let lattice = descent.levels.lattice;
        let side = lattice.cells() + 1;
        self.put_vertices(lattice, lattice.root(), &descent.root, 0..side);
        for level in 0..lattice.levels() {
            for diamond in lattice.diamonds_around(level, self.first, self.last) {
                let refined = descent.refined(diamond)?;
                self.put_centres(lattice, diamond, &refined.centres);
                if let Some(vertices) = &refined.vertices {
                    // Those on the boundary are of a coarser level.
                    self.put_vertices(lattice, diamond, vertices, 1..side - 1);
                }
            }
        }
        Ok(())
    }

    fn put_centres(&mut self, lattice: &Lattice, diamond: Diamond, centres: &Matrix) {
        let (cells, count) = (lattice.cells(), self.voids.len());
        for run in centre_runs(lattice.placement(diamond), cells) {
            let run = run.within(self.first[0], self.last[0]);
            let rows = self.first[1]..=self.last[1];
            let Some(run) = run.filter(|run| rows.contains(&run.row)) else {
                continue;
            };
            let start = self.index([run.column, run.row]);
            let own = centres.values.chunks_exact(cells * cells);
            for (heights, own) in self.heights.chunks_exact_mut(count).zip(own) {
                let places = heights[start..].iter_mut().step_by(run.step as usize);
                let own = own[run.index..].iter().step_by(run.stride).take(run.count);
                for (height, &decoded) in places.zip(own) {
                    *height = decoded;
                }
            }
            if let Some(valid) = &centres.valid {
                let places = self.voids[start..].iter_mut().step_by(run.step as usize);
                let own = valid[run.index..]
                    .iter()
                    .step_by(run.stride)
                    .take(run.count);
                for (is_void, &valid) in places.zip(own) {
                    *is_void = valid == 0;
                }
            }
        }
    }

    fn put_vertices(
        &mut self,
        lattice: &Lattice,
        diamond: Diamond,
        vertices: &Matrix,
        indices: std::ops::Range<usize>,
    ) {
        let placement = lattice.placement(diamond);
        let (side, count) = (lattice.cells() + 1, self.voids.len());
        for j in indices.clone() {
            for i in indices.clone() {
                let at = placement.vertex(i, j);
                if !self.contains(at) {
                    continue;
                }
                let index = self.index(at);
                let own = vertices.values.chunks_exact(side * side);
                for (heights, own) in self.heights.chunks_exact_mut(count).zip(own) {
                    heights[index] = own[j * side + i];
                }
                self.voids[index] = !vertices.is_valid(j * side + i);
            }
        }
    }

    fn contains(&self, at: [i64; 2]) -> bool {
        (0..2).all(|axis| (self.first[axis]..=self.last[axis]).contains(&at[axis]))
    }

    fn index(&self, [column, row]: [i64; 2]) -> usize {
        ((row - self.first[1]) * (self.last[0] - self.first[0] + 1) + column - self.first[0])
            as usize
    }

    /// Whether a sample of the tile is void.
    pub(super) fn is_void(&self, at: [i64; 2]) -> bool {
        self.voids[self.index(at)]
    }

    /// The sums of two decoded heights of a component, here and wherever else both step by step come to; `None` where either
    /// is void. Not to be followed beyond the tile.
    pub(super) fn sums(
        &self,
        component: usize,
        places: [[i64; 2]; 2],
        [column, row]: [i64; 2],
    ) -> impl Iterator<Item = Option<i64>> {
        let own = &self.heights[component * self.voids.len()..];
        let step = row * (self.last[0] - self.first[0] + 1) + column;
        let [one, other] = places.map(|at| self.index(at));
        (0..).map(move |count| {
            let ahead = (count * step) as isize;
            let ends = [one, other].map(|index| index.wrapping_add_signed(ahead));
            if self.any_void && ends.iter().any(|end| self.voids[*end]) {
                return None;
            }
            Some(ends.iter().map(|end| i64::from(own[*end])).sum())
        })
    }

    /// The decoded heights of a component in a row of the tile, from one column to another, both included.
    pub(super) fn heights(&self, component: usize, row: i64, columns: [i64; 2]) -> &[i32] {
        let own = &self.heights[component * self.voids.len()..];
        &own[self.index([columns[0], row])..=self.index([columns[1], row])]
    }

    /// The heights along diagonals.
    pub(super) fn diagonals(&self) -> &Diagonals {
        self.diagonals.get_or_init(|| {
            let sides = [0, 1].map(|axis| (self.last[axis] - self.first[axis] + 1) as usize);
            Diagonals::new(self.first, sides, &self.heights)
        })
    }

    /// How far the samples up to column and row `end` are from the given ones.
    fn deviation(&self, components: &Components, end: [i64; 2]) -> Deviation {
        let bands = self.given.len() / self.voids.len();
        let width = (end[0] - self.first[0] + 1) as usize;
        let mut deviation = Deviation::default();
        let mut decoded = vec![0.0; width * bands];
        for row in self.first[1]..=end[1] {
            let columns = [self.first[0], end[0]];
            components.to_samples(
                |component| self.heights(component, row, columns),
                &mut decoded,
            );
            let start = self.index([self.first[0], row]);
            let given = &self.given[start * bands..(start + width) * bands];
            if self.any_void && self.voids[start..start + width].contains(&true) {
                // A void is NaN in all bands.
                let both = decoded
                    .iter()
                    .zip(given)
                    .filter(|(_, given)| !given.is_nan());
                both.for_each(|(decoded, given)| deviation.add(&mut [*decoded], &[*given]));
            } else {
                deviation.add(&mut decoded, given);
            }
        }
        deviation
    }
}

/// Sums of integers up to here are exact in `f64`.
const GREATEST_EXACT: f64 = (1u64 << 53) as f64;
/// A sum with it has no bits for fractions.
const WHOLE: f64 = 1.5 * (1u64 << 52) as f64;

widened! {
    /// Replaces decoded numbers by their errors; the largest, and whether all are integers.
    fn subtract(decoded: &mut [f64], given: &[f64]) -> (f64, bool) {
        let (mut largest, mut are_whole) = (0.0, true);
        for (decoded, &given) in decoded.iter_mut().zip(given) {
            let error = (*decoded - given).abs();
            largest = if error > largest { error } else { largest };
            are_whole &= (error + WHOLE) - WHOLE == error;
            *decoded = error;
        }
        (largest, are_whole)
    }
}

widened! {
    /// A sum of squares in any order.
    fn sum_of_squares(numbers: &[f64]) -> f64 {
        let (chunks, rest) = numbers.as_chunks::<16>();
        let mut sums = [0.0; 16];
        for chunk in chunks {
            for (sum, number) in sums.iter_mut().zip(chunk) {
                *sum += number * number;
            }
        }
        let all = sums.iter().sum::<f64>();
        rest.iter().fold(all, |sum, number| sum + number * number)
    }
}
