//! Least, greatest and mean height of the finest surface within a polygon.

use super::coarse::half_triangle;
use super::drawn::DrawnHalf;
use super::query::{Matrices, Query};
use super::source::DiamondSource;
use super::terrain::Terrain;
use super::trapezoids::{Trapezoid, trapezoids};
use crate::lattice::Diamond;
use crate::{Error, Result};
use std::ops::Range;
use std::sync::Arc;

/// How far away, in samples, a corner may be: products of distances must be finite.
const FARTHEST: f64 = 1e100;

/// What the finest surface is like within a polygon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaStatistics {
    /// Least physical height.
    pub minimum: f64,
    /// Greatest physical height.
    pub maximum: f64,
    /// The heights' integral over `area`, divided by it.
    pub mean: f64,
    /// World area, seen from above, of the part of the polygon that has a surface: in the raster and not void.
    pub area: f64,
    /// As [`Height::error_bound`](super::Height::error_bound), of the whole surface within the polygon and so of all
    /// three heights.
    pub error_bound: f64,
    /// The coarsest level that was read: the leaf level, but where detail is missing.
    pub level: u32,
}

impl Query {
    /// The finest surface within a polygon of three points or more, in world coordinates, in either direction and
    /// closed by itself; where detail is missing, the triangles that the finest possible cut draws. All is exact but for
    /// rounding errors: the triangles are clipped to the polygon. `None` where it has no surface.
    ///
    /// Decodes all diamonds around the polygon, neighbours after one another, whatever the byte limit; time also grows
    /// with the square of the number of points.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for fewer than three points, coordinates that are not finite or immensely large, and a polygon that
    /// crosses itself or encloses no area; those of reading and decoding blocks.
    pub fn area_statistics(&mut self, polygon: &[[f64; 2]]) -> Result<Option<AreaStatistics>> {
        let terrain = self.terrain().clone();
        let frame = terrain.frame();
        let grid: Vec<[f64; 2]> = polygon
            .iter()
            .map(|&[x, y]| frame.world_to_grid(x, y))
            .collect();
        let is_near = |along: &f64| along.abs() < FARTHEST;
        if grid.len() < 3 || !grid.iter().flatten().all(is_near) {
            let text = "a polygon needs three points or more, all of them finite and none immensely far away";
            return Err(Error::Argument(text.into()));
        }
        let parts = trapezoids(&grid)?;
        let parts: Vec<&Trapezoid> = parts.iter().collect();
        let mut sums = Sums::new(&terrain);
        let root = terrain.lattice().root();
        for half in 0..2 {
            self.visit((root, half), None, &parts, &mut sums)?;
        }
        if sums.area == 0.0 {
            return Ok(None);
        }
        Ok(Some(AreaStatistics {
            minimum: sums.minimum,
            maximum: sums.maximum,
            mean: (sums.volume / sums.area)
                .max(sums.minimum)
                .min(sums.maximum),
            area: sums.area * (frame.step[0] * frame.step[1]).abs(),
            error_bound: sums.error_bound,
            level: sums.level,
        }))
    }

    /// Adds what is drawn over a half within these parts. `above` is its parent, refined; `None` for the root.
    fn visit(
        &mut self,
        (diamond, half): (Diamond, usize),
        above: Option<&(Diamond, Arc<Matrices>)>,
        parts: &[&Trapezoid],
        sums: &mut Sums,
    ) -> Result<()> {
        let terrain = self.terrain().clone();
        let lattice = terrain.lattice();
        let triangle = half_triangle(lattice, diamond, half);
        let parts: Vec<&Trapezoid> = parts
            .iter()
            .copied()
            .filter(|part| sums.meets(part, triangle))
            .collect();
        if parts.is_empty() {
            return Ok(());
        }
        if diamond.level() < lattice.levels() {
            match self.refined(diamond) {
                Err(Error::Missing { .. }) => {}
                Err(error) => return Err(error),
                Ok(refined) => {
                    self.trim();
                    let above = (diamond, refined);
                    for child in lattice.split_half(diamond, half).into_iter().flatten() {
                        self.visit(child, Some(&above), &parts, sums)?;
                    }
                    return Ok(());
                }
            }
        }
        let vertices = self.vertices_below(diamond, above);
        let drawn = self.drawn(diamond, half, vertices)?;
        sums.add_half(&terrain, &drawn, triangle, &parts);
        Ok(())
    }
}

/// What has been added up, in square samples.
struct Sums {
    minimum: f64,
    maximum: f64,
    area: f64,
    volume: f64,
    error_bound: f64,
    level: u32,
    /// The raster: coarse triangles go beyond it.
    domain: Trapezoid,
    /// Corners of the last triangle that was clipped: column, row, height.
    clipped: Vec<[f64; 3]>,
    /// Room to clip in.
    other: Vec<[f64; 3]>,
}

