//! Cuts whose diamonds are decoded by threads: late, in any order, with errors, or never.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use kimberlite::Result;
use kimberlite::codec::{Matrix, Refined};
use kimberlite::cut::{Cut, CutOptions, DiamondSource, Stats, Summary, View};
use kimberlite::geo::Frame;
use kimberlite::lattice::{Diamond, Lattice};
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

const THREADED: CutOptions = CutOptions {
    threads: 3,
    ..EXPANDED
};

/// Far more than what is waited for takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A source that answers as it is told.
struct Gate {
    source: Arc<MemorySource>,
    conduct: Box<dyn Fn(Diamond) -> Conduct + Send + Sync>,
    open: Mutex<bool>,
    opened: Condvar,
    /// How often each diamond was asked for.
    asked: Mutex<HashMap<Diamond, u32>>,
}

enum Conduct {
    AtOnce,
    After(Duration),
    /// Not before the gate is opened.
    Stalled,
    Fails,
}

impl Gate {
    fn new(
        source: MemorySource,
        conduct: impl Fn(Diamond) -> Conduct + Send + Sync + 'static,
    ) -> Arc<Gate> {
        Arc::new(Gate {
            source: Arc::new(source),
            conduct: Box::new(conduct),
            open: Mutex::new(false),
            opened: Condvar::new(),
            asked: Mutex::default(),
        })
    }

    fn open(&self) {
        *self.open.lock().unwrap() = true;
        self.opened.notify_all();
    }
}

impl DiamondSource for Gate {
    fn lattice(&self) -> &Lattice {
        self.source.lattice()
    }

    fn frame(&self) -> &Frame {
        self.source.frame()
    }

    fn height_to_world(&self) -> [f64; 2] {
        self.source.height_to_world()
    }

    fn has_voids(&self) -> bool {
        self.source.has_voids()
    }

    fn root(&self) -> &Matrix {
        self.source.root()
    }

    fn range(&self) -> [i32; 2] {
        self.source.range()
    }

    fn summary(&self, diamond: Diamond, parent_range: [i32; 2]) -> Result<Summary> {
        self.source.summary(diamond, parent_range)
    }

    fn refine(&self, diamond: Diamond, vertices: &Matrix) -> Result<Refined> {
        *self.asked.lock().unwrap().entry(diamond).or_default() += 1;
        match (self.conduct)(diamond) {
            Conduct::AtOnce => {}
            Conduct::After(delay) => std::thread::sleep(delay),
            Conduct::Stalled => {
                let open = self.open.lock().unwrap();
                drop(self.opened.wait_while(open, |open| !*open).unwrap());
            }
            Conduct::Fails => return Err(kimberlite::Error::Argument("it fails".into())),
        }
        self.source.refine(diamond, vertices)
    }
}

/// The same number for a diamond in every run.
fn hash(diamond: Diamond) -> u32 {
    (diamond.x as u32 ^ (diamond.y as u32).rotate_left(13)).wrapping_mul(0x9e37_79b9) >> 16
}

fn mountains() -> MemorySource {
    MemorySource::exact(hills(129, 97, 5, Voids::None), 3)
}

fn stand(at: f64) -> Stand {
    Stand {
        at: [at, 0.6],
        above: 50.0,
        target: [at + 0.2, 0.5],
        tolerance: 0.5,
    }
}

