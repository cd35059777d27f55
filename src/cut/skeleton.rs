//! A cut without its heights: which diamonds are refined, how they look, and what they take. Summaries are
//! enough to know all of it, so that what a refinement comes to is known before anything is decoded.

use super::DiamondSource;
use super::node::{Node, Outlook, Room, half_at_edge, half_from};
use super::projection::Projection;
use super::samples::Ground;
use crate::lattice::{Diamond, Lattice};
use crate::schedule::Budget;
use crate::{Error, Result};
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

/// Nodes from the root down. A parent of a node is always a node itself: two parents that share a
/// child share a parent.
#[derive(Clone)]
pub(super) struct Skeleton {
    ground: Ground,
    sizes: Sizes,
    nodes: Vec<Option<Node>>,
    free: Vec<usize>,
    places: HashMap<Diamond, usize>,
    /// Diamonds that cannot be refined, because their source failed.
    failed: HashSet<Diamond>,
    /// Diamonds that wait for their details in this update.
    awaited: HashSet<Diamond>,
    visible_patches: u64,
    bytes: u64,
}

/// Bytes of what diamonds hold.
#[derive(Clone, Copy)]
pub(super) struct Sizes {
    /// Heights and slopes of all vertices.
    pub vertices: u64,
    /// A mask of them.
    pub mask: u64,
    /// A patch's vertices.
    pub patch: u64,
    /// A patch's own list of triangles.
    pub list: u64,
}

/// What an operation adds to what is held and drawn.
#[derive(Clone, Copy, Default)]
pub(super) struct Cost {
    pub patches: i64,
    pub bytes: i64,
    pub upload: u64,
}

/// A budget of room.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Shortage {
    Patches,
    Bytes,
}

impl Skeleton {
    /// The root alone.
    pub fn new(ground: Ground, sizes: Sizes) -> Result<Skeleton> {
        let source = &*ground.heights;
        let (root, range) = (source.lattice().root(), source.range());
        let outlook = if source.lattice().levels() == 0 {
            Outlook::of_leaf(source, range)
        } else {
            let has_finer_texels = ground.has_finer_texels(root)?;
            Outlook::of(source, source.summary(root, range)?, has_finer_texels)
        };
        let mut skeleton = Skeleton {
            sizes,
            nodes: Vec::new(),
            free: Vec::new(),
            places: HashMap::new(),
            failed: HashSet::new(),
            awaited: HashSet::new(),
            visible_patches: 0,
            bytes: 0,
            ground,
        };
        let place = skeleton.insert(root, outlook);
        skeleton.change(place, |node| {
            let z = node.bounds.z;
            (0..2).for_each(|half| node.receive(half, z));
        });
        Ok(skeleton)
    }

    pub fn ground(&self) -> &Ground {
        &self.ground
    }

    pub fn source(&self) -> &Arc<dyn DiamondSource> {
        &self.ground.heights
    }

    fn lattice(&self) -> &Lattice {
        self.ground.heights.lattice()
    }

    /// Patches that meet the frustum last looked through.
    pub fn visible_patches(&self) -> u64 {
        self.visible_patches
    }

    /// Bytes set aside for all nodes and patches.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// All nodes with their places.
    pub fn nodes(&self) -> impl Iterator<Item = (usize, &Node)> {
        let nodes = self.nodes.iter().enumerate();
        nodes.filter_map(|(place, node)| Some((place, node.as_ref()?)))
    }

    /// All places that a node may have.
    pub fn places(&self) -> Range<usize> {
        0..self.nodes.len()
    }

    pub fn node(&self, place: usize) -> Option<&Node> {
        self.nodes.get(place)?.as_ref()
    }

    pub fn place(&self, diamond: Diamond) -> Option<usize> {
        self.places.get(&diamond).copied()
    }

    /// Whether the node's own data let it be refined now.
    pub fn is_refinable(&self, node: &Node) -> bool {
        !node.refined
            && !node.is_missing
            && !node.is_leaf
            && (self.failed.is_empty() || !self.failed.contains(&node.diamond))
            && (self.awaited.is_empty() || !self.awaited.contains(&node.diamond))
    }

    /// Remembers that a diamond's source failed.
    pub fn give_up(&mut self, diamond: Diamond) {
        self.failed.insert(diamond);
    }

    /// Remembers until the next look that a diamond waits for its detail.
    pub fn wait_for(&mut self, diamond: Diamond) {
        self.awaited.insert(diamond);
    }

