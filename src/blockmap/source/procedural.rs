//! Cities made of nothing but a seed.

use super::walls::divisions;
use crate::blockmap::{Paint, Scene, Triangle, facade};

/// Lots of a block, along and across.
const LOTS: [usize; 2] = [4, 2];
/// Metres that walls reach into the ground.
const FOUNDATION: f64 = 2.0;
/// Metres: height of the lowest and the highest building.
const HEIGHTS: [f64; 2] = [6.0, 60.0];
/// Metres: from this short side on there may be a courtyard.
const COURTYARD: f64 = 12.0;

/// A city on a square of ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProceduralCity {
    /// Another seed, another city.
    pub seed: u32,
    /// West and south edge, in metres.
    pub corner: [f64; 2],
    /// Length of an edge, in metres.
    pub side: f64,
    /// How many; they get smaller where there are more of them.
    pub buildings: usize,
}

/// Numbers from 0 to 1, one after another.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let bits = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let bits = (bits ^ bits >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (bits >> 40) as f64 / (1_u64 << 24) as f64
    }
}

/// A rectangle, from its lower left to its upper right corner.
#[derive(Clone, Copy)]
struct Footprint {
    low: [f64; 2],
    high: [f64; 2],
}

/// A building that stands on the ground.
struct Building<'a> {
    triangles: &'a mut Vec<Triangle>,
    seed: u32,
    base: f64,
    top: f64,
}

/// Builds blocks of lots along a grid of streets: boxes, gabled houses, some courtyards, and towers near the centre.
/// `ground` tells the height in metres at a place, or `None` outside: a building stands on the lowest corner of its
/// footprint, and is left out where no corner has ground. Streets are left to the ground. The same city on the same
/// ground is always the same.
pub fn generate(city: &ProceduralCity, ground: &dyn Fn([f64; 2]) -> Option<f64>) -> Scene {
    let mut scene = Scene::default();
    let is_square =
        city.side > 0.0 && city.side.is_finite() && city.corner.iter().all(|at| at.is_finite());
    if city.buildings == 0 || !is_square {
        return scene;
    }
    let per_block = LOTS[0] * LOTS[1];
    let blocks = (city.buildings as f64 / per_block as f64).sqrt().ceil() as usize;
    let lots = blocks * blocks * per_block;
    for lot in 0..lots {
        // So many of the lots before this one are built on that in the end it is as many as wanted.
        let share = |lots_passed: usize| {
            (lots_passed as u128 * city.buildings as u128 / lots as u128) as usize
        };
        if share(lot + 1) == share(lot) {
            continue;
        }
        let mut random = Random(u64::from(city.seed) << 32 ^ lot as u64);
        random.next();
        let footprint = lot_of(city, blocks, lot).shrunk(&mut random);
        let corners = footprint.corners();
        let heights = corners.iter().filter_map(|&corner| ground(corner));
        let Some(base) = heights.filter(|height| height.is_finite()).reduce(f64::min) else {
            continue;
        };
        let height = height_of(city, &footprint, &mut random);
        let mut building = Building {
            triangles: &mut scene.triangles,
            seed: (random.next() * f64::from(u32::MAX)) as u32,
            base,
            top: base + height,
        };
        building.build(&footprint, random.next());
    }
    scene
}

/// Blocks row by row; within a block, lots along its longer direction, which turns from block to block.
fn lot_of(city: &ProceduralCity, blocks: usize, lot: usize) -> Footprint {
    let (block, within) = (lot / (LOTS[0] * LOTS[1]), lot % (LOTS[0] * LOTS[1]));
    let (column, row) = (block % blocks, block / blocks);
    let pitch = city.side / blocks as f64;
    let street = (0.2 * pitch).min(16.0);
    let is_turned =
        Random(u64::from(city.seed) << 32 ^ 0xb10c_0000_0000 ^ block as u64).next() < 0.5;
    let (counts, place) = match (is_turned, [within % LOTS[0], within / LOTS[0]]) {
        (false, place) => (LOTS, place),
        (true, [along, across]) => ([LOTS[1], LOTS[0]], [across, along]),
    };
    let block_place = [column, row];
    let low = [0, 1].map(|axis| {
        let edge = city.corner[axis] + block_place[axis] as f64 * pitch + street / 2.0;
        edge + place[axis] as f64 * (pitch - street) / counts[axis] as f64
    });
    let size = counts.map(|count| (pitch - street) / count as f64);
    Footprint {
        low,
        high: [low[0] + size[0], low[1] + size[1]],
    }
}

fn height_of(city: &ProceduralCity, footprint: &Footprint, random: &mut Random) -> f64 {
    let half = city.side / 2.0;
    let away = [0, 1].map(|axis| (footprint.low[axis] - city.corner[axis] - half) / half);
    let nearness = (1.0 - (away[0] * away[0] + away[1] * away[1]).sqrt()).max(0.0);
    let tower = random.next();
    let extra = 40.0 * nearness * tower * tower * tower.sqrt();
    let height = HEIGHTS[0] + random.next() * (4.0 + 10.0 * nearness) + extra;
    height.clamp(HEIGHTS[0], HEIGHTS[1])
}

