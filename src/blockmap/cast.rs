//! Rays against one BlockMap: prisms over its texels, down to the floor of the city.
//!
//! Both casters walk the texels in the same order and compute every distance by the same expression, so that they agree bit
//! for bit. The exact one visits each texel (Amanatides and Woo 1987; thesis, ch. 4.2.2); the fast one passes over squares of texels
//! whose highest prism lies below the ray.

use super::layout::BlockMap;
use std::ops::Deref;

/// Most levels of squares of a block, the texels' own among them.
const LEVELS: usize = 8;
/// Levels below the highest at which a walk starts: most blocks have something high in every large square.
const FIRST_DESCENT: u32 = 3;

/// A half line in metres.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Where it goes; of any length above 0.
    pub direction: [f64; 3],
}

/// What a ray met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// In lengths of the ray's direction.
    pub distance: f64,
    /// The texel whose prism was met.
    pub texel: [u16; 2],
    /// Height of the place, in metres.
    pub height: f32,
    /// Whether it is a wall; else a roof or the ground.
    pub is_wall: bool,
}

/// Colour and shape at a hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// Share of the sky that it sees: 255 is all.
    pub occlusion: u8,
    /// Unit normal, about.
    pub normal: [f32; 3],
}

/// A BlockMap made ready for rays.
pub struct Caster<M> {
    map: M,
    /// Down to where the prisms reach.
    floor: f64,
    /// Heights row by row; then of squares of 2^level texels the greatest, level by level.
    heights: Vec<f32>,
    /// Where each level begins.
    starts: [usize; LEVELS],
    /// The level of one square.
    top_level: u32,
    /// Texels of a metre.
    per_metre: f64,
    /// Columns of walls, row by row.
    walls: Vec<u8>,
    /// Height of the steepest step of a roof.
    step: f32,
}

/// A ray with what all boxes ask of it.
pub(super) struct Beam {
    origin: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 3],
}

/// How a ray comes into the block.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Entry {
    /// Through a side.
    Side,
    /// From above, or it starts inside.
    Above,
}

/// A ray inside the block: x and y in texels and growing, z in metres.
struct Walk {
    origin: [f32; 3],
    direction: [f32; 3],
    inverse: [f32; 2],
    /// Infinite along an axis that the ray does not move along, whose lines it never crosses; else 0.
    never: [f32; 2],
    /// All ones along an axis that runs against the texels.
    mirror: [i32; 2],
    end: f32,
    entry: Entry,
    last: i32,
}

/// A hit along a walk.
#[derive(Clone, Copy)]
struct Met {
    distance: f32,
    texel: [i32; 2],
    height: f32,
    is_wall: bool,
}

impl<M: Deref<Target = BlockMap>> Caster<M> {
    /// For rays against a block whose prisms reach down to `floor`, in metres.
    pub fn new(map: M, floor: f64) -> Caster<M> {
        let mut heights = map.height_field();
        let mut starts = [0; LEVELS];
        let top_level = map.side_texels.ilog2();
        for level in 1..=top_level {
            let finer = starts[level as usize - 1];
            let (side, half) = (map.side_texels >> (level - 1), map.side_texels >> level);
            starts[level as usize] = heights.len();
            for index in 0..half * half {
                let first = finer + 2 * (index / half) * side + 2 * (index % half);
                let four = [first, first + 1, first + side, first + side + 1];
                let most = four.map(|at| heights[at]).into_iter();
                heights.push(most.fold(f32::NEG_INFINITY, f32::max));
            }
        }
        let side = map.side_texels;
        Caster {
            floor,
            heights,
            starts,
            top_level,
            per_metre: side as f64 / map.side,
            walls: (0..side * side)
                .map(|index| map.wall_column(index % side, index / side))
                .collect(),
            step: map.roof_slope * map.texel() as f32,
            map,
        }
    }

    /// The nearest hit, by a visit to every texel on the way.
    pub fn exact(&self, ray: &Ray) -> Option<Hit> {
        let (walk, start) = self.enter(&Beam::new(ray))?;
        let met = self.walk(&walk)?;
        Some(self.told(&walk, start, met))
    }

    /// The nearest hit; equal to [`exact`](Self::exact)'s.
    pub fn fast(&self, ray: &Ray) -> Option<Hit> {
        self.hit(&Beam::new(ray))
    }

    pub(super) fn hit(&self, beam: &Beam) -> Option<Hit> {
        let (walk, start) = self.enter(beam)?;
        let met = self.leap(&walk)?;
        Some(self.told(&walk, start, met))
    }

    /// The nearest hit in a quarter of the block: 0 south-west, 1 south-east, 2 north-west, 3 north-east.
    pub(super) fn hit_in_quarter(&self, beam: &Beam, quarter: u32) -> Option<Hit> {
        let side = 0.5 * self.map.side;
        let [east, north] = [quarter & 1, quarter >> 1].map(f64::from);
        let corner = [
            self.map.corner[0] + east * side,
            self.map.corner[1] + north * side,
        ];
        let (walk, start) = self.enter_square(beam, corner, side)?;
        let met = self.leap(&walk)?;
        Some(self.told(&walk, start, met))
    }

