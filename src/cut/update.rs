//! From one view to the next: the dual queue of Duchaineau et al. 1997 within budgets.

mod requests;

use super::beyond::Detail;
use super::changes::Changes;
use super::colours::Colouring;
use super::foresight::Impasse;
use super::graph::Graph;
use super::patch::{GridToWorld, Patch, PatchMaker, VertexForm};
use super::projection::{Projection, Scale};
use super::queues::{Entry, Queues};
use super::samples::Ground;
use super::skeleton::{Cost, Shortage, Skeleton};
use super::{DiamondSource, Metric, View};
use crate::Error;
use crate::lattice::{Diamond, Lattice};
use crate::log::{LogLevel, log};
use crate::schedule::{Budget, Deadline};
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

/// Before there was any.
const NO_VIEW: View = View {
    eye: [0.0; 3],
    world_to_clip: [0.0; 16],
    viewport: [0.0; 2],
    tolerance: 0.0,
};

/// Choices that hold for the life of a cut.
#[derive(Clone, Debug)]
pub struct CutOptions {
    /// What the vertices of its patches hold.
    pub vertex_form: VertexForm,
    /// What tolerances are about.
    pub metric: Metric,
    /// Threads that decode; with 0, updates decode for themselves.
    pub threads: usize,
    /// Colours on it. Where they are finer than heights, heights are divided; where they are coarser, they are.
    pub colours: Option<Colouring>,
    /// Detail beyond the finest heights.
    pub detail: Detail,
    /// Patches tell where their vertices came from.
    pub births: bool,
}

impl CutOptions {
    /// Heights by themselves, in expanded form, decoded by the updates.
    pub const DEFAULT: CutOptions = CutOptions {
        vertex_form: VertexForm::Expanded,
        metric: Metric::Geometric,
        threads: 0,
        colours: None,
        detail: Detail {
            levels: 0,
            roughness: 0.0,
        },
        births: false,
    };
}

impl Default for CutOptions {
    fn default() -> CutOptions {
        CutOptions::DEFAULT
    }
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
    /// Bytes of the patches added.
    pub uploaded: u64,
    /// Bytes set aside for heights, slopes and patches: enough for the masks and the lists of triangles of all that
    /// may have voids or lie at the border.
    pub bytes: u64,
    /// Largest projected error of the patches to draw, in pixels by the metric; may be infinite. Above the tolerance where
    /// nothing was cut short: detail is missing, or could not be read.
    pub largest_error: f64,
    /// Time for judging the present cut and listing what is drawn, whatever else is done.
    pub fixed_microseconds: f64,
    /// Time of the whole update.
    pub microseconds: f64,
    /// A budget ended refinement above the tolerance, or details have yet to come.
    pub cut_short: bool,
    /// Diamonds whose details were asked for and have not come.
    pub awaited: u64,
    /// Refinements begun after the deadline: always 0.
    pub late_refinements: u64,
    /// The patch or byte budget is below what the root takes, which is shown all the same.
    pub budget_too_small: bool,
}

/// The drawn halves of the refined part of the diamond graph, kept from frame to frame. One thread at a
/// time.
pub struct Cut {
    graph: Graph,
    scale: Scale,
    threads: usize,
    triangle_strip: Box<[u16]>,
    /// Halves drawn of the root alone, and its bytes.
    root: [u64; 2],
    queues: Queues,
    chain: Vec<usize>,
    /// Visible patches: squared distance, handle, place, half.
    order: Vec<(f64, u64, usize, usize)>,
    visible: Vec<Arc<Patch>>,
    /// The last update could have used bytes that the guard band holds.
    short_of_bytes: bool,
    /// The view and budget with which a way out of an impasse was looked for last.
    impasse: (View, Budget),
    /// There was none, and the cut has not changed since.
    no_way_out: bool,
    /// The last update's.
    last_view: View,
    updates: u64,
}

/// What an update is done with.
struct Pass<'a> {
    view: &'a View,
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
    /// No room for the next refinement.
    Full(Shortage),
}