impl Footprint {
    /// With a garden on some sides.
    fn shrunk(&self, random: &mut Random) -> Footprint {
        let size = [self.high[0] - self.low[0], self.high[1] - self.low[1]];
        // Many houses share a wall with their neighbour.
        let mut garden = |axis: usize| match random.next() {
            share if share < 0.4 => 0.0,
            share => 0.2 * share * size[axis],
        };
        let low = [self.low[0] + garden(0), self.low[1] + garden(1)];
        let high = [self.high[0] - garden(0), self.high[1] - garden(1)];
        Footprint { low, high }
    }

    /// A smaller one in its middle third.
    fn court(&self) -> Footprint {
        let third = [0, 1].map(|axis| (self.high[axis] - self.low[axis]) / 3.0);
        Footprint {
            low: [self.low[0] + third[0], self.low[1] + third[1]],
            high: [self.high[0] - third[0], self.high[1] - third[1]],
        }
    }

    /// Counterclockwise.
    fn corners(&self) -> [[f64; 2]; 4] {
        let Footprint { low, high } = *self;
        [low, [high[0], low[1]], high, [low[0], high[1]]]
    }
}

impl Building<'_> {
    fn build(&mut self, footprint: &Footprint, choice: f64) {
        let corners = footprint.corners();
        let size = [0, 1].map(|axis| footprint.high[axis] - footprint.low[axis]);
        self.walls(corners);
        let short = size[0].min(size[1]);
        if short >= COURTYARD && choice < 0.25 {
            let mut court = footprint.court().corners();
            for side in 0..4 {
                let next = (side + 1) % 4;
                let roof = [corners[side], corners[next], court[next], court[side]];
                self.roof(roof.map(|[x, y]| [x, y, self.top]));
            }
            court.reverse();
            self.walls(court);
        } else if self.top - self.base < 15.0 && choice < 0.75 {
            self.gable(corners, size, 0.35 * short);
        } else {
            self.roof(corners.map(|[x, y]| [x, y, self.top]));
        }
    }

    /// Along a closed outline that has the building at its left.
    fn walls(&mut self, corners: [[f64; 2]; 4]) {
        for side in 0..4 {
            let ends = [corners[side], corners[(side + 1) % 4]];
            self.wall(ends);
        }
    }

    fn wall(&mut self, [from, to]: [[f64; 2]; 2]) {
        let [x, y] = [to[0] - from[0], to[1] - from[1]];
        let width = (x * x + y * y).sqrt();
        let height = self.top - self.base;
        let [bays, storeys] = divisions([width, height]);
        let low = -FOUNDATION * storeys / height;
        let [bays, storeys, low] = [bays, storeys, low].map(|number| number as f32);
        let lowest = self.base - FOUNDATION;
        let corners = [
            [from[0], from[1], lowest],
            [to[0], to[1], lowest],
            [to[0], to[1], self.top],
            [from[0], from[1], self.top],
        ];
        let at = [[0.0, low], [bays, low], [bays, storeys], [0.0, storeys]];
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            self.triangles.push(Triangle {
                corners: [corners[a], corners[b], corners[c]],
                paint: Paint::Facade {
                    seed: self.seed,
                    at: [at[a], at[b], at[c]],
                },
            });
        }
    }

    fn roof(&mut self, [a, b, c, d]: [[f64; 3]; 4]) {
        let colour = facade::roof(self.seed);
        self.plain([a, b, c], colour);
        self.plain([a, c, d], colour);
    }

    fn plain(&mut self, corners: [[f64; 3]; 3], colour: [u8; 3]) {
        let paint = Paint::Plain(colour);
        self.triangles.push(Triangle { corners, paint });
    }

    /// Two planes up to a ridge along the longer side, and the walls under it.
    fn gable(&mut self, corners: [[f64; 2]; 4], size: [f64; 2], rise: f64) {
        let [a, b, c, d] = match size[0] >= size[1] {
            true => corners,
            false => [corners[1], corners[2], corners[3], corners[0]],
        };
        let eave = |[x, y]: [f64; 2]| [x, y, self.top];
        let ridge =
            |p: [f64; 2], q: [f64; 2]| [(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0, self.top + rise];
        let (left, right) = (ridge(a, d), ridge(b, c));
        let [a, b, c, d] = [eave(a), eave(b), eave(c), eave(d)];
        self.roof([a, b, right, left]);
        self.roof([c, d, left, right]);
        let colour = facade::wall(self.seed);
        self.plain([b, c, right], colour);
        self.plain([d, a, left], colour);
    }
}
