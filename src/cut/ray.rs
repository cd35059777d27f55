//! Where a ray meets the finest surface that there is.

use super::coarse::{CoarseHalf, matrix_indices};
use super::query::{Matrices, Query};
use super::source::DiamondSource;
use crate::codec::{Matrix, child_vertices};
use crate::lattice::{Diamond, Placement};
use crate::{Error, Result};
use std::sync::Arc;

/// Corners of a matrix of one cell, in the order of a diamond's children: child k lies over the edge from corner k
/// to corner k + 1.
const CORNERS: [(usize, usize); 4] = [(0, 0), (1, 0), (1, 1), (0, 1)];
/// Part of the heights' size by which a ray must pass above or below a range to be told apart from what is in it. Far
/// more than rounding errors come to, so that no ray slips between what is skipped and what is not.
const CLEARANCE: f64 = 1e-9;

/// A half line, or a part of one, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins.
    pub origin: [f64; 3],
    /// Where it goes; of any length above 0.
    pub direction: [f64; 3],
    /// It ends at `origin + longest * direction`; may be infinite.
    pub longest: f64,
}

/// The nearest place at which a ray meets the surface, from above or from below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The place is `origin + distance * direction`.
    pub distance: f64,
    /// World coordinates.
    pub place: [f64; 3],
    /// Level of the triangle that is met.
    pub level: u32,
}

/// A ray over the grid, and on which side of the surface it was seen last.
struct Course {
    /// Column and row at 0, and per unit.
    start: [f64; 2],
    step: [f64; 2],
    z: [f64; 2],
    /// Height above the surface where it was last looked at, if nothing but surface lay between.
    above: Option<f64>,
}

impl Course {
    fn grid(&self, t: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.start[axis] + t * self.step[axis])
    }

    fn height(&self, t: f64) -> f64 {
        self.z[0] + t * self.z[1]
    }

    /// Part of [0, longest] over a rectangle from the origin to `last`.
    fn clipped(&self, last: [f64; 2], longest: f64) -> Option<[f64; 2]> {
        let [mut from, mut to] = [0.0, longest];
        for (axis, last) in last.into_iter().enumerate() {
            if self.step[axis] == 0.0 {
                if !(0.0..=last).contains(&self.start[axis]) {
                    return None;
                }
                continue;
            }
            let ends = [0.0, last].map(|end| (end - self.start[axis]) / self.step[axis]);
            from = ends[0].min(ends[1]).max(from);
            to = ends[0].max(ends[1]).min(to);
        }
        (from <= to).then_some([from, to])
    }

    /// The parts of an interval on both sides of the line from `a` to `b`, in the order of the ray; the first number is
    /// positive on the side of `side`.
    fn split(&self, [a, b]: [[f64; 2]; 2], side: [f64; 2], [from, to]: [f64; 2]) -> Parts {
        let across = |p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
        let sign = across(side).signum();
        let [first, last] = [from, to].map(|t| sign * across(self.grid(t)));
        if first * last < 0.0 {
            let between = (from + (to - from) * first / (first - last)).clamp(from, to);
            return [Some((first, [from, between])), Some((last, [between, to]))];
        }
        let only = if first == 0.0 { last } else { first };
        [Some((only, [from, to])), None]
    }

    /// Looks at the surface between two places of one triangle, at which the ray is so high above it: where it meets it.
    fn meet(&mut self, [from, to]: [f64; 2], [first, last]: [f64; 2]) -> Option<f64> {
        let before = self.above.unwrap_or(first);
        self.above = Some(last);
        if first == 0.0 || (before > 0.0) != (first > 0.0) {
            return Some(from);
        }
        if last == 0.0 {
            return Some(to);
        }
        let between = from + (to - from) * first / (first - last);
        ((first > 0.0) != (last > 0.0)).then_some(between.clamp(from, to))
    }
}

type Parts = [Option<(f64, [f64; 2])>; 2];

/// A half that the ray passes over, and what its vertices come from.
struct Part<'a> {
    diamond: Diamond,
    half: usize,
    /// Its parent, refined; `None` for the root.
    above: Option<&'a (Diamond, Arc<Matrices>)>,
    interval: [f64; 2],
}