    /// What is at a hit.
    pub fn surface(&self, hit: &Hit) -> Surface {
        let map = &*self.map;
        let [column, row] = hit.texel.map(usize::from);
        let wall = map.wall_column(column, row);
        let (texel, normal) = if hit.is_wall {
            let [across, down] = map.wall_place(row, wall, hit.height);
            (map.at(across, down), map.wall_normal(row, wall))
        } else {
            (map.roof(column, row), map.roof_normal(column, row))
        };
        let [red, green, blue, occlusion] = texel;
        Surface {
            colour: [red, green, blue],
            occlusion,
            normal,
        }
    }

    /// Where the ray is inside the block, and its distance there; `None` if it never is.
    fn enter(&self, beam: &Beam) -> Option<(Walk, f64)> {
        self.enter_square(beam, self.map.corner, self.map.side)
    }

    #[inline]
    fn enter_square(&self, beam: &Beam, corner: [f64; 2], side: f64) -> Option<(Walk, f64)> {
        let top = f64::from(self.map.heights[1]).max(self.floor);
        let ([start, end], entry) = beam.span(corner, side, [self.floor, top])?;
        Some((self.walk_from(beam, start, end, entry), start))
    }

    #[inline]
    fn walk_from(&self, beam: &Beam, start: f64, end: f64, entry: Entry) -> Walk {
        let map = &*self.map;
        let side = map.side_texels as f32;
        let per_metre = self.per_metre;
        let mut walk = Walk {
            origin: [
                0.0,
                0.0,
                (beam.origin[2] + start * beam.direction[2]) as f32,
            ],
            direction: [0.0, 0.0, beam.direction[2] as f32],
            inverse: [0.0; 2],
            never: [0.0; 2],
            mirror: [0; 2],
            end: (end - start) as f32,
            entry,
            last: map.side_texels as i32 - 1,
        };
        for axis in 0..2 {
            let at = beam.origin[axis] + start * beam.direction[axis];
            let along = ((at - map.corner[axis]) * per_metre) as f32;
            let forward = (beam.direction[axis] * per_metre) as f32;
            let is_mirrored = forward < 0.0;
            walk.mirror[axis] = -i32::from(is_mirrored);
            walk.origin[axis] = if is_mirrored { side - along } else { along }.clamp(0.0, side);
            walk.direction[axis] = forward.abs();
            if forward == 0.0 {
                walk.never[axis] = f32::INFINITY;
            } else {
                walk.inverse[axis] = forward.abs().recip();
            }
        }
        walk
    }

    fn told(&self, walk: &Walk, start: f64, met: Met) -> Hit {
        let texel = walk.unmirrored(met.texel, 0).map(|along| along as u16);
        Hit {
            distance: start + f64::from(met.distance),
            texel,
            height: met.height,
            is_wall: met.is_wall,
        }
    }

    /// The greatest height in a square of a level, by the walk's own columns and rows.
    #[inline]
    fn greatest(&self, walk: &Walk, level: u32, square: [i32; 2]) -> f32 {
        let [column, row] = walk.unmirrored(square, level);
        let shift = self.top_level - level;
        self.heights[self.starts[level as usize] + ((row << shift) + column) as usize]
    }

    fn walk(&self, walk: &Walk) -> Option<Met> {
        let mut texel = walk.first();
        let (mut distance, mut entered) = (0.0, None);
        loop {
            let crossings = [0, 1].map(|axis| walk.crossing(axis, texel[axis] + 1));
            let leave = crossings[0].min(crossings[1]).min(walk.end);
            if let Some(met) = self.meet(walk, texel, distance, leave, entered) {
                return Some(met);
            }
            if leave >= walk.end {
                return None;
            }
            let axis = usize::from(crossings[0] > crossings[1]);
            texel[axis] += 1;
            if texel[axis] > walk.last {
                return None;
            }
            (distance, entered) = (leave, Some(axis));
        }
    }

    /// The hit inside one texel, which the ray enters and leaves at these distances, across a line of `entered`.
    fn meet(
        &self,
        walk: &Walk,
        texel: [i32; 2],
        distance: f32,
        leave: f32,
        entered: Option<usize>,
    ) -> Option<Met> {
        let top = self.greatest(walk, 0, texel);
        let height = walk.height(distance);
        if height <= top {
            let is_wall = self.has_wall(walk, texel) && self.is_steep(walk, texel, top, entered);
            return Some(Met {
                distance,
                texel,
                height,
                is_wall,
            });
        }
        (walk.height(leave) <= top).then(|| Met {
            distance: ((top - walk.origin[2]) / walk.direction[2]).clamp(distance, leave),
            texel,
            height: top,
            is_wall: false,
        })
    }

    fn has_wall(&self, walk: &Walk, texel: [i32; 2]) -> bool {
        let [column, row] = walk.unmirrored(texel, 0);
        self.walls[((row << self.top_level) + column) as usize] != 0
    }

