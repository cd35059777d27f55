//! Rays against one BlockMap: prisms over its texels, down to the floor of the city.
//!
//! Both casters walk the texels in the same order and compute every distance by the same expression, so that they agree bit
//! for bit. The exact one visits each texel (Amanatides and Woo 1987; thesis, ch. 4.2.2); the fast one passes over squares of texels
//! whose highest prism lies below the ray.

use super::layout::BlockMap;
use std::ops::Deref;

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
    /// Heights row by row; of squares of 2^level texels the greatest, level by level.
    levels: Vec<Vec<f32>>,
    /// Height of the steepest step of a roof.
    step: f32,
}

/// How a ray comes into the block.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Entry {
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
    /// Whether the axis runs against the texels.
    is_mirrored: [bool; 2],
    end: f32,
    entry: Entry,
    last: u32,
}

/// A hit along a walk.
#[derive(Clone, Copy)]
struct Met {
    distance: f32,
    texel: [u32; 2],
    height: f32,
    is_wall: bool,
}

impl<M: Deref<Target = BlockMap>> Caster<M> {
    /// For rays against a block whose prisms reach down to `floor`, in metres.
    pub fn new(map: M, floor: f64) -> Caster<M> {
        let mut levels = vec![map.height_field()];
        let mut side = map.side_texels;
        while side > 1 {
            let finer = &levels[levels.len() - 1];
            let half = side / 2;
            let texels = (0..half * half).map(|index| {
                let first = 2 * (index / half) * side + 2 * (index % half);
                let four = [first, first + 1, first + side, first + side + 1];
                four.iter()
                    .fold(f32::NEG_INFINITY, |most, &at| most.max(finer[at]))
            });
            levels.push(texels.collect());
            side = half;
        }
        Caster {
            floor,
            levels,
            step: map.roof_slope * map.texel() as f32,
            map,
        }
    }

    /// The nearest hit, by a visit to every texel on the way.
    pub fn exact(&self, ray: &Ray) -> Option<Hit> {
        let (walk, start) = self.enter(ray)?;
        let met = self.walk(&walk)?;
        Some(self.told(&walk, start, met))
    }

    /// The nearest hit; equal to [`exact`](Self::exact)'s.
    pub fn fast(&self, ray: &Ray) -> Option<Hit> {
        let (walk, start) = self.enter(ray)?;
        let met = self.leap(&walk)?;
        Some(self.told(&walk, start, met))
    }

