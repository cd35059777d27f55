//! Reading a rectangle of samples at a level.

use super::coarse::{CoarseHalf, matrix_indices};
use super::layer::Layer;
use crate::codec::{Matrix, Refined, child_vertices};
use crate::lattice::{Diamond, Placement};
use crate::{Error, Result};
use std::collections::{BTreeSet, HashMap};

/// A rectangle of a level's samples. Level 2K has all samples of the raster; a level two coarser
/// has every second one of every second row, from the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub column: u32,
    /// First row.
    pub row: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Which samples of a window are not what the level has, because detail is missing: they lie inside a diamond
/// that cannot be refined.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Coarse {
    /// One a sample, row by row; empty where none is coarse.
    marks: Vec<bool>,
    count: u64,
}

impl Coarse {
    /// How many.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether the sample `row * width + column` of the window is one.
    pub fn contains(&self, index: usize) -> bool {
        self.marks.get(index).is_some_and(|mark| *mark)
    }

    fn add(&mut self, index: usize, window: Window) {
        if self.marks.is_empty() {
            let length = window.width as usize * window.height as usize;
            self.marks = vec![false; length];
        }
        self.count += u64::from(!self.marks[index]);
        self.marks[index] = true;
    }
}

/// Samples from one of an even level to the next, in samples of the raster.
///
/// # Errors
///
/// [`Error::Argument`] for a level that is odd or finer than the repository.
pub fn level_step(layer: &Layer, level: u32) -> Result<u32> {
    let levels = layer.lattice().levels();
    if level % 2 == 1 || level > levels {
        return Err(Error::Argument(format!(
            "level {level} has no rows of samples: give an even one from 0 to {levels}"
        )));
    }
    Ok(1 << ((levels - level) / 2))
}

/// Columns and rows of samples at an even level.
///
/// # Errors
///
/// As [`level_step`].
pub fn level_size(layer: &Layer, level: u32) -> Result<[u32; 2]> {
    let step = level_step(layer, level)?;
    let lattice = layer.lattice();
    Ok([lattice.width(), lattice.height()].map(|side| (side - 1) / step + 1))
}

/// Fills `samples` (`width * height * bands`, row by row, `[column * bands + band]`) with a window of an even
/// level, in the raster's own units; NaN in all bands where the raster is void.
///
/// Where detail is missing since a repair, samples are those of the coarser triangles that remain, rounded to a
/// unit: within the stored error of their diamond, and half a unit, of what was lost. They are NaN where no such
/// triangle is drawn.
///
/// # Errors
///
/// [`Error::Argument`] for a level or window outside the repository, or a buffer of another size; those of
/// reading and decoding blocks.
pub fn read_window(
    layer: &Layer,
    level: u32,
    window: Window,
    samples: &mut [f64],
) -> Result<Coarse> {
    let step = i64::from(level_step(layer, level)?);
    let [columns, rows] = level_size(layer, level)?;
    let fits = |start: u32, length: u32, end: u32| {
        length > 0 && u64::from(start) + u64::from(length) <= u64::from(end)
    };
    if !fits(window.column, window.width, columns) || !fits(window.row, window.height, rows) {
        return Err(Error::Argument(format!(
            "the window of {} x {} samples at column {}, row {} is not inside level {level}, which has {columns} x {rows}",
            window.width, window.height, window.column, window.row
        )));
    }
    let bands = layer.components().count();
    let length = u64::from(window.width) * u64::from(window.height) * bands as u64;
    if samples.len() as u64 != length {
        return Err(Error::Argument(format!(
            "a buffer of {} numbers for a window of {} x {} samples, which has {length}",
            samples.len(),
            window.width,
            window.height
        )));
    }
    let mut sweep = Sweep {
        layer,
        window,
        step,
        samples,
        coarse: Coarse::default(),
    };
    sweep.run(level)?;
    Ok(sweep.coarse)
}

