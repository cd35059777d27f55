//! From one view to the next: the dual queue of Duchaineau et al. 1997 within budgets.

use super::changes::Changes;
use super::graph::{Cost, Graph};
use super::node::Node;
use super::patch::{GridToWorld, Patch, VertexForm};
use super::projection::Projection;
use super::{DiamondSource, View};
use crate::Result;
use crate::lattice::Diamond;
use crate::log::{LogLevel, log};
use crate::schedule::{Budget, Deadline, Ranked};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;
use std::time::Instant;

/// What is refined is kept until its error falls below this part of the tolerance.
const HYSTERESIS: f64 = 0.8;
/// A refinement is given up for another only if the other's error is larger by this factor.
const EXCHANGE: f64 = 1.05;
/// What leaves the screen is kept within this many screens.
const GUARD_BAND: f64 = 1.25;
/// Updates for which a refinement out of sight may still be waiting for others that it was made for.
const PATIENCE: u64 = 32;

/// Choices that hold for the life of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CutOptions {
    /// What the vertices of its patches hold.
    pub vertex_form: VertexForm,
}

/// What one update did, and what it left.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Refinements done.
    pub refined: u64,
    /// Refinements taken back.
    pub coarsened: u64,
    /// Patches to draw.
    pub patches: u64,
    /// Their triangles.
    pub triangles: u64,
    /// Patches, visible or not, that are drawn since this update.
    pub added: u64,
    /// Patches that are no longer drawn since this update.
    pub removed: u64,
    /// Bytes held in heights, slopes and patches.
    pub bytes: u64,
    /// Largest projected error of the patches to draw, in pixels; may be infinite. Above the tolerance where
    /// nothing was cut short: detail is missing, or could not be read.
    pub largest_error: f64,
    /// Time for judging the present cut and listing what is drawn, whatever else is done.
    pub fixed_microseconds: f64,
    /// Time of the whole update.
    pub microseconds: f64,
    /// A budget ended refinement above the tolerance.
    pub cut_short: bool,
    /// Refinements begun after the deadline: always 0.
    pub late_refinements: u64,
    /// The patch or byte budget is below what the root takes, which is shown all the same.
    pub budget_too_small: bool,
}

/// Ties: coarser diamonds first in refinement, finer ones in coarsening. The last is the node's place.
type Entry = Ranked<(Reverse<u32>, Diamond, usize)>;

/// The drawn halves of the refined part of the diamond graph, kept from frame to frame. One thread at a
/// time.
pub struct Cut {
    graph: Graph,
    triangle_strip: Box<[u16]>,
    /// What the root alone takes.
    root_cost: Cost,
    /// Entries may be stale; they are judged again when they come up.
    refinements: BinaryHeap<Entry>,
    coarsenings: BinaryHeap<Reverse<Entry>>,
    chain: Vec<usize>,
    /// Visible patches: squared distance, handle, place, half.
    order: Vec<(f64, u64, usize, usize)>,
    visible: Vec<Arc<Patch>>,
    /// The last update could have used bytes that the guard band holds.
    short_of_bytes: bool,
    updates: u64,
}

/// What an update is done with.
struct Pass<'a> {
    projection: Projection,
    tolerance: f64,
    budget: &'a Budget,
    deadline: Deadline,
    stats: Stats,
}

/// Why refinement ended.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Halt {
    /// Nothing is over the tolerance.
    Satisfied,
    /// Time, refinements or uploads of this update are used up.
    Interrupted,
    /// No room for the next refinement, in patches.
    OutOfPatches,
    /// No room for the next refinement, in bytes.
    OutOfBytes,
}

impl Cut {
    /// A cut that draws the root.
    ///
    /// # Errors
    ///
    /// Those of the source's root summary.
    pub fn new(source: Arc<dyn DiamondSource>, options: CutOptions) -> Result<Cut> {
        let graph = Graph::new(source, options.vertex_form)?;
        let root_cost = Cost {
            patches: graph.patches().count() as i64,
            bytes: graph.bytes() as i64,
            upload: 0,
        };
        Ok(Cut {
            triangle_strip: graph.maker().grid().triangle_strip().into(),
            graph,
            root_cost,
            refinements: BinaryHeap::new(),
            coarsenings: BinaryHeap::new(),
            chain: Vec::new(),
            order: Vec::new(),
            visible: Vec::new(),
            short_of_bytes: false,
            updates: 0,
        })
    }

