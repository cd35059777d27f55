//! The error of one diamond, found by looking only where it can be.

use super::Predecessor;
use super::changes::Changes;
use super::decoder::{Decoder, State};
use crate::Result;
use crate::build::leaf::Tile;
use crate::build::surface::{Finding, box_of, distance_to, look_at};
use crate::codec::ErrorCode;
use crate::lattice::Diamond;
use crate::schedule::Ranked;
use std::collections::{BinaryHeap, HashSet};

/// Looks for errors after a change.
pub(super) struct Search<'a> {
    old: &'a Predecessor<'a>,
    decoder: Decoder<'a>,
}

impl<'a> Search<'a> {
    pub(super) fn new(old: &'a Predecessor<'a>, changes: &'a Changes) -> Search<'a> {
        Search {
            old,
            decoder: Decoder::after(old, changes),
        }
    }

    /// The error code of a diamond, at least `least`, where `codes` are those of all finer ones. Over a descendant
    /// it is at most the distance from that one's triangles to the diamond's, and that one's error. Edges of the
    /// two meet at vertices and centres of the finer one, so that they are farthest apart at one of those.
    pub(super) fn largest(&mut self, diamond: Diamond, least: u8, codes: &[u8]) -> Result<u8> {
        let lattice = self.old.lattice;
        let own = self.decoder.state(diamond)?;
        let mut all = self.look_at_borders(diamond, &own)?;
        let mut code = least.max(ErrorCode::covering(all.error()).0);
        let mut seen = HashSet::from([diamond]);
        let mut open = BinaryHeap::from([Ranked {
            key: f64::INFINITY,
            item: diamond,
        }]);
        while let Some(Ranked { key, item: finer }) = open.pop() {
            if key <= ErrorCode(code).value() {
                break;
            }
            self.decoder.forget_many();
            if finer.level() + 1 == lattice.levels() {
                all.merge(self.look(diamond, &own, finer)?);
                code = least.max(ErrorCode::covering(all.error()).0);
                continue;
            }
            for child in lattice.children(finer).into_iter().flatten() {
                if !seen.insert(child) {
                    continue;
                }
                let state = self.decoder.state(child)?;
                let known = ErrorCode(codes[lattice.rank(child) as usize]).value();
                // What is drawn over a void is found by looking.
                let key = match state.vertices.valid {
                    Some(_) => f64::INFINITY,
                    None => known + self.distance(diamond, &own, (child, &state)),
                };
                open.push(Ranked { key, item: child });
            }
        }
        Ok(code)
    }

    /// What the outermost samples of the raster show of a diamond. Descendants that would only touch the raster
    /// do not exist, so that some of these samples lie in none.
    fn look_at_borders(&mut self, diamond: Diamond, own: &State) -> Result<Finding> {
        let lattice = self.old.lattice;
        let [right, bottom] = [lattice.width(), lattice.height()].map(|side| i64::from(side) - 1);
        let borders = [
            [[0, 0], [right, 0]],
            [[0, bottom], [right, bottom]],
            [[0, 0], [0, bottom]],
            [[right, 0], [right, bottom]],
        ];
        let has_voids = self.old.store.header().void_samples > 0;
        let mut all = Finding::default();
        for border in borders {
            if let Some(tile) = self.tile(border, box_of(lattice, diamond))? {
                all.merge(look_at(lattice, diamond, &own.vertices, &tile, has_voids));
            }
        }
        Ok(all)
    }

    /// What the leaf level in a diamond of the last refinable level shows of another one.
    fn look(&mut self, diamond: Diamond, own: &State, finer: Diamond) -> Result<Finding> {
        let lattice = self.old.lattice;
        let has_voids = self.old.store.header().void_samples > 0;
        let tile = self.tile(box_of(lattice, finer), box_of(lattice, diamond))?;
        let look = |tile: Tile| look_at(lattice, diamond, &own.vertices, &tile, has_voids);
        Ok(tile.map(look).unwrap_or_default())
    }

    /// The largest distance from the triangles of `finer` to those of a diamond, where both are.
    fn distance(&self, diamond: Diamond, own: &State, (finer, state): (Diamond, &State)) -> f64 {
        let lattice = self.old.lattice;
        let (placement, cells) = (lattice.placement(finer), lattice.cells());
        let side = cells + 1;
        let heights = &state.vertices.values;
        let vertices = heights.iter().enumerate();
        let vertices =
            vertices.map(|(index, &height)| (placement.vertex(index % side, index / side), height));
        let is_main = lattice.has_main_hypotenuse(finer);
        let centres = (0..cells * cells).flat_map(|index| {
            let (i, j) = (index % cells, index / cells);
            let [start, end] = if is_main { [0, side + 1] } else { [1, side] };
            let ends = [start, end].map(|offset| i64::from(heights[j * side + i + offset]));
            // The middle of the hypotenuse, rounded to either side.
            let sum = ends[0] + ends[1];
            let both = [sum >> 1, (sum + 1) >> 1].map(|height| height as i32);
            both.map(|height| (placement.centre(i, j), height))
        });
        let points = vertices.chain(centres);
        distance_to(lattice, (diamond, &own.vertices), points)
    }

    /// The leaf level in two boxes and the raster, if they meet.
    fn tile(&mut self, one: [[i64; 2]; 2], other: [[i64; 2]; 2]) -> Result<Option<Tile>> {
        let lattice = self.old.lattice;
        let ends = [lattice.width(), lattice.height()].map(|side| i64::from(side) - 1);
        let first = [0, 1].map(|axis| one[0][axis].max(other[0][axis]).max(0));
        let last = [0, 1].map(|axis| one[1][axis].min(other[1][axis]).min(ends[axis]));
        if first[0] > last[0] || first[1] > last[1] {
            return Ok(None);
        }
        self.decoder.tile([first, last]).map(Some)
    }
}