impl Sums {
    fn new(terrain: &Terrain) -> Sums {
        let lattice = terrain.lattice();
        let last = [lattice.width() - 1, lattice.height() - 1].map(f64::from);
        Sums {
            minimum: f64::INFINITY,
            maximum: f64::NEG_INFINITY,
            area: 0.0,
            volume: 0.0,
            error_bound: 0.0,
            level: lattice.levels(),
            domain: Trapezoid::rectangle(last),
            clipped: Vec::new(),
            other: Vec::new(),
        }
    }

    /// Adds the triangles of a half, whose corners are `triangle`, within these parts.
    fn add_half(
        &mut self,
        terrain: &Terrain,
        drawn: &DrawnHalf,
        triangle: [[f64; 2]; 3],
        parts: &[&Trapezoid],
    ) {
        self.error_bound = self.error_bound.max(drawn.error_bound);
        self.level = self.level.min(drawn.level());
        let side = terrain.lattice().cells() + 1;
        let heights: Vec<f64> = (0..side * side)
            .map(|index| drawn.height(terrain, index))
            .collect();
        // Halves are added up apart, so that errors stay those of small sums.
        let (area, volume) = (self.area, self.volume);
        (self.area, self.volume) = (0.0, 0.0);
        if self.domain.has(&triangle) && parts.iter().any(|part| part.has(&triangle)) {
            self.add_whole(terrain, drawn, &heights);
        } else {
            for part in parts {
                let cells = cells_around(drawn, terrain, part);
                for indices in drawn.surface(terrain).triangles(cells) {
                    self.add_clipped(
                        part,
                        indices.map(|index| {
                            let [column, row] = drawn.place(index, side);
                            [column, row, heights[index]]
                        }),
                    );
                }
            }
        }
        self.area += area;
        self.volume += volume;
    }

    /// Adds all triangles of a half, by the heights of its vertices.
    fn add_whole(&mut self, terrain: &Terrain, drawn: &DrawnHalf, heights: &[f64]) {
        let cells = terrain.lattice().cells();
        let each = drawn.area_of_triangle();
        for indices in drawn.surface(terrain).triangles([0..cells, 0..cells]) {
            let corners = indices.map(|index| heights[index]);
            for height in corners {
                self.minimum = self.minimum.min(height);
                self.maximum = self.maximum.max(height);
            }
            self.area += each;
            self.volume += each * corners.iter().sum::<f64>() / 3.0;
        }
    }

    /// Adds what of a triangle is in a part.
    fn add_clipped(&mut self, part: &Trapezoid, corners: [[f64; 3]; 3]) {
        self.clip(part, corners);
        let (mut area, mut volume) = (0.0, 0.0);
        for triangle in fan(&self.clipped) {
            let each = area_of(triangle);
            area += each;
            volume += each * triangle.iter().map(|corner| corner[2]).sum::<f64>() / 3.0;
        }
        if area == 0.0 {
            return;
        }
        for [_, _, height] in &self.clipped {
            self.minimum = self.minimum.min(*height);
            self.maximum = self.maximum.max(*height);
        }
        self.area += area.abs();
        self.volume += volume * area.signum();
    }

    /// Whether a triangle and a part have any area in common.
    fn meets(&mut self, part: &Trapezoid, triangle: [[f64; 2]; 3]) -> bool {
        self.clip(part, triangle.map(|[column, row]| [column, row, 0.0]));
        fan(&self.clipped).any(|triangle| area_of(triangle) != 0.0)
    }

    /// Clips a triangle to a part and to the raster.
    fn clip(&mut self, part: &Trapezoid, corners: [[f64; 3]; 3]) {
        self.clipped.clear();
        self.clipped.extend(corners);
        part.clip(&mut self.clipped, &mut self.other);
        self.domain.clip(&mut self.clipped, &mut self.other);
    }
}

/// A convex ring as triangles.
fn fan(ring: &[[f64; 3]]) -> impl Iterator<Item = [&[f64; 3]; 3]> {
    let others = ring.get(1..).unwrap_or(&[]).windows(2);
    others.map(|pair| [&ring[0], &pair[0], &pair[1]])
}

/// Area over a triangle, negative for one of the two directions.
fn area_of([a, b, c]: [&[f64; 3]; 3]) -> f64 {
    ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
}

/// Columns and rows of a half's cells that may have something of a part.
fn cells_around(drawn: &DrawnHalf, terrain: &Terrain, part: &Trapezoid) -> [Range<usize>; 2] {
    let cells = terrain.lattice().cells();
    let indices = part.corners().map(|corner| drawn.indices(corner));
    [0, 1].map(|axis| {
        let along = indices.map(|indices| indices[axis]);
        let least = along.into_iter().fold(f64::INFINITY, f64::min).floor();
        let greatest = along.into_iter().fold(f64::NEG_INFINITY, f64::max).floor();
        // One more on each side, for rounding errors; the cast takes what is below 0 to 0.
        (least - 1.0) as usize..((greatest + 2.0).max(0.0) as usize).min(cells)
    })
}
