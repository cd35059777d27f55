//! Rays over ground where finer detail is missing: from half to half of what the finest possible cut draws.

use super::coarse::{CoarseHalf, matrix_indices};
use super::course::Course;
use super::query::{Matrices, Query};
use super::source::DiamondSource;
use crate::codec::{Matrix, child_vertices};
use crate::lattice::{Diamond, Placement};
use crate::{Error, Result};
use std::sync::Arc;

/// Corners of a matrix of one cell, in the order of a diamond's children: child k lies over the edge from corner k
/// to corner k + 1.
const CORNERS: [(usize, usize); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];
/// A half that the ray passes over, and what its vertices come from.
struct Part<'a> {
    diamond: Diamond,
    half: usize,
    /// Its parent, refined; `None` for the root.
    above: Option<&'a (Diamond, Arc<Matrices>)>,
    interval: [f64; 2],
}

impl Query {
    /// Where the ray meets what the finest possible cut draws over an interval, and the level.
    pub(super) fn meet_halves(
        &mut self,
        course: &mut Course,
        interval: [f64; 2],
    ) -> Result<Option<(f64, u32)>> {
        let terrain = self.terrain().clone();
        let lattice = terrain.lattice();
        let (root, placement) = (lattice.root(), lattice.placement(lattice.root()));
        let ends = [(0, 0), (1, 1)].map(|corner| corner_place(&placement, corner, lattice.cells()));
        let side = lattice.apexes(root)[0].corner(1);
        let side = corner_place(&placement, side, lattice.cells());
        for (sign, interval) in course.split(ends, side, interval).into_iter().flatten() {
            let part = Part {
                diamond: root,
                half: usize::from(sign < 0.0),
                above: None,
                interval,
            };
            if let Some(hit) = self.follow(course, part)? {
                return Ok(Some(hit));
            }
        }
        Ok(None)
    }

    /// Where the ray meets what is drawn over a half, and the level.
    fn follow(&mut self, course: &mut Course, part: Part) -> Result<Option<(f64, u32)>> {
        let terrain = self.terrain().clone();
        let (lattice, diamond) = (terrain.lattice(), part.diamond);
        let ends = part.interval.map(|t| course.height(t));
        let [low, high] = self.world_range(diamond)?;
        let clearance = course.clearance(part.interval);
        if ends[0].min(ends[1]) > high + clearance || ends[0].max(ends[1]) < low - clearance {
            course.above = f64::NAN;
            return Ok(None);
        }
        let refined = if diamond.level() == lattice.levels() {
            return self.march(course, &part);
        } else {
            match self.refined(diamond) {
                Err(Error::Missing { .. }) => return self.march(course, &part),
                refined => (diamond, refined?),
            }
        };
        self.trim();
        let placement = lattice.placement(diamond);
        let apex = lattice.apexes(diamond)[part.half].corner(1);
        let apex = (0..4).find(|&corner| CORNERS[corner] == apex).unwrap_or(0);
        let place = |corner: usize| corner_place(&placement, CORNERS[corner % 4], lattice.cells());
        let (tip, across, next) = (place(apex), place(apex + 2), place(apex + 1));
        let children = lattice.children(diamond);
        for (sign, interval) in course
            .split([tip, across], next, part.interval)
            .into_iter()
            .flatten()
        {
            let edge = if sign < 0.0 { apex + 3 } else { apex };
            let Some(child) = children[edge % 4] else {
                course.above = f64::NAN;
                continue;
            };
            let part = Part {
                diamond: child,
                half: usize::from(lattice.parents(child)[1] == Some(diamond)),
                above: Some(&refined),
                interval,
            };
            if let Some(hit) = self.follow(course, part)? {
                return Ok(Some(hit));
            }
        }
        Ok(None)
    }

    /// Looks at a half triangle by triangle.
    fn march(&mut self, course: &mut Course, part: &Part) -> Result<Option<(f64, u32)>> {
        let terrain = self.terrain().clone();
        let (lattice, diamond) = (terrain.lattice(), part.diamond);
        let vertices: Matrix = match part.above {
            Some((above, refined)) => {
                let matrices = (&refined.vertices, &refined.centres);
                let from = |parent| (parent == Some(*above)).then_some(matrices);
                child_vertices(lattice, diamond, lattice.parents(diamond).map(from))
            }
            None => terrain.root().clone(),
        };
        let surface = CoarseHalf::new(lattice, diamond, part.half, &vertices);
        let (placement, side) = (lattice.placement(diamond), lattice.cells() + 1);
        let at = |t: f64| matrix_indices(&placement, course.grid(t));
        let turns = turns(
            part.interval,
            part.interval.map(at),
            lattice.has_main_hypotenuse(diamond),
        );
        for pair in turns.windows(2) {
            let interval = [pair[0], pair[1]];
            let at = |t: f64| matrix_indices(&placement, course.grid(t));
            let Some(corners) = surface.corners(at((pair[0] + pair[1]) / 2.0)) else {
                course.above = f64::NAN;
                continue;
            };
            let corners = corners.map(|(index, _)| {
                let place = [(index % side) as f64, (index / side) as f64];
                (place, self.world_height(vertices.values[index]))
            });
            let above = interval.map(|t| course.height(t) - on_plane(&corners, at(t)));
            if let Some(distance) = course.meet(interval, above) {
                return Ok(Some((distance, diamond.level())));
            }
        }
        Ok(None)
    }
}

/// World position, in samples, of a corner of a diamond's matrix.
fn corner_place(placement: &Placement, (i, j): (usize, usize), cells: usize) -> [f64; 2] {
    placement
        .vertex(i * cells, j * cells)
        .map(|along| along as f64)
}

/// The ends of an interval and all places between at which a line crosses from triangle to triangle, in order. `ends` are
/// the matrix indices at its ends.
fn turns([from, to]: [f64; 2], ends: [[f64; 2]; 2], has_main_hypotenuse: bool) -> Vec<f64> {
    let mut turns = vec![from, to];
    let diagonal = ends.map(|[i, j]| if has_main_hypotenuse { i - j } else { i + j });
    let [columns, rows] = [0, 1].map(|axis| ends.map(|end| end[axis]));
    for [first, last] in [columns, rows, diagonal] {
        let (low, high) = (
            first.min(last).ceil() as i64,
            first.max(last).floor() as i64,
        );
        let crossing = |line: i64| from + (to - from) * (line as f64 - first) / (last - first);
        let lines = (low..=high).filter(|_| first != last);
        turns.extend(lines.map(crossing).filter(|t| (from..=to).contains(t)));
    }
    turns.sort_unstable_by(f64::total_cmp);
    turns
}

/// Height over a place of the plane through three corners.
fn on_plane(corners: &[([f64; 2], f64); 3], [i, j]: [f64; 2]) -> f64 {
    let [(a, height), (b, second), (c, third)] = *corners;
    let [u, v] = [b, c].map(|corner| [corner[0] - a[0], corner[1] - a[1]]);
    let (x, y) = (i - a[0], j - a[1]);
    let area = u[0] * v[1] - u[1] * v[0];
    let (beta, gamma) = ((x * v[1] - y * v[0]) / area, (u[0] * y - u[1] * x) / area);
    height + beta * (second - height) + gamma * (third - height)
}
