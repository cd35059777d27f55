//! The diamonds that a cut holds, and the two operations that keep it legal: refine and coarsen.

use super::DiamondSource;
use super::changes::ChangeLog;
use super::node::{Node, Outlook};
use super::patch::{Patch, PatchMaker, VertexForm};
use super::projection::Projection;
use super::slopes::{Diagonals, Heights, Slope, root_slopes};
use crate::codec::Refined;
use crate::lattice::{Diamond, Lattice, gather_half, reflect_absent_half};
use crate::{Error, Result};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Nodes from the root down. A parent of a node is always a node itself: two parents that share a
/// child share a parent.
pub(super) struct Graph {
    source: Arc<dyn DiamondSource>,
    maker: PatchMaker,
    nodes: Vec<Option<Node>>,
    free: Vec<usize>,
    places: HashMap<Diamond, usize>,
    /// Diamonds that cannot be refined, because their source failed.
    failed: HashSet<Diamond>,
    visible_patches: u64,
    bytes: u64,
    changes: ChangeLog,
    scratch: Scratch,
}

/// Storage of one refinement.
struct Scratch {
    vertex_slopes: Box<[Slope]>,
    centre_slopes: Box<[Slope]>,
    all_valid: Box<[u8]>,
}

/// Most that an operation can add to what is held and drawn.
#[derive(Clone, Copy, Default)]
pub(super) struct Cost {
    pub patches: i64,
    pub bytes: i64,
    pub upload: u64,
}

impl std::ops::AddAssign for Cost {
    fn add_assign(&mut self, other: Cost) {
        self.patches += other.patches;
        self.bytes += other.bytes;
        self.upload += other.upload;
    }
}

impl Graph {
    pub fn new(source: Arc<dyn DiamondSource>, form: VertexForm) -> Result<Graph> {
        let lattice = source.lattice();
        let (cells, root) = (lattice.cells(), lattice.root());
        let outlook = if lattice.levels() == 0 {
            Outlook::of_leaf(&*source, source.range())
        } else {
            Outlook::of(&*source, source.summary(root, source.range())?)
        };
        let mut node = Node::new(&*source, root, outlook);
        node.vertices = source.root().clone();
        let (frame, [_, unit]) = (source.frame(), source.height_to_world());
        let step = [
            frame.step[0] * node.placement.ax[0] as f64,
            frame.step[1] * node.placement.ay[1] as f64,
        ];
        node.slopes = root_slopes(cells, &node.vertices.values, step, unit);
        let side = cells + 1;
        let mut graph = Graph {
            maker: PatchMaker::new(&*source, form),
            nodes: Vec::new(),
            free: Vec::new(),
            places: HashMap::new(),
            failed: HashSet::new(),
            visible_patches: 0,
            bytes: 0,
            changes: ChangeLog::default(),
            scratch: Scratch {
                vertex_slopes: vec![[0.0; 2]; side * side].into(),
                centre_slopes: vec![[0.0; 2]; cells * cells].into(),
                all_valid: vec![1; side * side].into(),
            },
            source,
        };
        for half in 0..2 {
            node.halves[half].has_arrived = true;
            graph.draw(&mut node, half);
        }
        graph.insert(node);
        Ok(graph)
    }

    pub fn source(&self) -> &dyn DiamondSource {
        &*self.source
    }

    pub fn maker(&self) -> &PatchMaker {
        &self.maker
    }

    pub fn changes(&mut self) -> &mut ChangeLog {
        &mut self.changes
    }

    /// Patches that meet the frustum last looked through.
    pub fn visible_patches(&self) -> u64 {
        self.visible_patches
    }

    /// Bytes of all nodes and patches.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Bytes of the patches that this update hands out so far.
    pub fn uploaded(&self) -> u64 {
        self.changes.uploaded()
    }

    /// All nodes with their places.
    pub fn nodes(&self) -> impl Iterator<Item = (usize, &Node)> {
        self.nodes
            .iter()
            .enumerate()
            .filter_map(|(place, node)| Some((place, node.as_ref()?)))
    }

    pub fn node(&self, place: usize) -> Option<&Node> {
        self.nodes.get(place)?.as_ref()
    }

