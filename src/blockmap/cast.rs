//! Rays against one BlockMap: prisms over its texels, down to the floor of the city.
//!
//! Both casters walk the texels in the same order and compute every distance by the same expression, so that they agree bit
//! for bit. The exact one visits each texel (Amanatides and Woo 1987; thesis, ch. 4.2.2); the fast one ([`leap`](super::leap)) passes
//! over squares of texels whose highest prism lies below the ray.

use super::beams::{Beams, Floats, LANES, Ray, Spans, Square, narrow, packets, select};
use super::layout::BlockMap;
use std::ops::Deref;

/// Texels along a square that the fast caster passes over.
pub(super) const SQUARE: usize = 8;
/// Greatest distance between two lines of texels, along a ray that hardly crosses them.
const FARTHEST: f32 = 1e30;

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
    /// Row by row, in metres; as many as a power of two, as are the squares.
    pub(super) heights: Vec<f32>,
    /// The greatest heights of squares, row by row.
    pub(super) squares: Vec<f32>,
    /// Texels of a metre.
    per_metre: f64,
    /// Height of the steepest step of a roof.
    step: f32,
}

/// x or y of rays inside a block, in texels, mirrored so that they grow.
#[derive(Clone, Copy)]
pub(super) struct Axis {
    pub(super) origin: Floats,
    pub(super) direction: Floats,
    /// The distance at which a line is crossed is line * inverse + offset.
    pub(super) inverse: Floats,
    pub(super) offset: Floats,
    pub(super) is_mirrored: Floats,
}

/// Rays inside a block, from where they come in.
pub(super) struct Walks {
    pub(super) x: Axis,
    pub(super) y: Axis,
    /// Height in metres.
    pub(super) origin: Floats,
    pub(super) direction: Floats,
    pub(super) end: Floats,
}

/// A ray in the texel whose prism it meets.
#[derive(Clone, Copy)]
pub(super) struct Meeting {
    /// Which texel.
    pub(super) index: i32,
    /// The texel before; below 0 where it is the ray's first.
    pub(super) before: i32,
    /// Where it comes in and leaves.
    pub(super) distance: f32,
    pub(super) leave: f32,
}

impl<M: Deref<Target = BlockMap>> Caster<M> {
    /// For rays against a block whose prisms reach down to `floor`, in metres.
    pub fn new(map: M, floor: f64) -> Caster<M> {
        let heights = map.height_field();
        let side = map.side_texels;
        let across = side / SQUARE;
        let mut squares = vec![f32::NEG_INFINITY; across * across];
        for (index, height) in heights.iter().enumerate() {
            let [column, row] = [index % side, index / side].map(|along| along / SQUARE);
            let square = &mut squares[row * across + column];
            *square = square.max(*height);
        }
        Caster {
            floor,
            heights,
            squares,
            per_metre: side as f64 / map.side,
            step: map.roof_slope * map.texel() as f32,
            map,
        }
    }

    /// The nearest hit, by a visit to every texel on the way.
    pub fn exact(&self, ray: &Ray) -> Option<Hit> {
        let beams = Beams::new(&[*ray; LANES]);
        let spans = beams.spans(self.square(), self.heights_range());
        if spans.meets.to_bitmask() == 0 {
            return None;
        }
        let walks = self.walks(&beams, &spans);
        let meeting = self.walk(&walks)?;
        Some(self.told((&beams, &spans, &walks), 0, meeting))
    }

    /// The nearest hit; equal to [`exact`](Self::exact)'s.
    pub fn fast(&self, ray: &Ray) -> Option<Hit> {
        let mut found = None;
        self.fast_each(&[*ray], |_, hit| found = hit);
        found
    }

    /// The nearest hits of many rays, one by one with their numbers: as [`fast`](Self::fast), and several times as fast where
    /// neighbours go almost the same way.
    pub fn fast_each(&self, rays: &[Ray], mut found: impl FnMut(usize, Option<Hit>)) {
        for (number, (rays, count)) in packets(rays).enumerate() {
            let mut hits = [None; LANES];
            self.packet(
                &Beams::new(&rays),
                self.square(),
                !Floats::ZERO,
                |lane, hit| {
                    hits[lane] = Some(hit);
                },
            );
            for (lane, hit) in hits.into_iter().take(count).enumerate() {
                found(number * LANES + lane, hit);
            }
        }
    }

    /// Tells the nearest hits, of `lanes` only, in the block or in a quarter of it; gives the lanes that have one.
    #[inline(always)]
    pub(super) fn packet(
        &self,
        beams: &Beams,
        square: Square,
        lanes: Floats,
        mut tell: impl FnMut(usize, Hit),
    ) -> Floats {
        let spans = beams.spans(square, self.heights_range());
        let lanes = spans.meets & lanes;
        if !lanes.any() {
            return lanes;
        }
        let walks = self.walks(beams, &spans);
        self.leap(&walks, lanes, |lane, meeting| {
            tell(lane, self.told((beams, &spans, &walks), lane, meeting));
        })
    }

