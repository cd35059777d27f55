//! The dual queue: what may be refined and what may be coarsened, by projected error.

use super::node::Node;
use super::skeleton::Skeleton;
use crate::lattice::Diamond;
use crate::schedule::Ranked;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Ties: coarser diamonds first in refinement, finer ones in coarsening. The last is the node's place.
pub(super) type Entry = Ranked<(Reverse<u32>, Diamond, usize)>;

/// Entries may be stale; they are judged again when they come up.
#[derive(Default)]
pub(super) struct Queues {
    refinements: BinaryHeap<Entry>,
    coarsenings: BinaryHeap<Reverse<Entry>>,
}

impl Queues {
    /// Fills both from all nodes. What is within `tolerance` is no candidate for refinement.
    pub fn fill(&mut self, skeleton: &Skeleton, tolerance: f64) {
        self.refinements.clear();
        self.coarsenings.clear();
        for (place, node) in skeleton.nodes() {
            self.push(skeleton, place, node, tolerance);
        }
    }

    /// Puts a node that was refined or coarsened, its children and its parents where they belong.
    pub fn push_family(&mut self, skeleton: &Skeleton, diamond: Diamond, tolerance: f64) {
        let lattice = skeleton.source().lattice();
        let (children, parents) = (lattice.children(diamond), lattice.parents(diamond));
        let relatives = children.into_iter().chain(parents).flatten();
        for relative in std::iter::once(diamond).chain(relatives) {
            if let Some(place) = skeleton.place(relative)
                && let Some(node) = skeleton.node(place)
            {
                self.push(skeleton, place, node, tolerance);
            }
        }
    }

    fn push(&mut self, skeleton: &Skeleton, place: usize, node: &Node, tolerance: f64) {
        if is_candidate(skeleton, node, tolerance) {
            self.refinements.push(entry(node.priority, place, node));
        }
        if is_coarsenable(node) {
            let entry = entry(node.keep, place, node);
            self.coarsenings.push(Reverse(entry));
        }
    }

    /// The candidate of largest projected error, left in its queue.
    pub fn next_refinement(&mut self, skeleton: &Skeleton, tolerance: f64) -> Option<Entry> {
        while let Some(&top) = self.refinements.peek() {
            let (_, diamond, place) = top.item;
            let is_current = skeleton.node(place).is_some_and(|node| {
                node.diamond == diamond
                    && node.priority == top.key
                    && is_candidate(skeleton, node, tolerance)
            });
            if is_current {
                return Some(top);
            }
            self.refinements.pop();
        }
        None
    }

    /// Leaves out the first candidate for refinement.
    pub fn skip_refinement(&mut self) {
        self.refinements.pop();
    }

    /// The refinement of least projected error that can be taken back, left in its queue.
    pub fn next_coarsening(&mut self, skeleton: &Skeleton) -> Option<Entry> {
        while let Some(&Reverse(least)) = self.coarsenings.peek() {
            let (_, diamond, place) = least.item;
            let is_current = skeleton.node(place).is_some_and(|node| {
                node.diamond == diamond && node.keep == least.key && is_coarsenable(node)
            });
            if is_current {
                return Some(least);
            }
            self.coarsenings.pop();
        }
        None
    }

    /// Leaves out the first candidate for coarsening.
    pub fn skip_coarsening(&mut self) {
        self.coarsenings.pop();
    }
}

fn is_candidate(skeleton: &Skeleton, node: &Node, tolerance: f64) -> bool {
    node.priority > tolerance && skeleton.is_refinable(node)
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