    /// Moves the cut towards a view, as far as the budget allows. With a still view and budget it
    /// reaches a state that further updates leave as it is.
    ///
    /// A diamond whose source fails is reported to the log once and stays as it is.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`](crate::Error::Argument) for a view with numbers that are not finite, a
    /// singular matrix, a viewport without area, or a tolerance that is not above 0; the cut stays as
    /// it was.
    pub fn update(&mut self, view: &View, budget: &Budget) -> Result<Stats> {
        let began = Instant::now();
        let guard = if self.short_of_bytes { 1.0 } else { GUARD_BAND };
        let mut pass = Pass {
            projection: Projection::new(view, guard)?,
            tolerance: view.tolerance,
            budget,
            deadline: Deadline::after(began, budget.microseconds),
            stats: Stats::default(),
        };
        self.updates += 1;
        self.judge(&pass);
        let judged = began.elapsed();

        let too_small = !fits(budget, self.root_cost.patches, self.root_cost.bytes);
        self.shrink(&mut pass, too_small);
        if budget.refinements > 0 && !too_small {
            let halt = self.refine_all(&mut pass);
            if halt != Halt::Interrupted {
                self.collect(&mut pass);
            }
            self.short_of_bytes = halt == Halt::OutOfBytes;
        }

        let listing = Instant::now();
        let mut stats = pass.stats;
        self.list(view.eye, &mut stats);
        let changes = self.graph.changes().close_update();
        (stats.added, stats.removed) = (changes.added, changes.removed);
        stats.bytes = self.graph.bytes();
        stats.cut_short = self.next_refinement(view.tolerance).is_some();
        stats.budget_too_small = too_small;
        stats.fixed_microseconds = (judged + listing.elapsed()).as_secs_f64() * 1e6;
        stats.microseconds = began.elapsed().as_secs_f64() * 1e6;
        Ok(stats)
    }

    /// What the last update leaves to draw: the drawn halves that meet the frustum, near to far.
    pub fn patches(&self) -> &[Arc<Patch>] {
        &self.visible
    }

    /// Every half of the cut, in no particular order: they cover the domain.
    pub fn all_patches(&self) -> impl Iterator<Item = &Arc<Patch>> {
        self.graph.patches()
    }

    /// What became drawn and what ceased to be since the last call. The first call has the root.
    pub fn take_changes(&mut self) -> Changes {
        self.graph.changes().take()
    }

    /// Triangles of every complete patch.
    pub fn triangle_list(&self) -> &[u16] {
        self.graph.maker().triangle_list()
    }

    /// The same as one strip.
    pub fn triangle_strip(&self) -> &[u16] {
        &self.triangle_strip
    }

    /// (p, q) of every patch vertex, for compact vertices.
    pub fn grid(&self) -> &[[f32; 2]] {
        self.graph.maker().positions()
    }

    /// From grid coordinates to the world.
    pub fn grid_to_world(&self) -> GridToWorld {
        self.graph.maker().grid_to_world()
    }

    /// Judges the present cut and fills both queues.
    fn judge(&mut self, pass: &Pass) {
        self.graph.look(&pass.projection);
        self.refinements.clear();
        self.coarsenings.clear();
        for (place, node) in self.graph.nodes() {
            if is_candidate(&self.graph, node, pass.tolerance) {
                self.refinements.push(entry(node.priority, place, node));
            }
            if is_coarsenable(node) {
                self.coarsenings
                    .push(Reverse(entry(node.keep, place, node)));
            }
        }
    }

    /// Puts a node that has changed where it belongs.
    fn enqueue(&mut self, place: usize, tolerance: f64) {
        let Some(node) = self.graph.node(place) else {
            return;
        };
        if is_candidate(&self.graph, node, tolerance) {
            self.refinements.push(entry(node.priority, place, node));
        }
        if is_coarsenable(node) {
            self.coarsenings
                .push(Reverse(entry(node.keep, place, node)));
        }
    }

    /// The candidate of largest projected error, left in its queue.
    fn next_refinement(&mut self, tolerance: f64) -> Option<Entry> {
        while let Some(&top) = self.refinements.peek() {
            let (_, diamond, place) = top.item;
            let is_current = self.graph.node(place).is_some_and(|node| {
                node.diamond == diamond
                    && node.priority == top.key
                    && is_candidate(&self.graph, node, tolerance)
            });
            if is_current {
                return Some(top);
            }
            self.refinements.pop();
        }
        None
    }

