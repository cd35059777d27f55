//! Floor 2: budgets, deadlines, priorities, and threads that serve them. Knows nothing of what is scheduled.

mod budget;
mod deadline;
mod handover;
mod parallel;
mod ranked;
mod workers;

pub use budget::Budget;
pub use deadline::Deadline;
pub use handover::Handover;
pub use parallel::{map_in_order, map_taken, thread_count};
pub use ranked::Ranked;
pub use workers::Workers;

/// What a model checker puts others in the place of.
mod sync {
    pub use std::sync::{Condvar, Mutex, MutexGuard};
}
