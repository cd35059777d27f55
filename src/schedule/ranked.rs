//! Items of a priority queue.

use std::cmp::Ordering;

/// An item with its rank in a heap. Items of equal key are ordered among themselves, so that the order
/// never depends on that of insertion.
#[derive(Clone, Copy, Debug)]
pub struct Ranked<T> {
    /// Greater is first in a max-heap; may be infinite.
    pub key: f64,
    /// What is ranked.
    pub item: T,
}

impl<T: Ord> Ord for Ranked<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.key
            .total_cmp(&other.key)
            .then_with(|| self.item.cmp(&other.item))
    }
}

impl<T: Ord> PartialOrd for Ranked<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T: Ord> PartialEq for Ranked<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl<T: Ord> Eq for Ranked<T> {}