    /// What is at a hit.
    #[inline]
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

    pub(super) fn side_texels(&self) -> usize {
        self.map.side_texels
    }

    /// All of the block.
    pub(super) fn square(&self) -> Square {
        (self.map.corner, self.map.side)
    }

    /// A quarter of the block: 0 south-west, 1 south-east, 2 north-west, 3 north-east.
    pub(super) fn quarter(&self, quarter: u32) -> Square {
        let (corner, side) = (self.map.corner, 0.5 * self.map.side);
        let [east, north] = [quarter & 1, quarter >> 1].map(f64::from);
        ([corner[0] + east * side, corner[1] + north * side], side)
    }

    fn heights_range(&self) -> [f64; 2] {
        let top = f64::from(self.map.heights[1]);
        [self.floor, top.max(self.floor)]
    }

    #[inline(always)]
    fn walks(&self, beams: &Beams, spans: &Spans) -> Walks {
        let (corner, side) = (self.map.corner, Floats::splat(self.map.side_texels as f32));
        let texel = 1.0 / self.per_metre;
        let last = Floats::splat((self.map.side_texels as f32).next_down());
        let axis = |axis: usize| {
            let place = beams.origin[axis] + spans.start * beams.direction[axis];
            let along = narrow((place - corner[axis]) * self.per_metre);
            let direction = narrow(beams.direction[axis] * self.per_metre);
            let is_mirrored = direction.simd_lt(Floats::ZERO);
            let origin = select(is_mirrored, side - along, along);
            let origin = origin.fast_max(Floats::ZERO).fast_min(last);
            let inverse = narrow(beams.inverse[axis] * texel).abs();
            let inverse = inverse.fast_min(Floats::splat(FARTHEST));
            Axis {
                origin,
                direction: direction.abs(),
                inverse,
                offset: -(origin * inverse),
                is_mirrored,
            }
        };
        Walks {
            x: axis(0),
            y: axis(1),
            origin: narrow(beams.origin[2] + spans.start * beams.direction[2]),
            direction: narrow(beams.direction[2]),
            end: narrow(spans.end - spans.start),
        }
    }

    /// The first ray's meeting.
    fn walk(&self, walks: &Walks) -> Option<Meeting> {
        let first = |numbers: Floats| numbers.to_array()[0];
        let [x, y] = [&walks.x, &walks.y];
        let [inverse, offset] = [
            [first(x.inverse), first(y.inverse)],
            [first(x.offset), first(y.offset)],
        ];
        let mirrored = [x, y].map(|axis| axis.is_mirrored.to_bitmask() & 1 == 1);
        let (origin, direction, end) = (
            first(walks.origin),
            first(walks.direction),
            first(walks.end),
        );
        let side = self.map.side_texels as i32;
        let mut texel = [x, y].map(|axis| first(axis.origin) as i32);
        let (mut distance, mut before) = (0.0f32, -1);
        loop {
            let [x, y] = [0, 1].map(|axis| (texel[axis] + 1) as f32 * inverse[axis] + offset[axis]);
            let leave = x.min(y).min(end);
            let [column, row] = [0, 1].map(|axis| match mirrored[axis] {
                true => side - 1 - texel[axis],
                false => texel[axis],
            });
            let index = row * side + column;
            let lowest = (origin + distance * direction).min(origin + leave * direction);
            if lowest <= self.heights[index as usize] {
                return Some(Meeting {
                    index,
                    before,
                    distance,
                    leave,
                });
            }
            texel[usize::from(x > y)] += 1;
            if leave >= end || texel.contains(&side) {
                return None;
            }
            (distance, before) = (leave, index);
        }
    }

    #[inline(always)]
    fn told(
        &self,
        (beams, spans, walks): (&Beams, &Spans, &Walks),
        lane: usize,
        meeting: Meeting,
    ) -> Hit {
        let origin = walks.origin.to_array()[lane];
        let direction = walks.direction.to_array()[lane];
        let (index, side) = (meeting.index as usize, self.map.side_texels);
        let top = self.heights[index];
        let [column, row] = [index % side, index / side];
        let height = origin + meeting.distance * direction;
        let (distance, height, is_wall) = if height <= top {
            let is_steep = match usize::try_from(meeting.before) {
                Ok(before) => top - self.heights[before] > self.step,
                Err(_) => spans.is_side.to_bitmask() >> lane & 1 == 1,
            };
            let is_wall = is_steep && self.map.wall_column(column, row) != 0;
            (meeting.distance, height, is_wall)
        } else {
            let distance = (top - origin) / direction;
            let distance = distance.max(meeting.distance).min(meeting.leave);
            (distance, top, false)
        };
        let start = spans.start.to_array()[lane];
        Hit {
            distance: beams.distance(lane, start + f64::from(distance)),
            texel: [column as u16, row as u16],
            height,
            is_wall,
        }
    }
}