impl Cut {
    /// A cut that draws the root.
    ///
    /// # Errors
    ///
    /// Those of the source's root summary; [`Error::Input`](crate::Error::Input) for colours that are not over its domain;
    /// [`Error::Argument`](crate::Error::Argument) for options that cannot be; [`Error::Io`](crate::Error::Io) where the
    /// system starts no more threads.
    pub fn new(source: Arc<dyn DiamondSource>, options: CutOptions) -> crate::Result<Cut> {
        let ground = Ground::of(source, options.colours.as_ref(), options.detail)?;
        let colours = ground.colours.as_ref();
        let scale = Scale {
            metric: options.metric,
            cells: ground.heights.lattice().cells(),
            texels: colours.map(|all| (all.lattice().cells(), all.texel_pixels)),
        };
        let maker = PatchMaker::new(&ground, options.vertex_form, options.births);
        let graph = Graph::new(ground, maker, options.threads)?;
        let skeleton = graph.skeleton();
        let drawn = skeleton.nodes().map(|(_, node)| node.drawn_halves()).sum();
        Ok(Cut {
            triangle_strip: graph.maker().grid().triangle_strip().into(),
            root: [drawn, skeleton.bytes()],
            graph,
            scale,
            threads: options.threads,
            queues: Queues::default(),
            chain: Vec::new(),
            order: Vec::new(),
            visible: Vec::new(),
            short_of_bytes: false,
            impasse: (NO_VIEW, Budget::UNLIMITED),
            no_way_out: false,
            last_view: NO_VIEW,
            updates: 0,
        })
    }

    /// Moves the cut towards a view, as far as the budget allows. With a still view and budget it
    /// reaches a state that further updates leave as it is.
    ///
    /// With threads that decode, an update never waits for them: what has not come is asked for, and the surface stays as
    /// it is until it has.
    ///
    /// A diamond whose source fails is reported to the log once and stays as it is.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`](crate::Error::Argument) for a view with numbers that are not finite, a
    /// singular matrix, a viewport without area, or a tolerance that is not above 0; the cut stays as
    /// it was.
    pub fn update(&mut self, view: &View, budget: &Budget) -> crate::Result<Stats> {
        let began = Instant::now();
        let guard = if self.short_of_bytes { 1.0 } else { GUARD_BAND };
        let reserve = self.graph.supply().reserve(budget.bytes);
        let budget = &Budget {
            bytes: budget.bytes.saturating_sub(reserve),
            ..*budget
        };
        let mut pass = Pass {
            view,
            projection: Projection::new(view, guard, self.scale)?,
            tolerance: view.tolerance,
            budget,
            deadline: Deadline::after(began, budget.microseconds),
            stats: Stats::default(),
        };
        self.updates += 1;
        self.graph.supply().begin();
        self.graph.skeleton_mut().look(&pass.projection);
        self.queues.fill(self.graph.skeleton(), pass.tolerance);
        let judged = began.elapsed();

        let [patches, bytes] = self.root;
        let too_small = patches > budget.patches || bytes > budget.bytes;
        self.shrink(&mut pass, too_small);
        if budget.refinements > 0 && !too_small {
            let mut halt = self.refine_all(&mut pass);
            while matches!(halt, Halt::Full(_)) && self.start_again(&mut pass) {
                halt = self.refine_all(&mut pass);
            }
            // What waits may need what is out of sight.
            if halt != Halt::Interrupted && !self.skeleton().is_waiting() {
                self.collect(&mut pass);
            }
            if halt == Halt::Satisfied && self.threads > 0 {
                self.look_ahead(&pass, guard);
            }
            self.short_of_bytes = halt == Halt::Full(Shortage::Bytes);
        }

        let listing = Instant::now();
        let mut stats = pass.stats;
        stats.awaited = self.graph.ask();
        self.last_view = *view;
        self.list(view.eye, &mut stats);
        self.graph.sweep(budget.bytes);
        let changes = self.graph.changes().close_update();
        (stats.added, stats.removed) = (changes.added, changes.removed);
        stats.uploaded = changes.uploaded;
        let skeleton = self.graph.skeleton();
        stats.bytes = skeleton.bytes() + reserve;
        let next = self.queues.next_refinement(skeleton, view.tolerance);
        stats.cut_short = stats.awaited > 0 || next.is_some();
        stats.budget_too_small = too_small;
        stats.fixed_microseconds = (judged + listing.elapsed()).as_secs_f64() * 1e6;
        stats.microseconds = began.elapsed().as_secs_f64() * 1e6;
        Ok(stats)
    }

