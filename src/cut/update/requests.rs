//! What the threads of a cut are asked for.

use super::{Cut, EXCHANGE, Halt, Pass};
use crate::cut::projection::Projection;
use std::time::Instant;

/// Updates ahead for which the camera is taken to move on as it does.
const FORESIGHT: f64 = 4.0;

impl Cut {
    /// Whether all details of a chain are there. Asks for those that are not, if there is or can be room for the chain; its
    /// last node is then no candidate in this update. No chain is begun that cannot be ended, or two of them could undo
    /// each other's beginnings for ever.
    pub(super) fn is_supplied(
        &mut self,
        chain: &[usize],
        error: f64,
        pass: &Pass,
    ) -> Result<bool, Halt> {
        if self.threads == 0 {
            return Ok(true);
        }
        let mut missing = Vec::new();
        for &place in chain {
            let Some(diamond) = self.skeleton().node(place).map(|node| node.diamond) else {
                continue;
            };
            if let Some(error) = self.graph.supply().take_failure(diamond) {
                self.give_up(diamond, &error);
                return Ok(false);
            }
            if !self.graph.supply().has(diamond) {
                missing.push(diamond);
            }
        }
        if missing.is_empty() {
            return Ok(true);
        }
        let skeleton = self.graph.skeleton_mut();
        let shortage = skeleton.shortage(chain, &pass.projection, pass.budget);
        let least = self.next_coarsening();
        let can_exchange = least.is_some_and(|least| least.key * EXCHANGE < error);
        if let Some(shortage) = shortage.filter(|_| !can_exchange) {
            return Err(Halt::Full(shortage));
        }
        for diamond in missing {
            if pass.deadline.is_past(Instant::now()) || !self.graph.supply().want(diamond, error) {
                return Err(Halt::Interrupted);
            }
        }
        let last = chain.last().and_then(|&place| self.skeleton().node(place));
        if let Some(diamond) = last.map(|node| node.diamond) {
            self.graph.skeleton_mut().wait_for(diamond);
        }
        Ok(false)
    }

    /// Asks for what is just outside the screen, and for what will be on it if the camera moves on as it does.
    pub(super) fn look_ahead(&mut self, pass: &Pass, guard: f64) {
        let ahead = pass.view.after(&self.last_view, FORESIGHT);
        let projection = Projection::new(&ahead, guard, self.scale);
        let projection = projection.as_ref().unwrap_or(&pass.projection);
        for place in self.skeleton().places() {
            let skeleton = self.skeleton();
            let node = skeleton.node(place).filter(|node| {
                node.is_on_the_cut() && node.is_complete() && skeleton.is_refinable(node)
            });
            let error = node.map(|node| (node.diamond, node.error_seen_by(projection)));
            let Some((diamond, error)) = error.filter(|(_, error)| *error > pass.tolerance) else {
                continue;
            };
            let supply = self.graph.supply();
            if !supply.has(diamond) && !supply.want_later(diamond, error) {
                return;
            }
        }
    }
}