/// Still frames until nothing changes and nothing is awaited any more.
fn settle_threaded(cut: &mut Cut, view: &View, budget: &Budget) -> Stats {
    let began = Instant::now();
    while began.elapsed() < PATIENCE {
        let stats = cut.update(view, budget).unwrap();
        assert!(stats.budget_too_small || stats.patches <= budget.patches);
        assert!(stats.budget_too_small || stats.bytes <= budget.bytes);
        if stats.refined + stats.coarsened + stats.added + stats.awaited == 0 {
            return stats;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    let stats = cut.update(view, budget).unwrap();
    panic!("a still view never settles: {stats:?} within {budget:?}");
}

proptest! {
    #![proptest_config(config(40))]

    #[test]
    fn threads_draw_what_the_cut_itself_would(scene in scenes(), stand in stands(), budget in budgets()) {
        let source = Arc::new(scene.source());
        let here = view(&source, stand);
        let budget = Budget { bytes: Budget::NO_LIMIT, refinements: budget.refinements.max(1), upload_bytes: Budget::NO_LIMIT, ..budget };
        let mut alone = Cut::new(source.clone(), EXPANDED).unwrap();
        let expected = settle(&mut alone, &here, &budget);
        let mut threaded = Cut::new(source.clone(), THREADED).unwrap();
        let stats = settle_threaded(&mut threaded, &here, &budget);
        prop_assert_eq!(cracks(&threaded, &source), 0);
        if budget.patches == Budget::NO_LIMIT {
            prop_assert_eq!(drawn(&threaded), drawn(&alone));
        } else {
            // In another order, within the factor of exchange.
            let best = expected.largest_error.max(stand.tolerance);
            prop_assert!(stats.largest_error <= 1.05 * best, "{:?} of {:?}", stats, expected);
        }
    }

    #[test]
    fn bytes_on_their_way_are_within_the_budget(scene in scenes(), stand in stands(), bytes in 50_000u64..3_000_000) {
        let source = Arc::new(scene.source());
        let here = view(&source, stand);
        let budget = Budget { bytes, ..Budget::UNLIMITED };
        let frozen = Budget { refinements: 0, ..budget };
        let mut alone = Cut::new(source.clone(), EXPANDED).unwrap();
        let mut threaded = Cut::new(source.clone(), THREADED).unwrap();
        let [with, without] = [&mut threaded, &mut alone].map(|cut| cut.update(&here, &frozen).unwrap().bytes);
        let stats = settle_threaded(&mut threaded, &here, &budget);
        prop_assert_eq!(cracks(&threaded, &source), 0);
        // As good as without threads in the bytes that are left.
        let rest = Budget { bytes: bytes.saturating_sub(with - without), ..budget };
        let best = settle(&mut alone, &here, &rest).largest_error.max(stand.tolerance);
        prop_assert!(stats.largest_error <= 1.05 * best, "{:?} of {}", stats, best);
    }
}

#[test]
fn a_source_that_never_answers_holds_no_frame_up() {
    let source = Gate::new(mountains(), |diamond| match diamond.level() {
        0..=3 => Conduct::AtOnce,
        _ => Conduct::Stalled,
    });
    let mut cut = Cut::new(source.clone(), THREADED).unwrap();
    let began = Instant::now();
    let (mut refined, mut frame) = (0, 0);
    while frame < 500 || refined < 10 {
        let here = view(&source.source, stand(f64::from(frame % 500) / 1000.0));
        let stats = cut.update(&here, &Budget::UNLIMITED).unwrap();
        refined += stats.refined;
        frame += 1;
        assert!(stats.cut_short);
        assert_eq!(cracks(&cut, &source.source), 0);
        if refined < 10 {
            assert!(began.elapsed() < PATIENCE, "what answers is refined");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    let asked = source.asked.lock().unwrap().clone();
    let mut stalled = asked.iter().filter(|(diamond, _)| diamond.level() > 3);
    assert!(stalled.all(|(_, &times)| times == 1));
    let dropped = Instant::now();
    drop(cut);
    assert!(dropped.elapsed() < Duration::from_secs(10), "nor the end");
    source.open();
    while Arc::strong_count(&source) > 1 {
        assert!(dropped.elapsed() < PATIENCE, "threads remain");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn what_stalled_is_drawn_once_it_comes() {
    let source = Gate::new(mountains(), |diamond| match hash(diamond) % 5 {
        0 if diamond.level() > 2 => Conduct::Stalled,
        _ => Conduct::AtOnce,
    });
    let here = view(&source.source, stand(0.4));
    let mut cut = Cut::new(source.clone(), THREADED).unwrap();
    for _ in 0..50 {
        cut.update(&here, &Budget::UNLIMITED).unwrap();
        std::thread::sleep(Duration::from_micros(500));
    }
    source.open();
    settle_threaded(&mut cut, &here, &Budget::UNLIMITED);
    let mut alone = Cut::new(source.source.clone(), EXPANDED).unwrap();
    settle(&mut alone, &here, &Budget::UNLIMITED);
    assert_eq!(drawn(&cut), drawn(&alone));
}

#[test]
fn answers_late_and_out_of_order_with_errors_leave_a_legal_cut() {
    let source = Gate::new(mountains(), |diamond| match hash(diamond) % 8 {
        0 if diamond.level() > 4 => Conduct::Fails,
        1 | 2 => Conduct::After(Duration::from_micros(u64::from(hash(diamond) % 3000))),
        _ => Conduct::AtOnce,
    });
    let mut cut = Cut::new(source.clone(), THREADED).unwrap();
    let (mut refined, mut frame, began) = (0, 0, Instant::now());
    while frame < 400 || refined < 50 {
        let at = f64::from(frame % 200) / 250.0;
        let here = view(&source.source, stand(at));
        let budget = Budget {
            patches: if frame % 7 == 0 { 30 } else { 400 },
            ..Budget::UNLIMITED
        };
        refined += cut.update(&here, &budget).unwrap().refined;
        frame += 1;
        assert_eq!(cracks(&cut, &source.source), 0);
        if refined < 50 {
            assert!(began.elapsed() < PATIENCE, "{refined} refinements");
            std::thread::sleep(Duration::from_micros(200));
        }
    }
    let here = view(&source.source, stand(0.3));
    settle_threaded(&mut cut, &here, &Budget::UNLIMITED);
    assert_eq!(cracks(&cut, &source.source), 0);
    let asked = source.asked.lock().unwrap();
    let failing = |diamond: &&Diamond| hash(**diamond).is_multiple_of(8) && diamond.level() > 4;
    assert!(asked.keys().any(|diamond| failing(&diamond)));
}

#[test]
fn a_cut_that_looks_ahead_settles_and_then_asks_for_nothing() {
    let source = Gate::new(mountains(), |_| Conduct::AtOnce);
    let mut cut = Cut::new(source.clone(), THREADED).unwrap();
    for frame in 0..40 {
        let here = view(&source.source, stand(0.2 + f64::from(frame) / 200.0));
        cut.update(&here, &Budget::UNLIMITED).unwrap();
        std::thread::sleep(Duration::from_micros(300));
    }
    let here = view(&source.source, stand(0.4));
    settle_threaded(&mut cut, &here, &Budget::UNLIMITED);
    // What is only looked ahead for is not awaited.
    let mut last = 0;
    for _ in 0..200 {
        cut.update(&here, &Budget::UNLIMITED).unwrap();
        std::thread::sleep(Duration::from_micros(300));
        last = source.asked.lock().unwrap().values().sum();
    }
    for _ in 0..50 {
        let stats = cut.update(&here, &Budget::UNLIMITED).unwrap();
        assert_eq!(stats.refined + stats.coarsened + stats.awaited, 0);
        std::thread::sleep(Duration::from_micros(300));
    }
    assert_eq!(last, source.asked.lock().unwrap().values().sum::<u32>());
}