    /// Whether any diamond does.
    pub fn is_waiting(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// Judges all nodes by a view.
    pub fn look(&mut self, projection: &Projection) {
        self.visible_patches = 0;
        self.awaited.clear();
        for node in self.nodes.iter_mut().flatten() {
            if !node.is_on_the_cut() {
                continue;
            }
            node.look(projection);
            self.visible_patches += node.visible_patches();
        }
    }

    /// What must be refined to refine the node at `place`, parents first, itself last. False if one of
    /// them cannot be.
    pub fn chain(&self, place: usize, chain: &mut Vec<usize>) -> bool {
        let Some(node) = self.node(place).filter(|node| self.is_refinable(node)) else {
            return false;
        };
        if !node.is_complete() {
            let parents = self.lattice().parents(node.diamond);
            for parent in parents.into_iter().flatten() {
                let Some(place) = self.place(parent) else {
                    return false;
                };
                let is_refined = self.node(place).is_some_and(|parent| parent.refined);
                if !is_refined && !chain.contains(&place) && !self.chain(place, chain) {
                    return false;
                }
            }
        }
        chain.push(place);
        true
    }

    /// What there is too little room for if the nodes of a chain are refined one after the other, on the way or in the
    /// end. Where summaries cannot be read nothing is: the refinement itself then fails.
    pub fn shortage(
        &mut self,
        chain: &[usize],
        projection: &Projection,
        budget: &Budget,
    ) -> Option<Shortage> {
        let count = chain.len() as u64;
        let most = 4 * (self.sizes.patch + self.sizes.list + self.sizes.vertices + self.sizes.mask);
        if self.visible_patches.saturating_add(4 * count) <= budget.patches
            && self.bytes.saturating_add(most * count) <= budget.bytes
        {
            return None;
        }
        let (mut done, mut shortage) = (0, None);
        while done < chain.len() && shortage.is_none() {
            if self.refine(chain[done], 0, projection).is_err() {
                break;
            }
            done += 1;
            shortage = self.excess(budget);
        }
        for &place in chain[..done].iter().rev() {
            self.coarsen(place, projection);
        }
        shortage
    }

    /// What of a budget is exceeded by what is held and drawn.
    pub fn excess(&self, budget: &Budget) -> Option<Shortage> {
        if self.bytes > budget.bytes {
            return Some(Shortage::Bytes);
        }
        (self.visible_patches > budget.patches).then_some(Shortage::Patches)
    }

    /// Most bytes of the patches that refining a node adds.
    pub fn refinement_upload(&self, node: &Node) -> u64 {
        let children = self.lattice().children(node.diamond);
        children.into_iter().flatten().count() as u64 * (self.sizes.patch + self.sizes.list)
    }

    /// What coarsening a node adds; of the upload, the most.
    pub fn coarsening_cost(&self, node: &Node) -> Cost {
        let visible = node.halves.iter().filter(|half| half.visible).count();
        let drawn = node.halves.iter().filter(|half| half.in_domain).count() as u64;
        let upload = drawn * node.room.patch;
        let mut cost = Cost {
            patches: visible as i64,
            bytes: upload as i64,
            upload,
        };
        for child in self.lattice().children(node.diamond).into_iter().flatten() {
            let half = half_from(self.lattice(), child, node.diamond);
            let child = self.place(child).and_then(|place| self.node(place));
            let (Some(half), Some(child)) = (half, child) else {
                continue;
            };
            cost.patches -= i64::from(child.halves[half].visible);
            cost.bytes -= child.room.patch as i64 * i64::from(child.halves[half].in_domain);
            if !child.halves[1 - half].has_arrived {
                cost.bytes -= child.room.own as i64;
            }
        }
        cost
    }

    /// Refines a node all of whose parents are refined.
    ///
    /// # Errors
    ///
    /// Those of its children's summaries; then nothing changes.
    pub fn refine(&mut self, place: usize, update: u64, projection: &Projection) -> Result<()> {
        let Some(node) = self.node(place).cloned() else {
            return Ok(());
        };
        debug_assert!(node.is_complete() && !node.refined);
        let children = self.lattice().children(node.diamond);
        let mut outlooks = [None; 4];
        for (outlook, child) in outlooks.iter_mut().zip(children) {
            if let Some(child) = child.filter(|child| !self.places.contains_key(child)) {
                *outlook = Some(self.child_outlook(child, &node)?);
            }
        }
        let apexes = self.lattice().apexes(node.diamond);
        for (edge, (outlook, child)) in outlooks.into_iter().zip(children).enumerate() {
            let Some(child) = child else { continue };
            if let Some(outlook) = outlook {
                self.insert(child, outlook);
            }
            let half = half_from(self.lattice(), child, node.diamond);
            let (Some(half), Some(place)) = (half, self.place(child)) else {
                continue;
            };
            let above = node.halves[half_at_edge(apexes, edge)].z;
            self.change(place, |child| {
                child.receive(half, above);
                child.look(projection);
            });
        }
        self.change(place, |node| {
            node.refined = true;
            node.refined_at = update;
        });
        self.count_refined_child(node.diamond, 1, projection);
        Ok(())
    }

    /// What a diamond becomes a node with. `parent` is the node that is being refined.
    fn child_outlook(&self, child: Diamond, parent: &Node) -> Result<Outlook> {
        let (source, lattice) = (&*self.ground.heights, self.lattice());
        let bounds = lattice.parents(child).map(|diamond| {
            let diamond = diamond?;
            if diamond == parent.diamond {
                return Some(parent.bounds);
            }
            let other = self.place(diamond).and_then(|place| self.node(place));
            other.map(|node| node.bounds)
        });
        let [first, second] = match bounds {
            [Some(first), Some(second)] => [first, second],
            [Some(only), None] | [None, Some(only)] => [only, only],
            [None, None] => return Err(Error::Argument("a diamond without parents".into())),
        };
        let has_finer_texels = first.has_finer_texels
            && second.has_finer_texels
            && self.ground.has_finer_texels(child)?;
        let (first, second) = (first.range, second.range);
        let hull = [first[0].min(second[0]), first[1].max(second[1])];
        if child.level() == lattice.levels() {
            return Ok(Outlook::of_leaf(source, hull));
        }
        let above = match child.level() >= source.data_levels() {
            true => hull,
            false => first,
        };
        let summary = source.summary(child, above)?;
        Ok(Outlook::of(source, summary, has_finer_texels))
    }

    /// Takes back a refinement; no child may be refined.
    pub fn coarsen(&mut self, place: usize, projection: &Projection) {
        let Some(diamond) = self.node(place).map(|node| node.diamond) else {
            return;
        };
        for child in self.lattice().children(diamond).into_iter().flatten() {
            let half = half_from(self.lattice(), child, diamond);
            let (Some(half), Some(place)) = (half, self.place(child)) else {
                continue;
            };
            self.change(place, |child| {
                child.lose(half);
                child.look(projection);
            });
            let is_left = |node: &Node| node.halves.iter().any(|half| half.has_arrived);
            if !self.node(place).is_some_and(is_left) {
                self.remove(place);
            }
        }
        self.change(place, |node| {
            debug_assert!(node.refined && node.refined_children == 0);
            node.refined = false;
        });
        self.count_refined_child(diamond, -1, projection);
    }

    fn count_refined_child(&mut self, child: Diamond, change: i8, projection: &Projection) {
        for parent in self.lattice().parents(child).into_iter().flatten() {
            if let Some(place) = self.place(parent)
                && let Some(node) = self.nodes[place].as_mut()
            {
                node.refined_children = node.refined_children.wrapping_add_signed(change);
                if change < 0 && node.is_on_the_cut() {
                    node.look(projection);
                }
            }
        }
    }

    fn insert(&mut self, diamond: Diamond, outlook: Outlook) -> usize {
        let place = self.free.pop().unwrap_or_else(|| {
            self.nodes.push(None);
            self.nodes.len() - 1
        });
        let Sizes {
            vertices,
            mask,
            patch,
            list,
        } = self.sizes;
        let source = &*self.ground.heights;
        let is_whole = !source.has_voids() && source.lattice().is_inside(diamond);
        let room = if is_whole {
            Room {
                own: vertices,
                patch,
            }
        } else {
            Room {
                own: vertices + mask,
                patch: patch + list,
            }
        };
        self.places.insert(diamond, place);
        self.bytes += room.own;
        self.nodes[place] = Some(Node::new(source, room, diamond, outlook));
        place
    }

    /// Removes a node none of whose halves is left.
    fn remove(&mut self, place: usize) {
        if let Some(node) = self.nodes[place].take() {
            self.bytes -= node.bytes();
            self.places.remove(&node.diamond);
            self.free.push(place);
        }
    }

    /// Changes a node and what it counts for.
    fn change(&mut self, place: usize, change: impl FnOnce(&mut Node)) {
        if let Some(node) = self.nodes.get_mut(place).and_then(Option::as_mut) {
            self.visible_patches -= node.visible_patches();
            self.bytes -= node.bytes();
            change(node);
            self.visible_patches += node.visible_patches();
            self.bytes += node.bytes();
        }
    }
}