    /// The refinement of least projected error that can be taken back, left in its queue.
    fn next_coarsening(&mut self) -> Option<Entry> {
        while let Some(&Reverse(least)) = self.coarsenings.peek() {
            let (_, diamond, place) = least.item;
            let is_current = self.graph.node(place).is_some_and(|node| {
                node.diamond == diamond && node.keep == least.key && is_coarsenable(node)
            });
            if is_current {
                return Some(least);
            }
            self.coarsenings.pop();
        }
        None
    }

    /// Refines by projected error until all is within the tolerance or a budget is used up.
    fn refine_all(&mut self, pass: &mut Pass) -> Halt {
        while let Some(top) = self.next_refinement(pass.tolerance) {
            let mut chain = std::mem::take(&mut self.chain);
            chain.clear();
            let refined = pass.stats.refined;
            let halt = if self.graph.chain(top.item.2, &mut chain) {
                self.refine_chain(&chain, top.key, pass)
            } else {
                self.refinements.pop();
                None
            };
            self.chain = chain;
            if pass.stats.refined > refined {
                self.discard_one(pass);
            }
            if let Some(halt) = halt {
                return halt;
            }
        }
        Halt::Satisfied
    }

    /// Refines the nodes of a chain, the last of which has projected error `error`.
    fn refine_chain(&mut self, chain: &[usize], error: f64, pass: &mut Pass) -> Option<Halt> {
        if let Some(halt) = self.make_room(chain, error, pass) {
            return Some(halt);
        }
        for &place in chain {
            let (upload, diamond) = match self.graph.node(place) {
                Some(node) => (
                    self.graph.refinement_cost(node, &pass.projection).upload,
                    node.diamond,
                ),
                None => return None,
            };
            let began = Instant::now();
            if pass.stats.refined >= pass.budget.refinements
                || pass.deadline.is_past(began)
                || !self.can_upload(upload, pass)
            {
                return Some(Halt::Interrupted);
            }
            pass.stats.late_refinements += u64::from(pass.deadline.is_past(began));
            if let Err(error) = self.graph.refine(place, self.updates, &pass.projection) {
                let Diamond { x, y, .. } = diamond;
                log(
                    LogLevel::Warning,
                    &format!("diamond ({x}, {y}) stays coarse: {error}"),
                );
                return None;
            }
            pass.stats.refined += 1;
            self.enqueue_family(diamond, place, pass.tolerance);
        }
        None
    }

    /// Coarsens what matters less until the refinement of `chain` fits.
    fn make_room(&mut self, chain: &[usize], error: f64, pass: &mut Pass) -> Option<Halt> {
        loop {
            let mut cost = Cost::default();
            for node in chain.iter().filter_map(|&place| self.graph.node(place)) {
                cost += self.graph.refinement_cost(node, &pass.projection);
            }
            let patches = self.graph.visible_patches() as i64 + cost.patches;
            let bytes = self.graph.bytes() as i64 + cost.bytes;
            if fits(pass.budget, patches, bytes) {
                return None;
            }
            let full = if bytes > clamped(pass.budget.bytes) {
                Halt::OutOfBytes
            } else {
                Halt::OutOfPatches
            };
            let Some(least) = self.next_coarsening() else {
                return Some(full);
            };
            if least.key * EXCHANGE >= error {
                return Some(full);
            }
            if self.is_parent_of_any(least.item.1, chain) {
                self.coarsenings.pop();
            } else if !self.try_coarsen(least, pass) {
                return Some(Halt::Interrupted);
            }
        }
    }

    fn is_parent_of_any(&self, parent: Diamond, places: &[usize]) -> bool {
        let lattice = self.graph.source().lattice();
        let mut nodes = places.iter().filter_map(|&place| self.graph.node(place));
        nodes.any(|node| lattice.parents(node.diamond).contains(&Some(parent)))
    }

    fn can_upload(&self, bytes: u64, pass: &Pass) -> bool {
        self.graph.uploaded().saturating_add(bytes) <= pass.budget.upload_bytes
    }

    fn coarsening_cost(&self, entry: Entry) -> Cost {
        let node = self.graph.node(entry.item.2);
        node.map(|node| self.graph.coarsening_cost(node))
            .unwrap_or_default()
    }

    fn coarsen(&mut self, entry: Entry, pass: &mut Pass) {
        let (_, diamond, place) = entry.item;
        self.graph.coarsen(place, &pass.projection);
        pass.stats.coarsened += 1;
        self.enqueue_family(diamond, place, pass.tolerance);
    }

