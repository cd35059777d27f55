//! Ground beyond the finest data: the same triangles divided further, and detail of no data on them if that is wanted.

use super::source::{DiamondSource, Summary};
use crate::codec::{Matrix, Refined};
use crate::geo::{Frame, RasterInfo};
use crate::lattice::{Diamond, Lattice};
use crate::{Error, Result};
use std::sync::Arc;

/// The largest part of an edge's length by which detail moves its middle (thesis of Di Benedetto, 3.5).
pub const MOST_ROUGHNESS: f64 = 0.3;

/// Bits of a height, beside the sign, that are left for units finer than the data's and for detail.
const HEIGHT_BITS: u32 = 29;

/// Levels beyond those of the data. Their vertices are the samples and the middles between two of them; with some roughness
/// these middles are moved by an evenly distributed, zero-centred random height, which is a hash of their places: every
/// machine makes the same, whatever levels there are.
///
/// The error of a level is the most that finer ones move their middles. Where these split a cell the other way, its surface
/// moves as well, by at most half of `|a + c - b - d|` of the four samples around: as far as these do not tell what is
/// between them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Detail {
    /// How many, an even number.
    pub levels: u32,
    /// The most that a vertex is moved, up or down, as a part of the length of the edge that it divides, 0 to
    /// [`MOST_ROUGHNESS`].
    pub roughness: f64,
}

/// A source with levels beyond another one's. Its units are finer, so that middles are exact.
pub(super) struct Beyond {
    source: Arc<dyn DiamondSource>,
    lattice: Lattice,
    frame: Frame,
    /// log2 of its units in one of the source's.
    shift: u32,
    /// The most that vertices of each level beyond the data are moved, in units.
    amplitudes: Vec<i32>,
    /// The surface is moved by one unit more a level, where middles are rounded.
    is_rounded: bool,
    root: Matrix,
}

impl Beyond {
    /// # Errors
    ///
    /// [`Error::Argument`] for an odd number of levels, more than a lattice can have, a roughness that is not within its
    /// limits, and heights that leave no bits for detail.
    pub fn new(source: Arc<dyn DiamondSource>, detail: Detail) -> Result<Beyond> {
        if !(0.0..=MOST_ROUGHNESS).contains(&detail.roughness) {
            let roughness = detail.roughness;
            return Err(Error::Argument(format!(
                "a roughness of {roughness} is not within 0 and {MOST_ROUGHNESS}"
            )));
        }
        let lattice = source.lattice().finer(detail.levels)?;
        let finer = f64::from(1u32 << (detail.levels / 2));
        let own = source.frame();
        let frame = Frame {
            origin: own.origin,
            step: own.step.map(|step| step / finer),
        };
        let [low, high] = source.range().map(i64::from);
        let bits = 64 - low.abs().max(high.abs()).leading_zeros();
        let shift = HEIGHT_BITS.saturating_sub(bits).min(detail.levels);
        let [_, unit] = source.height_to_world();
        let unit = unit.abs() / f64::from(1u32 << shift);
        let amplitudes = amplitudes(&lattice, source.lattice().levels(), &frame, unit, detail);
        let reach: i64 = amplitudes.iter().map(|each| i64::from(*each) + 1).sum();
        if reach + (low.abs().max(high.abs()) << shift) >= 1 << 30 {
            return Err(Error::Argument(format!(
                "heights from {low} to {high} units leave no room for detail"
            )));
        }
        Ok(Beyond {
            root: shifted(source.root(), shift),
            source,
            lattice,
            frame,
            shift,
            is_rounded: shift < detail.levels || detail.roughness > 0.0,
            amplitudes,
        })
    }

    /// The most that all levels from this one on move the surface, in units.
    fn reach(&self, level: u32) -> i32 {
        let first = level.saturating_sub(self.data_levels()) as usize;
        let each = self.amplitudes[first..].iter();
        each.map(|most| most + i32::from(self.is_rounded)).sum()
    }

