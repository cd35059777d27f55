//! Where a ray meets the finest surface that there is.

use super::cache::Kept;
use super::course::{Course, Walk};
use super::overview::Overview;
use super::query::Query;
use super::source::DiamondSource;
use super::tile::{Crossing, Tile, outwards, pass};
use crate::lattice::Diamond;
use crate::{Error, Result};

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
        let is_finite = |[x, y, z]: [f64; 3]| x.is_finite() & y.is_finite() & z.is_finite();
        let is_bad = !is_finite(ray.origin)
            || !is_finite(ray.direction)
            || ray.direction == [0.0; 3]
            || ray.longest.is_nan()
            || ray.longest < 0.0;
        if is_bad {
            let text = "a ray needs finite numbers, a direction, and a length from 0 up";
            return Err(Error::Argument(text.into()));
        }
        let terrain = self.terrain();
        let (lattice, frame) = (terrain.lattice(), terrain.frame());
        let [x, y, z] = ray.origin;
        let step = [0, 1].map(|axis| ray.direction[axis] / frame.step[axis]);
        let mut course = Course::new(frame.world_to_grid(x, y), step, [z, ray.direction[2]]);
        let cells = [lattice.width(), lattice.height()].map(|count| count as i32 - 1);
        if course.pace == [f64::INFINITY; 2] {
            return self.meet_vertically(ray);
        }
        let mut overview = self.overview.take().unwrap_or_else(|| self.new_overview());
        let met = match course.clipped(cells.map(f64::from), overview.range, ray.longest) {
            Some(interval) => {
                let mut walk = Walk::new(&course, interval, cells);
                self.travel(&mut overview, &mut course, &mut walk)
            }
            None => Ok(None),
        };
        self.overview = Some(overview);
        let hit = met?.map(|(distance, level)| Hit {
            distance,
            place: [0, 1, 2].map(|axis| ray.origin[axis] + distance * ray.direction[axis]),
            level,
        });
        Ok(hit)
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

    /// Where the ray meets the surface, and the level. It goes from square to square, large ones as long as it passes above
    /// or below all that is in them, and over tiles cell by cell.
    fn travel(
        &mut self,
        overview: &mut Overview,
        course: &mut Course,
        walk: &mut Walk,
    ) -> Result<Option<(f64, u32)>> {
        let lattice = self.terrain().lattice();
        let (finest, levels) = (lattice.cells_log2(), lattice.levels());
        let coarsest = finest + levels / 2;
        let mut step = finest;
        while walk.is_over_raster() {
            let square = match overview.get(step, walk.cell) {
                Some(square) => *square,
                None => {
                    let range = self.square_range(step, walk.cell)?;
                    *overview.put(step, walk.cell, range)
                }
            };
            let exit = walk.steps(step).exit(course, walk);
            let mut over_column = exit.over_column;
            if !walk.passes(&exit, square.range) {
                if step > finest {
                    step -= 1;
                    continue;
                }
                match self.cross_tile(square.tile, overview, course, walk) {
                    Err(Error::Missing { .. }) => {
                        self.trim();
                        let met = self.meet_halves(course, [walk.t, exit.t])?;
                        if met.is_some() {
                            return Ok(met);
                        }
                        walk.go_on(&exit);
                        if exit.is_end {
                            return Ok(None);
                        }
                    }
                    crossing => match crossing? {
                        Crossing::Met(distance) => return Ok(Some((distance, levels))),
                        Crossing::Ended => return Ok(None),
                        Crossing::Left { over_column: over } => over_column = over,
                    },
                }
            } else if pass(course, walk, &exit) {
                return Ok(None);
            }
            let line = walk.advance(course, over_column, step);
            // The larger square is another one only beyond its own edge.
            if line > step && step < coarsest {
                step += 1;
            }
        }
        Ok(None)
    }

    /// Follows the ray over the tile that it is over, which is expected at this place.
    fn cross_tile(
        &mut self,
        expected: usize,
        overview: &mut Overview,
        course: &mut Course,
        walk: &mut Walk,
    ) -> Result<Crossing> {
        let step = self.terrain().lattice().cells_log2();
        let leaf = self.square(step, walk.cell);
        if let Some(tile) = self.cache.tile(expected, leaf) {
            return Ok(tile.cross(course, walk));
        }
        let place = match self.cache.place(leaf) {
            Some(place) => place,
            None => {
                let tile = self.build_tile(leaf)?;
                self.cache.put(leaf, Kept::Tile(tile))
            }
        };
        let cell = walk.cell;
        let Some(tile) = self.cache.tile(place, leaf) else {
            return Ok(Crossing::Ended);
        };
        let range = tile.range();
        let crossing = tile.cross(course, walk);
        if let Some(square) = overview.get(step, cell) {
            square.range = range;
            square.tile = place;
        }
        self.trim();
        Ok(crossing)
    }

    fn new_overview(&self) -> Box<Overview> {
        let terrain = self.terrain();
        Box::new(Overview::new(
            terrain.lattice(),
            self.world_hull(terrain.range()),
        ))
    }

    fn build_tile(&mut self, leaf: Diamond) -> Result<Tile> {
        let vertices = self.vertices(leaf)?;
        let lattice = self.terrain().lattice();
        let (cells, main) = (lattice.cells_log2(), lattice.has_main_hypotenuse(leaf));
        Ok(Tile::new(
            &vertices,
            cells,
            main,
            self.terrain().height_to_world(),
            |unit| self.world_height(unit),
        ))
    }

    /// The diamond whose square has 2^step cells a side and is around a cell.
    fn square(&self, step: u32, cell: [i32; 2]) -> Diamond {
        let half = (self.terrain().lattice().sample_step() << step) / 2;
        let [x, y] = cell.map(|along| (i64::from(along >> step) * 2 + 1) * half);
        Diamond::planar(x as i32, y as i32)
    }

    /// Least and greatest world z of all that is drawn in a square.
    fn square_range(&mut self, step: u32, cell: [i32; 2]) -> Result<[f32; 2]> {
        let square = self.square(step, cell);
        Ok(outwards(self.world_range(square)?))
    }

    /// World z of a height in units.
    pub(super) fn world_height(&self, unit: i32) -> f64 {
        let info = self.terrain().raster_info();
        info.value_offset + info.value_scale * self.terrain().units().to_sample(unit)
    }

    /// Least and greatest world z of all that is drawn for a diamond.
    pub(super) fn world_range(&mut self, diamond: Diamond) -> Result<[f64; 2]> {
        let range = self.range(diamond)?;
        Ok(self.world_hull(range))
    }

    fn world_hull(&self, range: [i32; 2]) -> [f64; 2] {
        let ends = range.map(|unit| self.world_height(unit));
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    }
}
