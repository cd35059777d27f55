//! The moment after which nothing may begin.

use std::time::{Duration, Instant};

/// A moment in time, or never.
#[derive(Clone, Copy, Debug)]
pub struct Deadline(Option<Instant>);

impl Deadline {
    /// `microseconds` after `start`; never for [`Budget::NO_LIMIT`](super::Budget::NO_LIMIT) and for
    /// what the clock cannot hold.
    pub fn after(start: Instant, microseconds: u64) -> Deadline {
        if microseconds == super::Budget::NO_LIMIT {
            return Deadline(None);
        }
        Deadline(start.checked_add(Duration::from_micros(microseconds)))
    }

    /// Whether `moment` is at the deadline or after it.
    pub fn is_past(&self, moment: Instant) -> bool {
        self.0.is_some_and(|deadline| moment >= deadline)
    }
}
