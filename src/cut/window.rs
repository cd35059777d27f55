//! Reading a rectangle of samples at a level.

use super::layer::Layer;
use crate::codec::{Matrix, Refined, child_vertices};
use crate::lattice::Diamond;
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
/// # Errors
///
/// [`Error::Argument`] for a level or window outside the repository, or a buffer of another size; those of
/// reading and decoding blocks.
pub fn read_window(layer: &Layer, level: u32, window: Window, samples: &mut [f64]) -> Result<()> {
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
    };
    sweep.run(level)
}

/// A decode of all diamonds that a window needs, level by level.
struct Sweep<'a> {
    layer: &'a Layer,
    window: Window,
    step: i64,
    samples: &'a mut [f64],
}

impl Sweep<'_> {
    fn run(&mut self, level: u32) -> Result<()> {
        let lattice = self.layer.lattice();
        let root = self.layer.root();
        let (placement, side) = (lattice.placement(lattice.root()), lattice.cells() + 1);
        for index in 0..side * side {
            self.put(placement.vertex(index % side, index / side), root, index);
        }
        let mut coarser: HashMap<Diamond, (Matrix, Matrix)> = HashMap::new();
        for diamonds in self.needed(level) {
            let mut decoded = HashMap::with_capacity(diamonds.len());
            for diamond in diamonds {
                let vertices = if diamond == lattice.root() {
                    root.clone()
                } else {
                    let parents = lattice.parents(diamond).map(|parent| {
                        let (vertices, centres) = coarser.get(&parent?)?;
                        Some((vertices, centres))
                    });
                    child_vertices(lattice, diamond, parents)
                };
                let refined = self.layer.refine(diamond, &vertices)?;
                self.put_refined(diamond, &refined);
                decoded.insert(diamond, refined.into_matrices(vertices));
            }
            coarser = decoded;
        }
        Ok(())
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
        let components = self.layer.components();
        let bands = components.count();
        let sample = &mut self.samples[target * bands..(target + 1) * bands];
        if matrix.is_valid(index) {
            let entries = matrix.values.len() / bands;
            components.to_sample(
                |component| matrix.values[component * entries + index],
                sample,
            );
        } else {
            sample.fill(f64::NAN);
        }
    }
}
