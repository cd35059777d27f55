//! Floor 2: budgets, deadlines, priorities. Knows nothing of what is scheduled.

mod budget;
mod deadline;
mod ranked;

pub use budget::Budget;
pub use deadline::Deadline;
pub use ranked::Ranked;