    /// Puts a refined or coarsened node, its children and its parents where they belong.
    fn enqueue_family(&mut self, diamond: Diamond, place: usize, tolerance: f64) {
        let lattice = self.graph.source().lattice();
        let (children, parents) = (lattice.children(diamond), lattice.parents(diamond));
        self.enqueue(place, tolerance);
        for relative in children.into_iter().chain(parents).flatten() {
            if let Some(place) = self.graph.place(relative) {
                self.enqueue(place, tolerance);
            }
        }
    }

    /// Coarsens until the cut is within the patch and byte budgets, or down to the root.
    fn shrink(&mut self, pass: &mut Pass, to_root: bool) {
        let is_over = |graph: &Graph| {
            !fits(
                pass.budget,
                graph.visible_patches() as i64,
                graph.bytes() as i64,
            )
        };
        while to_root || is_over(&self.graph) {
            let Some(least) = self.next_coarsening() else {
                return;
            };
            self.coarsen(least, pass);
        }
    }

    /// Coarsens what is well under the tolerance, while time and uploads last.
    fn collect(&mut self, pass: &mut Pass) {
        while let Some(least) = self.next_coarsening() {
            if least.key >= HYSTERESIS * pass.tolerance || !self.try_coarsen(least, pass) {
                return;
            }
        }
    }

    /// Coarsens one diamond that has been out of sight for long. Refining pays for it, so that
    /// garbage cannot pile up while budgets always end before [`collect`](Self::collect).
    fn discard_one(&mut self, pass: &mut Pass) {
        while let Some(least) = self.next_coarsening().filter(|least| least.key == 0.0) {
            let node = self.graph.node(least.item.2);
            if node.is_some_and(|node| node.refined_at + PATIENCE < self.updates) {
                self.try_coarsen(least, pass);
                return;
            }
            self.coarsenings.pop();
        }
    }

    /// Coarsens unless that would exceed a budget (a coarse patch may be visible where its finer ones
    /// were not); then the diamond leaves the queue. False when there is no time or upload left.
    fn try_coarsen(&mut self, entry: Entry, pass: &mut Pass) -> bool {
        let cost = self.coarsening_cost(entry);
        if pass.deadline.is_past(Instant::now()) || !self.can_upload(cost.upload, pass) {
            return false;
        }
        let patches = self.graph.visible_patches() as i64 + cost.patches;
        let bytes = self.graph.bytes() as i64 + cost.bytes;
        if fits(pass.budget, patches, bytes) {
            self.coarsen(entry, pass);
        } else {
            self.coarsenings.pop();
        }
        true
    }

    /// Lists the visible patches near to far.
    fn list(&mut self, eye: [f64; 3], stats: &mut Stats) {
        self.order.clear();
        let all_triangles = self.triangle_list().len();
        for (place, node) in self.graph.nodes() {
            for (index, half) in node.halves.iter().enumerate() {
                let Some(patch) = half.patch.as_ref().filter(|_| half.visible) else {
                    continue;
                };
                let indices = patch
                    .indices
                    .as_ref()
                    .map_or(all_triangles, |list| list.len());
                stats.triangles += indices as u64 / 3;
                stats.largest_error = stats.largest_error.max(node.priority);
                self.order.push((
                    squared_distance(eye, &patch.bounds),
                    patch.handle,
                    place,
                    index,
                ));
            }
        }
        self.order
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        stats.patches = self.order.len() as u64;
        self.visible.clear();
        for &(_, _, place, half) in &self.order {
            let node = self.graph.node(place);
            self.visible
                .extend(node.and_then(|node| node.halves[half].patch.clone()));
        }
    }
}

fn is_candidate(graph: &Graph, node: &Node, tolerance: f64) -> bool {
    node.priority > tolerance && graph.is_refinable(node)
}

fn is_coarsenable(node: &Node) -> bool {
    node.refined && node.refined_children == 0
}

fn entry(key: f64, place: usize, node: &Node) -> Entry {
    Ranked {
        key,
        item: (Reverse(node.level), node.diamond, place),
    }
}

fn clamped(limit: u64) -> i64 {
    i64::try_from(limit).unwrap_or(i64::MAX)
}

fn fits(budget: &Budget, patches: i64, bytes: i64) -> bool {
    patches <= clamped(budget.patches) && bytes <= clamped(budget.bytes)
}

fn squared_distance(eye: [f64; 3], [low, high]: &[[f64; 3]; 2]) -> f64 {
    let axis = |axis: usize| {
        let beyond = (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0);
        beyond * beyond
    };
    axis(0) + axis(1) + axis(2)
}
