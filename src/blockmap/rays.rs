//! Rays against what is drawn of a city.

use super::cast::{Beam, Caster, Hit, Ray, Surface};
use super::layout::BlockMap;
use super::tree::Tree;
use super::visit::{Drawn, Visit};
use std::sync::Arc;

/// BlockMaps of several levels, ready for rays. A ray goes from square to square, all of which reach down to the city's floor: it
/// cannot pass between two of them.
pub struct CityRays<'a> {
    tree: &'a Tree,
    /// Of each node that is drawn, or above one that is.
    places: Vec<Place>,
    casters: Vec<Caster<Arc<BlockMap>>>,
}

/// What is at a node.
#[derive(Clone, Copy, Default)]
struct Place {
    /// Whether something below it is drawn.
    leads_on: bool,
    /// Its own quarters that are drawn.
    quarters: u8,
    /// Into the casters, where there are quarters.
    caster: u32,
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

impl<'a> CityRays<'a> {
    /// Against what a visit draws.
    pub fn of_visit(visit: &'a Visit) -> CityRays<'a> {
        let block = |node| visit.block(node).cloned();
        CityRays::new(visit.city().tree(), visit.drawn(), block)
    }

    /// Against a list of nodes; those that `block` does not give are left out.
    pub fn new(
        tree: &'a Tree,
        drawn: &[Drawn],
        mut block: impl FnMut(u32) -> Option<Arc<BlockMap>>,
    ) -> CityRays<'a> {
        let mut rays = CityRays {
            tree,
            places: vec![Place::default(); tree.nodes.len()],
            casters: Vec::with_capacity(drawn.len()),
        };
        for entry in drawn {
            let Some(map) = block(entry.node) else {
                continue;
            };
            let place = &mut rays.places[entry.node as usize];
            (place.quarters, place.caster) = (entry.quarters, rays.casters.len() as u32);
            rays.casters.push(Caster::new(map, tree.floor));
            let mut above = tree.nodes[entry.node as usize].parent;
            while let Some(node) = above {
                rays.places[node as usize].leads_on = true;
                above = tree.nodes[node as usize].parent;
            }
        }
        rays
    }

    /// The nearest hit.
    pub fn cast(&self, ray: &Ray) -> Option<CityHit> {
        let (node, hit) = self.cast_node(&Beam::new(ray), 0)?;
        let caster = &self.casters[self.places[node as usize].caster as usize];
        Some(CityHit {
            node,
            hit,
            surface: caster.surface(&hit),
        })
    }

    fn cast_node(&self, beam: &Beam, node: u32) -> Option<(u32, Hit)> {
        let place = self.places[node as usize];
        if place.quarters == super::visit::ALL_QUARTERS {
            let caster = &self.casters[place.caster as usize];
            return Some((node, caster.hit(beam)?));
        }
        if place.quarters == 0 && !place.leads_on {
            return None;
        }
        let found = &self.tree.nodes[node as usize];
        let top = f64::from(found.heights[1]);
        let (corner, side) = self.tree.square(found);
        beam.span(corner, side, [self.tree.floor, top])?;
        beam.order().into_iter().find_map(|quarter| {
            if place.quarters >> quarter & 1 == 1 {
                let caster = &self.casters[place.caster as usize];
                return Some((node, caster.hit_in_quarter(beam, quarter)?));
            }
            let child = found.children.filter(|_| place.leads_on)? + quarter;
            self.cast_node(beam, child)
        })
    }
}
