//! Whether a cut that has no room for its next refinement holds what a fresh one would not, and could be better.
//!
//! By order of projected error, a fresh cut refines all whose error is above some bound, and what that needs,
//! before anything below the bound. A cut that has come from another view and is stuck at an error has all above it
//! refined too, and beside that what it has not given up: what is as good within the factor of exchange, what has
//! left the screen but not the guard band, and what would for a moment be more to draw if it were coarsened. From the
//! refinements above the error alone, the way on is the fresh cut's, step by step.

use super::projection::Projection;
use super::queues::Queues;
use super::skeleton::Skeleton;
use crate::lattice::Diamond;
use crate::schedule::Budget;

/// The cut that is stuck, and what it is to be measured by.
pub(super) struct Impasse<'a> {
    pub skeleton: &'a Skeleton,
    pub projection: &'a Projection,
    pub budget: &'a Budget,
    /// The largest error of what can be refined, but for the budget.
    pub error: f64,
    /// The error, less than that, which is worth to start again for.
    pub goal: f64,
}

impl Impasse<'_> {
    /// What to coarsen, in this order, so that refinement by projected error then fits, step by step, until no error
    /// is above the goal. `None` where a fresh cut does not come so far.
    pub fn way_out(&self) -> Option<Vec<Diamond>> {
        let mut trial = self.skeleton.clone();
        let needless = self.coarsen_needless(&mut trial);
        if needless.is_empty() {
            return None;
        }
        let mut queues = Queues::default();
        let mut chain = Vec::new();
        queues.fill(&trial, self.goal);
        while let Some(next) = queues.next_refinement(&trial, self.goal) {
            let (_, diamond, place) = next.item;
            chain.clear();
            if !trial.chain(place, &mut chain) {
                queues.skip_refinement();
                continue;
            }
            for &place in &chain {
                let link = trial.node(place)?.diamond;
                if trial.refine(place, 0, self.projection).is_err() {
                    trial.give_up(diamond);
                    break;
                }
                if trial.excess(self.budget).is_some() {
                    return None;
                }
                queues.push_family(&trial, link, self.goal);
            }
        }
        Some(needless)
    }

    /// Coarsens all that is not refined for an error above that of the impasse.
    fn coarsen_needless(&self, trial: &mut Skeleton) -> Vec<Diamond> {
        let mut refined: Vec<(u32, Diamond)> = trial
            .nodes()
            .filter(|(_, node)| node.refined)
            .map(|(_, node)| (node.level, node.diamond))
            .collect();
        refined.sort_unstable_by(|a, b| b.cmp(a));
        let mut needless = Vec::new();
        for (_, diamond) in refined {
            let is_needless = |place: &usize| {
                let node = trial.node(*place);
                node.is_some_and(|node| node.refined_children == 0 && node.priority <= self.error)
            };
            if let Some(place) = trial.place(diamond).filter(is_needless) {
                trial.coarsen(place, self.projection);
                needless.push(diamond);
            }
        }
        needless
    }
}