impl Query {
    /// The nearest place at which a ray meets the finest surface, or where detail is missing the triangles that the
    /// finest possible cut draws. `None` where it meets none: voids let rays through.
    ///
    /// No ray slips between triangles: along it the surface is continuous, and the ray is above it at one place and below
    /// it at the next, wherever the two are looked at.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for numbers that are not finite (but `longest`, which may be infinite), no direction or a
    /// negative `longest`; those of reading and decoding blocks.
    pub fn ray_intersect(&mut self, ray: &Ray) -> Result<Option<Hit>> {
        let numbers = ray.origin.iter().chain(&ray.direction);
        let is_bad = numbers.into_iter().any(|number| !number.is_finite())
            || ray.direction == [0.0; 3]
            || ray.longest.is_nan()
            || ray.longest < 0.0;
        if is_bad {
            let text = "a ray needs finite numbers, a direction, and a length from 0 up";
            return Err(Error::Argument(text.into()));
        }
        let terrain = self.terrain().clone();
        let (lattice, frame) = (terrain.lattice(), terrain.frame());
        let [x, y, z] = ray.origin;
        let mut course = Course {
            start: frame.world_to_grid(x, y),
            step: [0, 1].map(|axis| ray.direction[axis] / frame.step[axis]),
            z: [z, ray.direction[2]],
            above: None,
        };
        if course.step == [0.0; 2] {
            return self.meet_vertically(ray);
        }
        let last = [lattice.width() - 1, lattice.height() - 1].map(f64::from);
        let Some(interval) = course.clipped(last, ray.longest) else {
            return Ok(None);
        };
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
            if let Some((distance, level)) = self.follow(&mut course, part)? {
                let place = [0, 1, 2].map(|axis| ray.origin[axis] + distance * ray.direction[axis]);
                return Ok(Some(Hit {
                    distance,
                    place,
                    level,
                }));
            }
        }
        Ok(None)
    }

    /// Whether the straight line between two world places meets no surface but at its ends.
    ///
    /// # Errors
    ///
    /// Those of [`ray_intersect`](Self::ray_intersect).
    pub fn is_in_sight(&mut self, from: [f64; 3], to: [f64; 3]) -> Result<bool> {
        if from == to {
            return Ok(true);
        }
        // The ends may lie on the surface, where rounding puts them on either side.
        let margin = 1e-9;
        let at = |share: f64| [0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis]));
        let ray = Ray {
            origin: at(margin),
            direction: [0, 1, 2].map(|axis| to[axis] - from[axis]),
            longest: 1.0 - 2.0 * margin,
        };
        Ok(self.ray_intersect(&ray)?.is_none())
    }

    fn meet_vertically(&mut self, ray: &Ray) -> Result<Option<Hit>> {
        let [x, y, z] = ray.origin;
        let Some(found) = self.height_at_world(x, y)? else {
            return Ok(None);
        };
        let distance = (found.height - z) / ray.direction[2];
        let hit = Hit {
            distance,
            place: [x, y, found.height],
            level: found.level,
        };
        Ok((0.0..=ray.longest).contains(&distance).then_some(hit))
    }

    /// Where the ray meets what is drawn over a half, and the level.
    fn follow(&mut self, course: &mut Course, part: Part) -> Result<Option<(f64, u32)>> {
        let terrain = self.terrain().clone();
        let (lattice, diamond) = (terrain.lattice(), part.diamond);
        let ends = part.interval.map(|t| course.height(t));
        let [low, high] = self.world_range(diamond)?;
        let clearance = CLEARANCE * (1.0 + low.abs().max(high.abs()));
        if ends[0].min(ends[1]) > high + clearance || ends[0].max(ends[1]) < low - clearance {
            course.above = None;
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
                course.above = None;
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
                course.above = None;
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

    /// World z of a height in units.
    fn world_height(&self, unit: i32) -> f64 {
        let info = self.terrain().raster_info();
        info.value_offset + info.value_scale * self.terrain().units().to_sample(unit)
    }

    /// Least and greatest world z of all that is drawn for a diamond.
    fn world_range(&mut self, diamond: Diamond) -> Result<[f64; 2]> {
        let ends = self.range(diamond)?.map(|unit| self.world_height(unit));
        Ok([ends[0].min(ends[1]), ends[0].max(ends[1])])
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
