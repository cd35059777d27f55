//! A parallel map whose results are consumed in order, so that threads never change the output.

use crossbeam::channel;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Threads for `requested`, where 0 means all that the machine has.
pub(super) fn thread_count(requested: usize) -> usize {
    let available = || std::thread::available_parallelism().map_or(1, |count| count.get());
    if requested == 0 {
        available()
    } else {
        requested
    }
}

/// Applies `work` to every index below `count` on `threads` threads and hands the results, in the order
/// of their indices, to `consume` on this thread. Stops at its first error.
pub(super) fn map_in_order<R: Send, E>(
    threads: usize,
    count: usize,
    work: impl Fn(usize) -> R + Sync,
    mut consume: impl FnMut(usize, R) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let (sender, receiver) = channel::bounded(4 * threads);
    std::thread::scope(|scope| {
        for _ in 0..threads.min(count) {
            let (sender, next, work) = (sender.clone(), &next, &work);
            scope.spawn(move || {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count || sender.send((index, work(index))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        // Dropped on return, which ends workers that wait to send.
        let receiver = receiver;
        let mut early = BTreeMap::new();
        let mut due = 0;
        for (index, result) in &receiver {
            early.insert(index, result);
            while let Some(result) = early.remove(&due) {
                consume(due, result)?;
                due += 1;
            }
        }
        Ok(())
    })
}
