//! The hand-over between the thread that asks and those that work, in every order in which their steps can follow each
//! other (loom).

#[path = "../src/schedule/handover.rs"]
mod handover;

/// In place of the library's.
mod sync {
    pub use loom::sync::{Condvar, Mutex, MutexGuard};
}

use handover::Handover;
use loom::sync::Arc;
use loom::thread;

type Numbers = Handover<u32, u32, u32>;

/// With no more than three steps out of turn, or it takes hours.
fn explore(steps: impl Fn() + Send + Sync + 'static) {
    let mut builder = loom::model::Builder::new();
    builder.preemption_bound = Some(3);
    builder.check(steps);
}

fn square(key: u32) -> Option<u32> {
    Some(key * key)
}

/// Serves so many requests, or until the end.
fn serve(numbers: &Arc<Numbers>, most: usize) -> thread::JoinHandle<()> {
    let numbers = numbers.clone();
    thread::spawn(move || {
        for _ in 0..most {
            let Some((key, request)) = numbers.next() else {
                return;
            };
            numbers.answer(key, request + 1);
        }
    })
}

#[test]
fn no_request_is_lost_and_no_thread_sleeps_through_its_call() {
    explore(|| {
        let numbers = Arc::new(Numbers::default());
        let threads = [serve(&numbers, 1), serve(&numbers, 1)];
        numbers.reissue([3, 5], square);
        for thread in threads {
            thread.join().unwrap();
        }
        let mut answers = Vec::new();
        numbers.collect(&mut answers);
        answers.sort_unstable();
        assert_eq!(answers, [(3, 10), (5, 26)]);
    });
}

#[test]
fn what_is_asked_again_is_answered_once_at_a_time() {
    explore(|| {
        let numbers = Arc::new(Numbers::default());
        let threads = [serve(&numbers, 2), serve(&numbers, 2)];
        numbers.reissue([3, 5], square);
        numbers.reissue([5, 7], square);
        let mut answers = Vec::new();
        numbers.collect(&mut answers);
        numbers.end();
        for thread in threads {
            thread.join().unwrap();
        }
        numbers.collect(&mut answers);
        answers.sort_unstable();
        assert!(
            answers.windows(2).all(|pair| pair[0].0 < pair[1].0),
            "{answers:?}"
        );
        assert!(
            answers
                .iter()
                .all(|&(key, answer)| Some(answer - 1) == square(key))
        );
    });
}

#[test]
fn the_end_wakes_all_who_wait() {
    explore(|| {
        let numbers = Arc::new(Numbers::default());
        let threads = [serve(&numbers, 1), serve(&numbers, 1)];
        numbers.end();
        for thread in threads {
            thread.join().unwrap();
        }
        numbers.reissue([1], square);
        assert!(numbers.next().is_none());
    });
}
