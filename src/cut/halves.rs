//! Rays over ground where finer detail is missing: from half to half of what the finest possible cut draws.

use super::coarse::{CoarseHalf, half_triangle, matrix_indices, on_plane};
use super::course::Course;
use super::query::{Matrices, Query};
use super::source::DiamondSource;
use crate::lattice::Diamond;
use crate::{Error, Result};
use std::sync::Arc;

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
        let root = lattice.root();
        let [side, one, other] = half_triangle(lattice, root, 0);
        let ends = [one, other];
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
        let [tip, next, other] = half_triangle(lattice, diamond, part.half);
        let middle = [0, 1].map(|axis| (next[axis] + other[axis]) / 2.0);
        let children = lattice.split_half(diamond, part.half);
        let parts = course.split([tip, middle], next, part.interval);
        for (sign, interval) in parts.into_iter().flatten() {
            let Some((child, half)) = children[usize::from(sign < 0.0)] else {
                course.above = f64::NAN;
                continue;
            };
            let part = Part {
                diamond: child,
                half,
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
        let vertices = self.vertices_below(diamond, part.above);
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