    /// Whether the side of a texel that was met belongs to a wall.
    fn is_steep(&self, walk: &Walk, texel: [i32; 2], top: f32, entered: Option<usize>) -> bool {
        let Some(axis) = entered else {
            return walk.entry == Entry::Side;
        };
        let mut before = texel;
        before[axis] -= 1;
        top - self.greatest(walk, 0, before) > self.step
    }

    fn leap(&self, walk: &Walk) -> Option<Met> {
        let mut texel = walk.first();
        let mut level = self.top_level.saturating_sub(FIRST_DESCENT);
        let (mut distance, mut entered) = (0.0, None);
        let mut height = walk.height(distance);
        loop {
            let lines = texel.map(|along| ((along >> level) + 1) << level);
            let crossings = [0, 1].map(|axis| walk.crossing(axis, lines[axis]));
            let leave = crossings[0].min(crossings[1]).min(walk.end);
            let next = walk.height(leave);
            let square = texel.map(|along| along >> level);
            if height.min(next) <= self.greatest(walk, level, square) {
                if level > 0 {
                    level -= 1;
                    continue;
                }
                return self.meet(walk, texel, distance, leave, entered);
            }
            if leave >= walk.end {
                return None;
            }
            let axis = usize::from(crossings[0] > crossings[1]);
            if lines[axis] > walk.last {
                return None;
            }
            texel[axis] = lines[axis];
            if level > 0 {
                texel[1 - axis] = walk.beside(axis, leave, texel[1 - axis], lines[1 - axis] - 1);
            }
            (distance, height, entered) = (leave, next, Some(axis));
            // Only where it leaves the square above, which was too high to pass over.
            if lines[axis] & ((2 << level) - 1) == 0 && level < self.top_level {
                level += 1;
            }
        }
    }
}

impl Beam {
    pub(super) fn new(ray: &Ray) -> Beam {
        Beam {
            origin: ray.origin,
            direction: ray.direction,
            inverse: ray.direction.map(f64::recip),
        }
    }

    /// Numbers of quarters in an order in which no ray of this direction meets a later one before an earlier one.
    pub(super) fn order(&self) -> [u32; 4] {
        let first = [0, 1].map(|axis| u32::from(self.direction[axis] < 0.0));
        let first = first[0] + 2 * first[1];
        [first, first ^ 1, first ^ 2, first ^ 3]
    }

    /// From where to where it is in a box over a square, in lengths of its direction, and how it comes in; `None` if it never
    /// is. Boxes that touch agree bit for bit on where it passes from one to the other.
    #[inline]
    pub(super) fn span(
        &self,
        corner: [f64; 2],
        side: f64,
        heights: [f64; 2],
    ) -> Option<([f64; 2], Entry)> {
        let (mut start, mut end, mut entry) = (0.0f64, f64::INFINITY, Entry::Above);
        let [x, y] = corner.map(|low| [low, low + side]);
        for (axis, [low, high]) in [x, y, heights].into_iter().enumerate() {
            let origin = self.origin[axis];
            if self.direction[axis] == 0.0 {
                if !(low..=high).contains(&origin) {
                    return None;
                }
                continue;
            }
            let one = (low - origin) * self.inverse[axis];
            let other = (high - origin) * self.inverse[axis];
            let near = one.min(other);
            if near > start {
                start = near;
                entry = if axis == 2 { Entry::Above } else { Entry::Side };
            }
            end = end.min(one.max(other));
        }
        (start <= end && end.is_finite()).then_some(([start, end], entry))
    }
}

impl Walk {
    /// The texel in which it starts.
    fn first(&self) -> [i32; 2] {
        [0, 1].map(|axis| (self.origin[axis] as i32).min(self.last))
    }

    /// The distance at which it crosses a line between texels.
    #[inline]
    fn crossing(&self, axis: usize, line: i32) -> f32 {
        (line as f32 - self.origin[axis]) * self.inverse[axis] + self.never[axis]
    }

    #[inline]
    fn height(&self, distance: f32) -> f32 {
        self.origin[2] + distance * self.direction[2]
    }

    /// Where it is along the other axis when it crosses a line of `axis` at a distance: at least `low`, at most `high`. A line
    /// of x is crossed before one of y at the same distance.
    #[inline]
    fn beside(&self, axis: usize, distance: f32, low: i32, high: i32) -> i32 {
        let other = 1 - axis;
        let along = self.origin[other] + distance * self.direction[other];
        let is_past = |texel: i32| {
            let crossing = self.crossing(other, texel + 1);
            if axis == 0 {
                crossing < distance
            } else {
                crossing <= distance
            }
        };
        let mut texel = (along as i32).clamp(low, high);
        while texel < high && is_past(texel) {
            texel += 1;
        }
        while texel > low && !is_past(texel - 1) {
            texel -= 1;
        }
        texel
    }

    /// Column and row of the map's squares of a level out of the walk's.
    #[inline]
    fn unmirrored(&self, square: [i32; 2], level: u32) -> [i32; 2] {
        let last = self.last >> level;
        [0, 1].map(|axis| square[axis] ^ (self.mirror[axis] & last))
    }
}
