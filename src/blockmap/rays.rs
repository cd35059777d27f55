//! Rays against what is drawn of a city.

use super::beams::{Beams, Floats, LANES, Ray, Square, packets};
use super::cast::{Caster, Hit, Surface};
use super::layout::BlockMap;
use super::tree::Tree;
use super::visit::{ALL_QUARTERS, Drawn, Visit};
use std::sync::{Arc, OnceLock};

/// BlockMaps of several levels, ready for rays. A ray goes from square to square, all of which reach down to the city's floor: it
/// cannot pass between two of them.
pub struct CityRays {
    /// Down to where all prisms reach.
    floor: f64,
    /// Of all nodes of the tree.
    places: Vec<Place>,
    blocks: Vec<Block>,
}

/// A node.
struct Place {
    square: Square,
    /// The greatest height of it and all below it.
    top: f64,
    /// The first of its four children.
    children: u32,
    /// Whether something below it is drawn.
    leads_on: bool,
    /// Its own quarters that are drawn.
    quarters: u8,
    /// Where there are quarters, into the blocks.
    block: u32,
}

/// A block that is drawn, made ready by the first ray that comes to it.
struct Block {
    map: Arc<BlockMap>,
    caster: OnceLock<Caster<Arc<BlockMap>>>,
}

/// What a ray met in a city.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CityHit {
    /// Whose BlockMap.
    pub node: u32,
    /// Where in it.
    pub hit: Hit,
    /// What is there.
    pub surface: Surface,
}

/// Four rays on their way, and what those met that are done.
struct Packet {
    beams: Beams,
    /// Numbers of quarters in an order in which none of these rays meets a later one before an earlier one.
    order: [u32; 4],
    hits: [Option<(u32, Hit)>; LANES],
}

impl CityRays {
    /// Against what a visit draws.
    pub fn of_visit(visit: &Visit) -> CityRays {
        let block = |node| visit.block(node).cloned();
        CityRays::new(visit.city().tree(), visit.drawn(), block)
    }

    /// Against a list of nodes; those that `block` does not give are left out.
    pub fn new(
        tree: &Tree,
        drawn: &[Drawn],
        mut block: impl FnMut(u32) -> Option<Arc<BlockMap>>,
    ) -> CityRays {
        let place = |node| Place {
            square: tree.square(node),
            top: f64::from(node.heights[1]),
            children: node.children.unwrap_or(0),
            leads_on: false,
            quarters: 0,
            block: 0,
        };
        let mut rays = CityRays {
            floor: tree.floor,
            places: tree.nodes.iter().map(place).collect(),
            blocks: Vec::with_capacity(drawn.len()),
        };
        for entry in drawn {
            let Some(map) = block(entry.node) else {
                continue;
            };
            let place = &mut rays.places[entry.node as usize];
            (place.quarters, place.block) = (entry.quarters, rays.blocks.len() as u32);
            let caster = OnceLock::new();
            rays.blocks.push(Block { map, caster });
            let mut above = tree.nodes[entry.node as usize].parent;
            while let Some(node) = above {
                rays.places[node as usize].leads_on = true;
                above = tree.nodes[node as usize].parent;
            }
        }
        rays
    }

    /// Makes all blocks ready, which else the first rays do that come to them.
    pub fn prepare(&self) {
        self.blocks.iter().for_each(|block| {
            block.ready(self.floor);
        });
    }

    /// The nearest hit.
    pub fn cast(&self, ray: &Ray) -> Option<CityHit> {
        let mut found = None;
        self.cast_each(&[*ray], |_, hit| found = hit);
        found
    }

    /// The nearest hits of many rays, one by one with their numbers: several times as fast as one ray at a time where neighbours go
    /// almost the same way.
    pub fn cast_each(&self, rays: &[Ray], mut found: impl FnMut(usize, Option<CityHit>)) {
        for (number, (rays, count)) in packets(rays).enumerate() {
            let hits = self.packet(&rays);
            for (lane, hit) in hits.into_iter().take(count).enumerate() {
                let hit = hit.map(|(node, hit)| CityHit {
                    node,
                    hit,
                    surface: self.caster(node).surface(&hit),
                });
                found(number * LANES + lane, hit);
            }
        }
    }

    fn packet(&self, rays: &[Ray; LANES]) -> [Option<(u32, Hit)>; LANES] {
        let mut packet = Packet {
            beams: Beams::new(rays),
            order: [0; 4],
            hits: [None; LANES],
        };
        let firsts = packet.beams.first_quarters();
        // Most often one group of all.
        for quarter in 0..4 {
            let lanes = firsts.simd_eq(Floats::splat(quarter as f32));
            if lanes.any() {
                packet.order = [quarter, quarter ^ 1, quarter ^ 2, quarter ^ 3];
                self.cast_node(&mut packet, 0, lanes);
            }
        }
        packet.hits
    }

    /// Casts rays into what is drawn of a node; gives those that met nothing.
    fn cast_node(&self, packet: &mut Packet, node: u32, lanes: Floats) -> Floats {
        let place = &self.places[node as usize];
        if place.quarters == ALL_QUARTERS {
            return self.cast_block(packet, node, place.square, lanes);
        }
        if place.quarters == 0 && !place.leads_on {
            return lanes;
        }
        let spans = packet.beams.spans(place.square, [self.floor, place.top]);
        let mut inside = lanes & spans.meets;
        for quarter in packet.order {
            if !inside.any() {
                break;
            }
            if place.quarters >> quarter & 1 == 1 {
                let square = self.caster(node).quarter(quarter);
                inside = self.cast_block(packet, node, square, inside);
            } else if place.leads_on {
                inside = self.cast_node(packet, place.children + quarter, inside);
            }
        }
        inside | (lanes & !spans.meets)
    }

    fn cast_block(&self, packet: &mut Packet, node: u32, square: Square, lanes: Floats) -> Floats {
        let Packet { beams, hits, .. } = packet;
        let caster = self.caster(node);
        lanes
            & !caster.packet(beams, square, lanes, |lane, hit| {
                hits[lane] = Some((node, hit))
            })
    }

    /// That of a node of which something is drawn.
    fn caster(&self, node: u32) -> &Caster<Arc<BlockMap>> {
        self.blocks[self.places[node as usize].block as usize].ready(self.floor)
    }
}

impl Block {
    fn ready(&self, floor: f64) -> &Caster<Arc<BlockMap>> {
        self.caster
            .get_or_init(|| Caster::new(self.map.clone(), floor))
    }
}
