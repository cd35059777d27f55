//! A parallel map whose results are consumed in order, so that threads never change the output.

use crossbeam::channel;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

/// Threads for `requested`, where 0 means all that the machine has.
pub fn thread_count(requested: usize) -> usize {
    let available = || std::thread::available_parallelism().map_or(1, |count| count.get());
    if requested == 0 {
        available()
    } else {
        requested
    }
}

/// Applies `work` to every index below `count` on `threads` threads and hands the results, in the order
/// of their indices, to `consume` on this thread. Stops at its first error. One thread is this one.
pub fn map_in_order<R: Send, E>(
    threads: usize,
    count: usize,
    work: impl Fn(usize) -> R + Sync,
    consume: impl FnMut(usize, R) -> Result<(), E>,
) -> Result<(), E> {
    map_taken(
        threads.min(count),
        0..count,
        |_, index| work(index),
        consume,
    )
}

/// As [`map_in_order`], for what `items` gives, which one thread at a time asks for the next.
pub fn map_taken<T, R: Send, E>(
    threads: usize,
    mut items: impl Iterator<Item = T> + Send,
    work: impl Fn(usize, T) -> R + Sync,
    mut consume: impl FnMut(usize, R) -> Result<(), E>,
) -> Result<(), E> {
    if threads < 2 {
        let mut all = items.enumerate();
        return all.try_for_each(|(index, item)| consume(index, work(index, item)));
    }
    let items = Mutex::new(items.by_ref().enumerate());
    let (sender, receiver) = channel::bounded(4 * threads);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (sender, items, work) = (sender.clone(), &items, &work);
            scope.spawn(move || {
                loop {
                    // A thread that panicked took its item, and its panic goes on in the scope.
                    let next = items.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some((index, item)) = next else { return };
                    if sender.send((index, work(index, item))).is_err() {
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