    pub fn place(&self, diamond: Diamond) -> Option<usize> {
        self.places.get(&diamond).copied()
    }

    /// Whether the node's own data let it be refined.
    pub fn is_refinable(&self, node: &Node) -> bool {
        !node.refined
            && !node.is_missing
            && node.level < self.source.lattice().levels()
            && (self.failed.is_empty() || !self.failed.contains(&node.diamond))
    }

    /// Judges all nodes by a view.
    pub fn look(&mut self, projection: &Projection) {
        self.visible_patches = 0;
        for node in self.nodes.iter_mut().flatten() {
            node.look(projection);
            self.visible_patches += node.visible_patches();
        }
    }

    /// What must be refined to refine the node at `place`, parents first, itself last. False if one of
    /// them cannot be.
    pub fn chain(&self, place: usize, chain: &mut Vec<usize>) -> bool {
        let Some(node) = self.node(place) else {
            return false;
        };
        if !self.is_refinable(node) {
            return false;
        }
        if !node.is_complete() {
            for parent in self
                .source
                .lattice()
                .parents(node.diamond)
                .into_iter()
                .flatten()
            {
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

    /// Upper bound of what refining a node (whose parents are refined by then) adds.
    pub fn refinement_cost(&self, node: &Node, projection: &Projection) -> Cost {
        let lattice = self.source.lattice();
        let cells = lattice.cells();
        let corners = [(0, 0), (cells, 0), (cells, cells), (0, cells)].map(|(i, j)| {
            let [column, row] = node.placement.vertex(i, j);
            self.source.frame().grid_to_world(column as f64, row as f64)
        });
        let centre = [0, 1].map(|axis| (corners[0][axis] + corners[2][axis]) / 2.0);
        let mut cost = Cost {
            patches: -(node.visible_patches() as i64),
            bytes: -(node.patches().map(|patch| patch.bytes()).sum::<u64>() as i64),
            upload: 0,
        };
        for (edge, child) in lattice.children(node.diamond).into_iter().enumerate() {
            let Some(child) = child else { continue };
            let triangle = [corners[edge], corners[(edge + 1) % 4], centre];
            cost.patches += i64::from(projection.meets(&triangle, node.bounds.z));
            cost.upload += self.maker.most_bytes();
            if !self.places.contains_key(&child) {
                cost.bytes += Node::most_bytes(lattice) as i64;
            }
        }
        cost.bytes += cost.upload as i64;
        cost
    }

    /// Upper bound of what coarsening a node adds.
    pub fn coarsening_cost(&self, node: &Node) -> Cost {
        let lattice = self.source.lattice();
        let mut cost = Cost::default();
        for half in node.halves.iter().filter(|half| half.is_present) {
            cost.patches += i64::from(half.visible);
            cost.upload += self.maker.most_bytes();
        }
        cost.bytes = cost.upload as i64;
        for child in lattice.children(node.diamond).into_iter().flatten() {
            let Some(half) = half_from(lattice, child, node.diamond) else {
                continue;
            };
            let Some(child) = self.place(child).and_then(|place| self.node(place)) else {
                continue;
            };
            if let Some(patch) = &child.halves[half].patch {
                cost.patches -= i64::from(child.halves[half].visible);
                cost.bytes -= patch.bytes() as i64;
            }
        }
        cost
    }

    /// Refines a node all of whose parents are refined. When the source fails nothing changes, but the
    /// node can no longer be refined.
    pub fn refine(&mut self, place: usize, update: u64, projection: &Projection) -> Result<()> {
        let Some(mut node) = self.check_out(place) else {
            return Ok(());
        };
        debug_assert!(node.is_complete() && !node.refined);
        let result = self.spread(&node, projection);
        match &result {
            Ok(()) => {
                node.refined = true;
                node.refined_at = update;
                for half in 0..2 {
                    self.erase(&mut node, half);
                }
                self.count_refined_child(node.diamond, 1);
            }
            Err(_) => {
                self.failed.insert(node.diamond);
            }
        }
        self.check_in(place, node);
        result
    }

    /// Gives a node's children the halves that come from it.
    fn spread(&mut self, node: &Node, projection: &Projection) -> Result<()> {
        let source = self.source.clone();
        let lattice = source.lattice();
        let refined = source.refine(node.diamond, &node.vertices)?;
        let children = lattice.children(node.diamond);
        let mut outlooks = [None; 4];
        for (outlook, child) in outlooks.iter_mut().zip(children) {
            if let Some(child) = child.filter(|child| !self.places.contains_key(child)) {
                *outlook = Some(self.child_outlook(child, node)?);
            }
        }
        self.find_slopes(node, &refined);
        for (outlook, child) in outlooks.into_iter().zip(children) {
            let Some(child) = child else { continue };
            if let Some(outlook) = outlook {
                self.insert(Node::new(&*source, child, outlook));
            }
            let Some(half) = half_from(lattice, child, node.diamond) else {
                continue;
            };
            let Some(place) = self.place(child) else {
                continue;
            };
            let Some(mut child) = self.check_out(place) else {
                continue;
            };
            self.receive(&mut child, half, node, &refined);
            child.look(projection);
            self.check_in(place, child);
        }
        Ok(())
    }

    /// What a diamond becomes a node with. `parent` is the node that is being refined.
    fn child_outlook(&self, child: Diamond, parent: &Node) -> Result<Outlook> {
        let lattice = self.source.lattice();
        let ranges = lattice.parents(child).map(|diamond| {
            let diamond = diamond?;
            if diamond == parent.diamond {
                return Some(parent.bounds.range);
            }
            self.place(diamond)
                .and_then(|place| self.node(place))
                .map(|node| node.bounds.range)
        });
        let [first, second] = match ranges {
            [Some(first), Some(second)] => [first, second],
            [Some(only), None] | [None, Some(only)] => [only, only],
            [None, None] => return Err(Error::Argument("a diamond without parents".into())),
        };
        if child.level() == lattice.levels() {
            let hull = [first[0].min(second[0]), first[1].max(second[1])];
            return Ok(Outlook::of_leaf(&*self.source, hull));
        }
        Ok(Outlook::of(
            &*self.source,
            self.source.summary(child, first)?,
        ))
    }

    /// Slopes of a node's vertices and centres on the next level into the scratch space.
    fn find_slopes(&mut self, node: &Node, refined: &Refined) {
        let (frame, [_, unit]) = (self.source.frame(), self.source.height_to_world());
        let diagonals = Diagonals::new(&node.placement, frame.step, unit);
        let heights = Heights {
            cells: self.source.lattice().cells(),
            vertices: &refined.vertices(&node.vertices).values,
            centres: &refined.centres.values,
        };
        let Scratch {
            vertex_slopes,
            centre_slopes,
            ..
        } = &mut self.scratch;
        vertex_slopes.copy_from_slice(&node.slopes);
        heights.inner_slopes(&diagonals, vertex_slopes, centre_slopes);
        if !node.halves.iter().all(|half| half.is_present)
            && let Some(present) = node.halves.iter().find(|half| half.is_present)
        {
            heights.hypotenuse_slopes(&diagonals, present.apex, vertex_slopes, centre_slopes);
        }
    }

    /// Fills a half of `child` from its refined parent and the slopes in the scratch space.
    fn receive(&mut self, child: &mut Node, half: usize, parent: &Node, refined: &Refined) {
        let source = self.source.clone();
        let (lattice, scratch) = (source.lattice(), &self.scratch);
        let (to, from) = (child.diamond, parent.diamond);
        let (vertices, centres) = (refined.vertices(&parent.vertices), &refined.centres);
        let heights = (&vertices.values[..], &centres.values[..]);
        gather_half(lattice, from, heights, to, half, &mut child.vertices.values);
        let slopes = (&scratch.vertex_slopes[..], &scratch.centre_slopes[..]);
        gather_half(lattice, from, slopes, to, half, &mut child.slopes);
        let is_masked = [vertices, centres, &child.vertices]
            .iter()
            .any(|matrix| matrix.valid.is_some());
        let mut mask = is_masked.then(|| {
            child
                .vertices
                .valid
                .take()
                .unwrap_or_else(|| scratch.all_valid.clone())
        });
        if let Some(mask) = &mut mask {
            let vertices = vertices.valid.as_deref().unwrap_or(&scratch.all_valid);
            let centres = centres.valid.as_deref().unwrap_or(&scratch.all_valid);
            gather_half(lattice, from, (vertices, centres), to, half, mask);
        }
        if let Some(absent) = child.halves.iter().find(|half| !half.is_present) {
            reflect_absent_half(lattice.cells(), absent.apex, &mut child.vertices.values);
            if let Some(mask) = &mut mask {
                reflect_absent_half(lattice.cells(), absent.apex, mask);
            }
        }
        child.vertices.valid = mask.filter(|mask| mask.contains(&0));
        // What is over this half is within the bounds of both, though neither need contain the other.
        let (own, above) = (child.bounds.z, parent.bounds.z);
        child.halves[half].z = [own[0].max(above[0]), own[1].min(above[1])];
        child.halves[half].has_arrived = true;
        self.draw(child, half);
    }

    /// Takes back a refinement; no child may be refined.
    pub fn coarsen(&mut self, place: usize, projection: &Projection) {
        let source = self.source.clone();
        let Some(mut node) = self.check_out(place) else {
            return;
        };
        debug_assert!(node.refined && node.refined_children == 0);
        for child in source
            .lattice()
            .children(node.diamond)
            .into_iter()
            .flatten()
        {
            let Some(half) = half_from(source.lattice(), child, node.diamond) else {
                continue;
            };
            let Some(place) = self.place(child) else {
                continue;
            };
            let Some(mut child) = self.check_out(place) else {
                continue;
            };
            self.erase(&mut child, half);
            child.halves[half].has_arrived = false;
            child.halves[half].visible = false;
            if child.halves.iter().any(|half| half.has_arrived) {
                child.look(projection);
                self.check_in(place, child);
            } else {
                self.places.remove(&child.diamond);
                self.free.push(place);
            }
        }
        node.refined = false;
        for half in 0..2 {
            if node.halves[half].is_present {
                self.draw(&mut node, half);
            }
        }
        self.count_refined_child(node.diamond, -1);
        self.check_in(place, node);
    }

    fn count_refined_child(&mut self, child: Diamond, change: i8) {
        for parent in self.source.lattice().parents(child).into_iter().flatten() {
            if let Some(place) = self.place(parent)
                && let Some(node) = self.nodes[place].as_mut()
            {
                node.refined_children = node.refined_children.wrapping_add_signed(change);
            }
        }
    }

    fn draw(&mut self, node: &mut Node, half: usize) {
        let patch = self
            .maker
            .make(node, half, self.changes.next_handle())
            .map(Arc::new);
        if let Some(patch) = &patch {
            self.changes.add(patch);
        }
        node.halves[half].patch = patch;
    }

    fn erase(&mut self, node: &mut Node, half: usize) {
        if let Some(patch) = node.halves[half].patch.take() {
            self.changes.remove(&patch);
        }
    }

    fn insert(&mut self, node: Node) {
        let place = self.free.pop().unwrap_or_else(|| {
            self.nodes.push(None);
            self.nodes.len() - 1
        });
        self.places.insert(node.diamond, place);
        self.check_in(place, node);
    }

    /// Takes a node out to be changed; what it counts for is put back by [`check_in`](Self::check_in).
    fn check_out(&mut self, place: usize) -> Option<Node> {
        let node = self.nodes.get_mut(place)?.take()?;
        self.visible_patches -= node.visible_patches();
        self.bytes -= node.bytes();
        Some(node)
    }

    fn check_in(&mut self, place: usize, node: Node) {
        self.visible_patches += node.visible_patches();
        self.bytes += node.bytes();
        self.nodes[place] = Some(node);
    }

    /// Every patch drawn.
    pub fn patches(&self) -> impl Iterator<Item = &Arc<Patch>> {
        self.nodes.iter().flatten().flat_map(|node| node.patches())
    }
}

/// The half of `child` that comes from `parent`.
fn half_from(lattice: &Lattice, child: Diamond, parent: Diamond) -> Option<usize> {
    lattice
        .parents(child)
        .iter()
        .position(|&candidate| candidate == Some(parent))
}