    /// The nearest hit in a quarter of the block: 0 south-west, 1 south-east, 2 north-west, 3 north-east.
    pub fn fast_in_quarter(&self, ray: &Ray, quarter: u32) -> Option<Hit> {
        let side = 0.5 * self.map.side;
        let [east, north] = [quarter & 1, quarter >> 1].map(f64::from);
        let corner = [
            self.map.corner[0] + east * side,
            self.map.corner[1] + north * side,
        ];
        let (walk, start) = self.enter_square(ray, corner, side)?;
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
    fn enter(&self, ray: &Ray) -> Option<(Walk, f64)> {
        self.enter_square(ray, self.map.corner, self.map.side)
    }

    fn enter_square(&self, ray: &Ray, corner: [f64; 2], side: f64) -> Option<(Walk, f64)> {
        let top = f64::from(self.map.heights[1]).max(self.floor);
        let ([start, end], entry) = span(ray, corner, side, [self.floor, top])?;
        Some((self.walk_from(ray, start, end, entry), start))
    }

    fn walk_from(&self, ray: &Ray, start: f64, end: f64, entry: Entry) -> Walk {
        let (map, side) = (&*self.map, self.map.side_texels as f32);
        let per_metre = map.side_texels as f64 / map.side;
        let (mut origin, mut direction) = ([0.0f32; 3], [0.0f32; 3]);
        let mut is_mirrored = [false; 2];
        for axis in 0..3 {
            let at = ray.origin[axis] + start * ray.direction[axis];
            if axis == 2 {
                (origin[2], direction[2]) = (at as f32, ray.direction[2] as f32);
                continue;
            }
            let along = ((at - map.corner[axis]) * per_metre) as f32;
            let forward = (ray.direction[axis] * per_metre) as f32;
            is_mirrored[axis] = forward < 0.0;
            let along = if is_mirrored[axis] {
                side - along
            } else {
                along
            };
            origin[axis] = along.clamp(0.0, side);
            direction[axis] = forward.abs();
        }
        Walk {
            origin,
            direction,
            inverse: [direction[0].recip(), direction[1].recip()],
            is_mirrored,
            end: (end - start) as f32,
            entry,
            last: map.side_texels as u32 - 1,
        }
    }

    fn told(&self, walk: &Walk, start: f64, met: Met) -> Hit {
        let texel = [0, 1].map(|axis| walk.unmirrored(axis, met.texel[axis], 0) as u16);
        Hit {
            distance: start + f64::from(met.distance),
            texel,
            height: met.height,
            is_wall: met.is_wall,
        }
    }

    /// The greatest height in a square of a level, by the walk's own columns and rows.
    fn greatest(&self, walk: &Walk, level: u32, [column, row]: [u32; 2]) -> f32 {
        let side = self.map.side_texels as u32 >> level;
        let column = walk.unmirrored(0, column, level);
        let row = walk.unmirrored(1, row, level);
        self.levels[level as usize][(row * side + column) as usize]
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
        texel: [u32; 2],
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

    fn has_wall(&self, walk: &Walk, texel: [u32; 2]) -> bool {
        let [column, row] = [0, 1].map(|axis| walk.unmirrored(axis, texel[axis], 0) as usize);
        self.map.wall_column(column, row) != 0
    }

    /// Whether the side of a texel that was met belongs to a wall.
    fn is_steep(&self, walk: &Walk, texel: [u32; 2], top: f32, entered: Option<usize>) -> bool {
        let Some(axis) = entered else {
            return walk.entry == Entry::Side;
        };
        let mut before = texel;
        before[axis] -= 1;
        top - self.greatest(walk, 0, before) > self.step
    }

    fn leap(&self, walk: &Walk) -> Option<Met> {
        let top_level = self.levels.len() as u32 - 1;
        let mut texel = walk.first();
        let mut level = top_level;
        let (mut distance, mut entered) = (0.0, None);
        loop {
            let square = texel.map(|along| along >> level);
            let lines = square.map(|along| (along + 1) << level);
            let crossings = [0, 1].map(|axis| walk.crossing(axis, lines[axis]));
            let leave = crossings[0].min(crossings[1]).min(walk.end);
            if walk.height(distance).min(walk.height(leave)) <= self.greatest(walk, level, square) {
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
            texel[1 - axis] = walk.beside(axis, leave, texel[1 - axis], lines[1 - axis] - 1);
            (distance, entered) = (leave, Some(axis));
            level = (level + 1).min(top_level);
        }
    }
}

/// From where to where a ray is in a box over a square, in lengths of its direction, and how it comes in; `None` if it never is.
/// Boxes that touch agree bit for bit on where the ray passes from one to the other.
pub fn span(
    ray: &Ray,
    corner: [f64; 2],
    side: f64,
    heights: [f64; 2],
) -> Option<([f64; 2], Entry)> {
    let (mut start, mut end, mut entry) = (0.0f64, f64::INFINITY, Entry::Above);
    for axis in 0..3 {
        let [low, high] = match axis {
            2 => heights,
            _ => [corner[axis], corner[axis] + side],
        };
        let (origin, direction) = (ray.origin[axis], ray.direction[axis]);
        if direction == 0.0 {
            if !(low..=high).contains(&origin) {
                return None;
            }
            continue;
        }
        let one = (low - origin) / direction;
        let other = (high - origin) / direction;
        let near = one.min(other);
        if near > start {
            start = near;
            entry = if axis == 2 { Entry::Above } else { Entry::Side };
        }
        end = end.min(one.max(other));
    }
    (start <= end && end.is_finite()).then_some(([start, end], entry))
}

impl Walk {
    /// The texel in which it starts.
    fn first(&self) -> [u32; 2] {
        [0, 1].map(|axis| (self.origin[axis] as u32).min(self.last))
    }

    /// The distance at which it crosses a line between texels.
    fn crossing(&self, axis: usize, line: u32) -> f32 {
        if self.direction[axis] == 0.0 {
            return f32::INFINITY;
        }
        (line as f32 - self.origin[axis]) * self.inverse[axis]
    }

    fn height(&self, distance: f32) -> f32 {
        self.origin[2] + distance * self.direction[2]
    }

    /// Where it is along the other axis when it crosses a line of `axis` at a distance: at least `low`, at most `high`. A line
    /// of x is crossed before one of y at the same distance.
    fn beside(&self, axis: usize, distance: f32, low: u32, high: u32) -> u32 {
        let other = 1 - axis;
        let along = self.origin[other] + distance * self.direction[other];
        let is_past = |texel: u32| {
            let crossing = self.crossing(other, texel + 1);
            if axis == 0 {
                crossing < distance
            } else {
                crossing <= distance
            }
        };
        let mut texel = (along as u32).clamp(low, high);
        while texel < high && is_past(texel) {
            texel += 1;
        }
        while texel > low && !is_past(texel - 1) {
            texel -= 1;
        }
        texel
    }

    /// A column or row of the map's squares of a level out of the walk's.
    fn unmirrored(&self, axis: usize, along: u32, level: u32) -> u32 {
        if self.is_mirrored[axis] {
            (self.last >> level) - along
        } else {
            along
        }
    }
}