    /// The diamonds that there may be. Its samples are what grid coordinates count: finer than those of the source, where
    /// there are colours or detail beyond.
    pub fn lattice(&self) -> &Lattice {
        self.skeleton().source().lattice()
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

    /// The candidate of largest projected error, left in its queue.
    fn next_refinement(&mut self, pass: &Pass) -> Option<Entry> {
        self.queues
            .next_refinement(self.graph.skeleton(), pass.tolerance)
    }

    /// The refinement of least projected error that can be taken back, left in its queue.
    fn next_coarsening(&mut self) -> Option<Entry> {
        self.queues.next_coarsening(self.graph.skeleton())
    }

    /// Refines by projected error until all is within the tolerance or a budget is used up.
    fn refine_all(&mut self, pass: &mut Pass) -> Halt {
        while let Some(top) = self.next_refinement(pass) {
            let mut chain = std::mem::take(&mut self.chain);
            chain.clear();
            let refined = pass.stats.refined;
            let end = if self.graph.skeleton().chain(top.item.2, &mut chain) {
                self.refine_chain(&chain, top.key, pass)
            } else {
                self.queues.skip_refinement();
                Ok(())
            };
            self.chain = chain;
            if pass.stats.refined > refined {
                self.discard_one(pass);
            }
            if let Err(halt) = end {
                return halt;
            }
        }
        Halt::Satisfied
    }

    /// Refines the nodes of a chain, the last of which has projected error `error`, if all their details are there.
    fn refine_chain(&mut self, chain: &[usize], error: f64, pass: &mut Pass) -> Result<(), Halt> {
        if !self.is_supplied(chain, error, pass)? {
            return Ok(());
        }
        self.make_room(chain, error, pass)?;
        for &place in chain {
            let skeleton = self.graph.skeleton();
            let (upload, diamond) = match skeleton.node(place) {
                Some(node) => (skeleton.refinement_upload(node), node.diamond),
                None => return Ok(()),
            };
            let began = Instant::now();
            if pass.stats.refined >= pass.budget.refinements
                || pass.deadline.is_past(began)
                || !self.can_upload(upload, pass)
            {
                return Err(Halt::Interrupted);
            }
            pass.stats.late_refinements += u64::from(pass.deadline.is_past(began));
            if let Err(error) = self.graph.refine(place, self.updates, &pass.projection) {
                self.give_up(diamond, &error);
                return Ok(());
            }
            pass.stats.refined += 1;
            self.push_family(diamond, pass);
        }
        Ok(())
    }

    fn give_up(&mut self, diamond: Diamond, error: &Error) {
        self.graph.skeleton_mut().give_up(diamond);
        let Diamond { x, y, .. } = diamond;
        let message = format!("diamond ({x}, {y}) stays coarse: {error}");
        log(LogLevel::Warning, &message);
    }

    /// Coarsens what matters less until the refinement of `chain` fits.
    fn make_room(&mut self, chain: &[usize], error: f64, pass: &mut Pass) -> Result<(), Halt> {
        loop {
            let skeleton = self.graph.skeleton_mut();
            let shortage = skeleton.shortage(chain, &pass.projection, pass.budget);
            let Some(shortage) = shortage else {
                return Ok(());
            };
            let least = self.next_coarsening();
            let Some(least) = least.filter(|least| least.key * EXCHANGE < error) else {
                return Err(Halt::Full(shortage));
            };
            if self.is_parent_of_any(least.item.1, chain) {
                self.queues.skip_coarsening();
            } else if !self.try_coarsen(least, pass) {
                return Err(Halt::Interrupted);
            }
        }
    }

    /// Out of an impasse, where a fresh cut would come to errors smaller by more than the factor of exchange: gives up
    /// all that was not refined for an error above that of the impasse. False where nothing changes. Only once nothing
    /// else has changed, and of a still view once for all.
    fn start_again(&mut self, pass: &mut Pass) -> bool {
        let change = pass.stats.refined + pass.stats.coarsened;
        let still = (*pass.view, *pass.budget);
        if change > 0
            || self.skeleton().is_waiting()
            || pass.deadline.is_past(Instant::now())
            || (self.no_way_out && self.impasse == still)
        {
            return false;
        }
        let Some(error) = self.next_refinement(pass).map(|next| next.key) else {
            return false;
        };
        let impasse = Impasse {
            skeleton: self.graph.skeleton(),
            projection: &pass.projection,
            budget: pass.budget,
            error,
            goal: (error / EXCHANGE).min(f64::MAX).max(pass.tolerance),
        };
        let way_out = impasse.way_out();
        (self.impasse, self.no_way_out) = (still, true);
        for diamond in way_out.into_iter().flatten() {
            let Some(place) = self.skeleton().place(diamond) else {
                continue;
            };
            if !self.can_upload(self.coarsening_cost(place).upload, pass) {
                break;
            }
            self.coarsen(diamond, place, pass);
        }
        self.shrink(pass, false);
        pass.stats.coarsened > 0
    }

    fn skeleton(&self) -> &Skeleton {
        self.graph.skeleton()
    }

    fn is_parent_of_any(&self, parent: Diamond, places: &[usize]) -> bool {
        let skeleton = self.skeleton();
        let lattice = skeleton.source().lattice();
        let mut nodes = places.iter().filter_map(|&place| skeleton.node(place));
        nodes.any(|node| lattice.parents(node.diamond).contains(&Some(parent)))
    }

    fn can_upload(&self, bytes: u64, pass: &Pass) -> bool {
        self.graph.uploaded().saturating_add(bytes) <= pass.budget.upload_bytes
    }

    fn coarsening_cost(&self, place: usize) -> Cost {
        let node = self.skeleton().node(place);
        node.map(|node| self.skeleton().coarsening_cost(node))
            .unwrap_or_default()
    }

    fn coarsen(&mut self, diamond: Diamond, place: usize, pass: &mut Pass) {
        self.graph.coarsen(place, &pass.projection);
        pass.stats.coarsened += 1;
        self.push_family(diamond, pass);
    }

    fn push_family(&mut self, diamond: Diamond, pass: &Pass) {
        self.no_way_out = false;
        self.queues
            .push_family(self.graph.skeleton(), diamond, pass.tolerance);
    }

    /// Coarsens until the cut is within the patch and byte budgets, or down to the root.
    fn shrink(&mut self, pass: &mut Pass, to_root: bool) {
        while to_root || self.skeleton().excess(pass.budget).is_some() {
            let Some(least) = self.next_coarsening() else {
                return;
            };
            self.coarsen(least.item.1, least.item.2, pass);
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
            let node = self.skeleton().node(least.item.2);
            if node.is_some_and(|node| node.refined_at + PATIENCE < self.updates) {
                self.try_coarsen(least, pass);
                return;
            }
            self.queues.skip_coarsening();
        }
    }

    /// Coarsens unless that would exceed a budget (a coarse patch may be visible where its finer ones
    /// were not); then the diamond leaves the queue. False when there is no time or upload left.
    fn try_coarsen(&mut self, entry: Entry, pass: &mut Pass) -> bool {
        let (_, diamond, place) = entry.item;
        let cost = self.coarsening_cost(place);
        if pass.deadline.is_past(Instant::now()) || !self.can_upload(cost.upload, pass) {
            return false;
        }
        let after = |now: u64, change: i64| now.saturating_add_signed(change);
        let (patches, bytes) = (self.skeleton().visible_patches(), self.skeleton().bytes());
        if after(patches, cost.patches) <= pass.budget.patches
            && after(bytes, cost.bytes) <= pass.budget.bytes
        {
            self.coarsen(diamond, place, pass);
        } else {
            self.queues.skip_coarsening();
        }
        true
    }

    /// Lists the visible patches near to far.
    fn list(&mut self, eye: [f64; 3], stats: &mut Stats) {
        self.order.clear();
        let all_triangles = self.triangle_list().len();
        for (place, node) in self.graph.skeleton().nodes() {
            for (index, half) in node.halves.iter().enumerate() {
                if node.refined || !half.visible {
                    continue;
                }
                let Some(patch) = self.graph.patch(place, index) else {
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
        self.visible.truncate(self.order.len());
        for (index, &(_, handle, place, half)) in self.order.iter().enumerate() {
            let Some(patch) = self.graph.patch(place, half) else {
                continue;
            };
            match self.visible.get_mut(index) {
                Some(old) if old.handle == handle => {}
                Some(old) => *old = patch.clone(),
                None => self.visible.push(patch.clone()),
            }
        }
    }
}

fn squared_distance(eye: [f64; 3], [low, high]: &[[f64; 3]; 2]) -> f64 {
    let axis = |axis: usize| {
        let beyond = (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0);
        beyond * beyond
    };
    axis(0) + axis(1) + axis(2)
}
