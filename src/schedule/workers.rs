//! Threads that answer requests, the most urgent first. What is urgent may change while requests wait.

use super::{Deadline, Handover};
use std::io;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// How long, in microseconds, [`Workers`] that are dropped wait for requests in work. Threads that take longer end by themselves.
const PATIENCE: u64 = 1_000_000;

/// Threads at a [`Handover`]. Answers come in any order, some perhaps never.
pub struct Workers<K, R, A> {
    handover: Arc<Handover<K, R, A>>,
    threads: Vec<JoinHandle<()>>,
}

impl<K, R, A> Workers<K, R, A>
where
    K: Copy + PartialEq + Send + 'static,
    R: Send + 'static,
    A: Send + 'static,
{
    /// Starts `count` threads that answer by `work`.
    ///
    /// # Errors
    ///
    /// The system's, where it starts no more threads.
    pub fn start(
        count: usize,
        work: impl Fn(K, R) -> A + Send + Sync + 'static,
    ) -> io::Result<Workers<K, R, A>> {
        let work = Arc::new(work);
        let mut workers = Workers {
            handover: Arc::new(Handover::default()),
            threads: Vec::new(),
        };
        for _ in 0..count {
            let (handover, work) = (workers.handover.clone(), work.clone());
            let serve = move || {
                while let Some((key, request)) = handover.next() {
                    handover.answer(key, work(key, request));
                }
            };
            let name = "kimberlite".to_string();
            workers
                .threads
                .push(Builder::new().name(name).spawn(serve)?);
        }
        Ok(workers)
    }

    /// Where requests are given and answers taken.
    pub fn handover(&self) -> &Handover<K, R, A> {
        &self.handover
    }
}

impl<K, R, A> Drop for Workers<K, R, A> {
    fn drop(&mut self) {
        self.handover.end();
        let deadline = Deadline::after(Instant::now(), PATIENCE);
        for thread in self.threads.drain(..) {
            while !thread.is_finished() && !deadline.is_past(Instant::now()) {
                std::thread::sleep(Duration::from_micros(100));
            }
            if thread.is_finished() {
                // Its panic was told by the panic hook, and is nobody's result.
                let _ = thread.join();
            }
        }
    }
}