/// A decode of all diamonds that a window needs, level by level.
struct Sweep<'a> {
    layer: &'a Layer,
    window: Window,
    step: i64,
    samples: &'a mut [f64],
    coarse: Coarse,
}

impl Sweep<'_> {
    fn run(&mut self, level: u32) -> Result<()> {
        let lattice = self.layer.lattice();
        let root = self.layer.root();
        // What nothing is written to is void, or was and is missing.
        self.samples.fill(f64::NAN);
        let (placement, side) = (lattice.placement(lattice.root()), lattice.cells() + 1);
        for index in 0..side * side {
            self.put(placement.vertex(index % side, index / side), root, index);
        }
        let mut coarser: HashMap<Diamond, (Matrix, Matrix)> = HashMap::new();
        for diamonds in self.needed(level) {
            let mut decoded = HashMap::with_capacity(diamonds.len());
            for diamond in diamonds {
                let (vertices, halves) = if diamond == lattice.root() {
                    (root.clone(), [true; 2])
                } else {
                    let parents = lattice.parents(diamond).map(|parent| {
                        let (vertices, centres) = coarser.get(&parent?)?;
                        Some((vertices, centres))
                    });
                    let halves = parents.map(|parent| parent.is_some());
                    (child_vertices(lattice, diamond, parents), halves)
                };
                match self.refine(diamond, &vertices, halves)? {
                    Some(refined) => {
                        self.put_refined(diamond, &refined);
                        decoded.insert(diamond, refined.into_matrices(vertices));
                    }
                    None => self.put_coarse(diamond, &vertices, halves),
                }
            }
            coarser = decoded;
        }
        Ok(())
    }

    /// A diamond on the next level, whose `halves` came from refined parents; `None` where its detail is missing, or
    /// that of an ancestor.
    fn refine(
        &self,
        diamond: Diamond,
        vertices: &Matrix,
        halves: [bool; 2],
    ) -> Result<Option<Refined>> {
        if halves != self.layer.lattice().halves(diamond) {
            return Ok(None);
        }
        match self.layer.refine(diamond, vertices) {
            Ok(refined) => Ok(Some(refined)),
            Err(Error::Missing { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// For each level below `level`: the diamonds whose centres and inner vertices may lie in the window,
    /// and the parents of all finer ones.
    fn needed(&self, level: u32) -> Vec<BTreeSet<Diamond>> {
        let lattice = self.layer.lattice();
        let (left, top) = (i64::from(self.window.column), i64::from(self.window.row));
        let (width, height) = (i64::from(self.window.width), i64::from(self.window.height));
        let first = [left * self.step, top * self.step];
        let last = [
            (left + width - 1) * self.step,
            (top + height - 1) * self.step,
        ];
        let mut levels: Vec<BTreeSet<Diamond>> = Vec::new();
        for finer in (0..level).rev() {
            let mut set: BTreeSet<Diamond> = lattice
                .diamonds_around(finer, first, last)
                .into_iter()
                .collect();
            if let Some(children) = levels.last() {
                let parents = children.iter().flat_map(|&child| lattice.parents(child));
                set.extend(parents.flatten());
            }
            levels.push(set);
        }
        levels.reverse();
        levels
    }

    /// Writes the centres of a diamond, and its inner vertices where refining changed them.
    fn put_refined(&mut self, diamond: Diamond, refined: &Refined) {
        let lattice = self.layer.lattice();
        let (placement, cells) = (lattice.placement(diamond), lattice.cells());
        for index in 0..cells * cells {
            let at = placement.centre(index % cells, index / cells);
            self.put(at, &refined.centres, index);
        }
        let Some(vertices) = &refined.vertices else {
            return;
        };
        for j in 1..cells {
            for i in 1..cells {
                self.put(placement.vertex(i, j), vertices, j * (cells + 1) + i);
            }
        }
    }

    /// Marks the samples inside a diamond that cannot be refined, and writes those on the triangles of the halves
    /// that are there. Its own vertices have been written before.
    fn put_coarse(&mut self, diamond: Diamond, vertices: &Matrix, halves: [bool; 2]) {
        let lattice = self.layer.lattice();
        let placement = lattice.placement(diamond);
        let end = lattice.cells() as f64;
        let surfaces: Vec<CoarseHalf> = (0..2)
            .filter(|&half| halves[half])
            .map(|half| CoarseHalf::new(lattice, diamond, half, vertices))
            .collect();
        let [columns, rows] = self.samples_around(&placement, lattice.cells());
        for (row, column) in rows.flat_map(|row| columns.clone().map(move |column| (row, column))) {
            let at = [column, row].map(|along| (along * self.step) as f64);
            let [i, j] = matrix_indices(&placement, at);
            let place = |along: f64| (0.0..=end).contains(&along);
            if !place(i) || !place(j) {
                continue;
            }
            let (left, top) = (self.window.column, self.window.row);
            let target = (row - i64::from(top)) as usize * self.window.width as usize
                + (column - i64::from(left)) as usize;
            if i > 0.0 && j > 0.0 && i < end && j < end {
                self.coarse.add(target, self.window);
            }
            if i.fract() == 0.0 && j.fract() == 0.0 {
                continue;
            }
            for surface in surfaces.iter().filter(|surface| surface.contains([i, j])) {
                let Some(corners) = surface.corners([i, j]) else {
                    continue;
                };
                let entries = (lattice.cells() + 1) * (lattice.cells() + 1);
                self.write(target, |component| {
                    let height = |(index, weight): (usize, f64)| {
                        weight * f64::from(vertices.values[component * entries + index])
                    };
                    (corners.map(height).iter().sum::<f64>() + 0.5).floor() as i32
                });
            }
        }
    }

    /// Columns and rows of the level that are in the window and in the box around a diamond.
    fn samples_around(&self, placement: &Placement, cells: usize) -> [std::ops::Range<i64>; 2] {
        let corners =
            [(0, 0), (cells, 0), (cells, cells), (0, cells)].map(|(i, j)| placement.vertex(i, j));
        let window = [
            (self.window.column, self.window.width),
            (self.window.row, self.window.height),
        ];
        [0, 1].map(|axis| {
            let along = corners.map(|corner| corner[axis].div_euclid(self.step));
            let low = along.into_iter().fold(i64::MAX, i64::min);
            let high = along.into_iter().fold(i64::MIN, i64::max);
            let (start, length) = window[axis];
            let end = i64::from(start) + i64::from(length);
            low.max(i64::from(start))..(high + 1).min(end)
        })
    }

    /// Writes one decoded sample to its place, if that is in the window.
    fn put(&mut self, [column, row]: [i64; 2], matrix: &Matrix, index: usize) {
        let place = |at: i64, start: u32, length: u32| {
            let offset = at / self.step - i64::from(start);
            (at % self.step == 0 && (0..i64::from(length)).contains(&offset)).then_some(offset)
        };
        let column = place(column, self.window.column, self.window.width);
        let row = place(row, self.window.row, self.window.height);
        let (Some(column), Some(row)) = (column, row) else {
            return;
        };
        // The absent half of a half diamond lies outside the raster but for its hypotenuse, and what
        // is outside is never in a window.
        let target = row as usize * self.window.width as usize + column as usize;
        let bands = self.layer.components().count();
        if matrix.is_valid(index) {
            let entries = matrix.values.len() / bands;
            self.write(target, |component| {
                matrix.values[component * entries + index]
            });
        } else {
            self.samples[target * bands..(target + 1) * bands].fill(f64::NAN);
        }
    }

    /// Writes sample `target` of the window from the units of its components.
    fn write(&mut self, target: usize, unit: impl Fn(usize) -> i32) {
        let components = self.layer.components();
        let bands = components.count();
        let sample = &mut self.samples[target * bands..(target + 1) * bands];
        components.to_sample(unit, sample);
    }
}
