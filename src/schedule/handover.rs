//! Requests and answers between one thread that asks and others that work.

use super::sync::{Condvar, Mutex, MutexGuard};
use std::collections::VecDeque;
use std::sync::PoisonError;

/// Requests by their keys, the most urgent first, and answers in the order in which they come. A key waits, is in work or
/// is answered, once at most.
pub struct Handover<K, R, A> {
    state: Mutex<State<K, R, A>>,
    /// A request waits, or all is over.
    called: Condvar,
}

struct State<K, R, A> {
    waiting: VecDeque<(K, R)>,
    in_work: Vec<K>,
    answers: Vec<(K, A)>,
    is_over: bool,
}

impl<K, R, A> Default for Handover<K, R, A> {
    fn default() -> Self {
        Handover {
            state: Mutex::new(State {
                waiting: VecDeque::new(),
                in_work: Vec::new(),
                answers: Vec::new(),
                is_over: false,
            }),
            called: Condvar::new(),
        }
    }
}

impl<K, R, A> Handover<K, R, A> {
    /// No thread panics while it holds the lock, so that what it guards is whole.
    fn lock(&self) -> MutexGuard<'_, State<K, R, A>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends it: nothing waits any more, and [`next`](Self::next) gives `None`.
    pub fn end(&self) {
        let mut state = self.lock();
        state.waiting.clear();
        state.is_over = true;
        self.called.notify_all();
    }
}

impl<K: Copy + PartialEq, R, A> Handover<K, R, A> {
    /// Lets these requests wait, in this order, in place of all that waited. Those in work or answered are not asked for
    /// again; `request` gives what goes with a key that has not waited yet, or `None` to leave it out.
    pub fn reissue(
        &self,
        wanted: impl IntoIterator<Item = K>,
        mut request: impl FnMut(K) -> Option<R>,
    ) {
        let mut state = self.lock();
        let mut old = std::mem::take(&mut state.waiting);
        for key in wanted {
            let is_answered = state.answers.iter().any(|(answered, _)| *answered == key);
            if is_answered || state.in_work.contains(&key) {
                continue;
            }
            let waited = old.iter().position(|(waiting, _)| *waiting == key);
            let next = waited.and_then(|place| old.swap_remove_back(place));
            let next = next.or_else(|| Some((key, request(key)?)));
            state.waiting.extend(next);
        }
        if !state.waiting.is_empty() {
            self.called.notify_all();
        }
    }

    /// Appends the answers that have come, without waiting.
    pub fn collect(&self, answers: &mut Vec<(K, A)>) {
        answers.append(&mut self.lock().answers);
    }

    /// The most urgent request, which is then in work; waits for one. `None` when all is over.
    pub fn next(&self) -> Option<(K, R)> {
        let mut state = self.lock();
        loop {
            if state.is_over {
                return None;
            }
            if let Some((key, request)) = state.waiting.pop_front() {
                state.in_work.push(key);
                return Some((key, request));
            }
            let waited = self.called.wait(state);
            state = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Hands over the answer to a request in work.
    pub fn answer(&self, key: K, answer: A) {
        let mut state = self.lock();
        state.in_work.retain(|other| *other != key);
        state.answers.push((key, answer));
    }
}
