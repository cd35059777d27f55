//! Between blocks, of one level or of several, there is nothing to fall through.

use crate::samples::shared_city;
use kimberlite::blockmap::{ALL_QUARTERS, BlockMap, City, CityRays, Drawn, Ray};
use std::collections::HashMap;
use std::sync::Arc;

/// xorshift64*.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn chance(&mut self, share: f64) -> bool {
        self.next() < share
    }
}

/// A random mix: each node is drawn, or its children are, or some quarters of it and the other children.
fn mix(city: &City, node: u32, random: &mut Random, drawn: &mut Vec<Drawn>) {
    let whole = Drawn {
        node,
        quarters: ALL_QUARTERS,
        pixels: 0.0,
    };
    let Some(first) = city.tree().nodes[node as usize].children else {
        return drawn.push(whole);
    };
    if node != 0 && random.chance(0.3) {
        return drawn.push(whole);
    }
    let mut quarters = 0;
    for quarter in 0..4 {
        if random.chance(0.2) {
            quarters |= 1 << quarter;
        } else {
            mix(city, first + quarter, random, drawn);
        }
    }
    if quarters != 0 {
        drawn.push(Drawn { quarters, ..whole });
    }
}

/// From outside or above to a place on the city's floor, now and then exactly through corners and along edges of squares.
fn ray(city: &City, random: &mut Random) -> Ray {
    let tree = city.tree();
    let top = f64::from(tree.nodes[0].heights[1]);
    let mut place = |beyond: f64| {
        let along =
            |random: &mut Random| tree.side * (random.next() * (1.0 + 2.0 * beyond) - beyond);
        let step = tree.side / f64::from(1u32 << tree.depth());
        [0, 1].map(|axis| {
            let at = along(random);
            let at = if random.chance(0.2) {
                (at / step).round() * step
            } else {
                at
            };
            let border = -beyond * tree.side;
            tree.corner[axis] + at.clamp(border, tree.side - border)
        })
    };
    // Not on the border itself, which a ray may touch without going in.
    let target = place(-1e-4);
    let mut origin = place(1.0);
    if random.chance(0.1) {
        origin[0] = target[0];
    }
    if random.chance(0.1) {
        origin[1] = target[1];
    }
    let height = top + random.next() * if random.chance(0.5) { 1.0 } else { tree.side };
    let from = [origin[0], origin[1], height];
    let to = [target[0], target[1], tree.floor + 0.5];
    Ray {
        origin: from,
        direction: [0, 1, 2].map(|axis| to[axis] - from[axis]),
    }
}

#[test]
fn a_ray_falls_between_blocks_of_any_levels() {
    let city = shared_city();
    let rays = match std::env::var_os("KIMBERLITE_SOAK") {
        Some(_) => 10_000_000u64,
        None => 200_000,
    };
    let mut blocks: HashMap<u32, Arc<BlockMap>> = HashMap::new();
    let mut random = Random(0x9E37_79B9);
    let mut cast = 0;
    while cast < rays {
        let mut drawn = Vec::new();
        mix(&city, 0, &mut random, &mut drawn);
        let block = |node: u32| {
            let read = || Arc::new(city.read(node).unwrap());
            Some(blocks.entry(node).or_insert_with(read).clone())
        };
        let mixed = CityRays::new(city.tree(), &drawn, block);
        for _ in 0..(rays / 100).min(rays - cast) {
            let ray = ray(&city, &mut random);
            let hit = mixed.cast(&ray);
            assert!(hit.is_some(), "{ray:?} falls through {drawn:?}");
            // It ends above the floor, so that it is met before its target.
            assert!(hit.unwrap().hit.distance <= 1.0 + 1e-9);
            cast += 1;
        }
    }
}