    /// Centres of a diamond of no data, between the nearest two of its vertices that are on a line with it: on the diagonal that
    /// is drawn, or at odd levels on the side of a cell of the level before. Valid where both are.
    fn divide(&self, diamond: Diamond, vertices: &Matrix) -> Matrix {
        let (cells, side) = (self.lattice.cells(), self.lattice.cells() + 1);
        let placement = self.lattice.placement(diamond);
        let amplitude = self.amplitudes[(diamond.level() - self.data_levels()) as usize];
        let diagonals = [[0, side + 1], [1, side]];
        let drawn = usize::from(!self.lattice.has_main_hypotenuse(diamond));
        let is_odd = diamond.level() % 2 == 1;
        let at = |index: usize| {
            let (i, j) = (index % cells, index / cells);
            // At odd levels one diagonal has the vertices of the level before, twice as far apart as columns here.
            let is_older = |along: i64| along & (2 * placement.ax[0] - 1) == 0;
            let diagonal = match is_odd {
                true => usize::from(!placement.vertex(i, j).into_iter().all(is_older)),
                false => drawn,
            };
            let ends = diagonals[diagonal].map(|end| j * side + i + end);
            (placement.centre(i, j), ends)
        };
        let middle = |index: usize| {
            let (place, ends) = at(index);
            let [a, b] = ends.map(|end| i64::from(vertices.values[end]));
            let place = place.map(|along| along * self.lattice.sample_step());
            (((a + b) >> 1) as i32).saturating_add(noise(place, amplitude))
        };
        let values = (0..cells * cells).map(middle).collect();
        if vertices.valid.is_none() {
            return Matrix {
                values,
                valid: None,
            };
        }
        let is_valid = |index: usize| {
            let (_, ends) = at(index);
            u8::from(ends.into_iter().all(|end| vertices.is_valid(end)))
        };
        Matrix::new(values, (0..cells * cells).map(is_valid).collect())
    }
}

impl DiamondSource for Beyond {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn data_levels(&self) -> u32 {
        self.source.data_levels()
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn georeference(&self) -> Option<&RasterInfo> {
        self.source.georeference()
    }

    fn height_to_world(&self) -> [f64; 2] {
        let [offset, scale] = self.source.height_to_world();
        [offset, scale / f64::from(1u32 << self.shift)]
    }

    fn has_voids(&self) -> bool {
        self.source.has_voids()
    }

    fn root(&self) -> &Matrix {
        &self.root
    }

    fn range(&self) -> [i32; 2] {
        let ([low, high], reach) = (self.source.range(), self.reach(0));
        [(low << self.shift) - reach, (high << self.shift) + reach]
    }

    fn summary(&self, diamond: Diamond, above: [i32; 2]) -> Result<Summary> {
        let reach = self.reach(diamond.level());
        if diamond.level() >= self.data_levels() {
            return Ok(Summary {
                error: f64::from(reach),
                range: above,
                is_missing: false,
            });
        }
        let [low, high] = above;
        let above = [low + reach, high - reach].map(|end| end >> self.shift);
        let own = self.source.summary(diamond, above)?;
        let [low, high] = own.range.map(|end| end << self.shift);
        Ok(Summary {
            error: own.error * f64::from(1u32 << self.shift) + f64::from(reach),
            range: [low - reach, high + reach],
            ..own
        })
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        if diamond.level() >= self.data_levels() {
            return Ok(Refined {
                vertices: None,
                centres: self.divide(diamond, vertices),
            });
        }
        let mut own = vertices.clone();
        own.values.iter_mut().for_each(|unit| *unit >>= self.shift);
        let refined = self.source.refine(diamond, &own)?;
        Ok(Refined {
            vertices: refined.vertices.map(|all| shifted(&all, self.shift)),
            centres: shifted(&refined.centres, self.shift),
        })
    }
}

fn shifted(matrix: &Matrix, shift: u32) -> Matrix {
    Matrix {
        values: matrix.values.iter().map(|unit| unit << shift).collect(),
        valid: matrix.valid.clone(),
    }
}

/// The most that vertices of each level from `first` on are moved, for units of this size in the world.
fn amplitudes(lattice: &Lattice, first: u32, frame: &Frame, unit: f64, detail: Detail) -> Vec<i32> {
    let step = frame.step[0].abs().min(frame.step[1].abs());
    let levels = first..lattice.levels();
    let amplitude = |level: u32| {
        // The hypotenuse of a cell, from the second finest level up: the samples' square in the root of 2 each.
        let edge = step * 2f64.powi((lattice.levels() - level) as i32).sqrt() * 2f64.sqrt();
        (detail.roughness * edge / unit) as i32
    };
    levels.map(amplitude).collect()
}

/// Evenly from -amplitude to amplitude, by a place in lattice units (the mixing function of SplitMix64, Steele, Lea and
/// Flood 2014).
fn noise([x, y]: [i64; 2], amplitude: i32) -> i32 {
    if amplitude == 0 {
        return 0;
    }
    let mut bits = (((x as u64) << 32) | y as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    bits ^= bits >> 31;
    let within = (u64::from(amplitude as u32) * 2 + 1) as u128;
    ((u128::from(bits) * within) >> 64) as i32 - amplitude
}
