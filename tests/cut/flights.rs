//! Violent flights with little time and little room: rotations, jumps from space to the ground, budgets that change.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use kimberlite::cut::{Cut, CutOptions};
use kimberlite::schedule::Budget;
use std::sync::Arc;
use std::time::Duration;

/// Numbers that are the same in every run.
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.below(1 << 20) as f64 / f64::from(1 << 20)
    }

    /// One in three times no limit.
    fn limit(&mut self, low: u64, high: u64) -> u64 {
        if self.below(3) == 0 {
            Budget::NO_LIMIT
        } else {
            low + self.below(high - low)
        }
    }
}

fn next_stand(dice: &mut Dice, mut stand: Stand) -> Stand {
    let place = |dice: &mut Dice| [dice.between(-0.2, 1.2), dice.between(-0.2, 1.2)];
    match dice.below(10) {
        0 => {
            stand.at = place(dice);
            stand.above = if dice.below(2) == 0 { 60_000.0 } else { 20.0 };
        }
        1..=5 => stand.target = place(dice),
        _ => stand.at = stand.at.map(|at| at + dice.between(-0.02, 0.02)),
    }
    stand
}

fn next_budget(dice: &mut Dice, budget: Budget) -> Budget {
    match dice.below(12) {
        0 => Budget {
            patches: dice.limit(2, 200),
            ..budget
        },
        1 => Budget {
            bytes: dice.limit(10_000, 400_000),
            ..budget
        },
        2 => Budget {
            upload_bytes: dice.limit(0, 30_000),
            ..budget
        },
        3 => Budget {
            refinements: dice.limit(0, 20),
            ..budget
        },
        // Below the root, for a frame or more.
        4 => Budget {
            patches: dice.below(3),
            ..budget
        },
        _ => budget,
    }
}

/// 2,000 frames, of which every 500th is followed by 300 still ones where no threads decode.
fn fly(microseconds: u64, options: CutOptions) {
    let source = Arc::new(MemorySource::exact(hills(129, 97, 5, Voids::None), 3));
    let mut cut = Cut::new(source.clone(), options.clone()).unwrap();
    let mut dice = Dice(microseconds);
    let mut budget = Budget {
        microseconds,
        ..Budget::UNLIMITED
    };
    let mut stand = Stand {
        at: [0.5, 0.5],
        above: 50.0,
        target: [0.6, 0.5],
        tolerance: 0.5,
    };
    let mut refined = 0;
    for frame in 1..=2000 {
        stand = next_stand(&mut dice, stand);
        budget = next_budget(&mut dice, budget);
        let here = view(&source, stand);
        // Giving way to budgets of patches and bytes comes before that of uploads; here it is done first.
        cut.update(
            &here,
            &Budget {
                refinements: 0,
                ..budget
            },
        )
        .unwrap();
        cut.take_changes();
        let stats = cut.update(&here, &budget).unwrap();
        let uploaded: u64 = cut
            .take_changes()
            .added
            .iter()
            .map(|patch| patch.bytes())
            .sum();
        assert_eq!(stats.late_refinements, 0);
        assert!(stats.refined <= budget.refinements && uploaded <= budget.upload_bytes);
        assert!(
            stats.budget_too_small
                || (stats.patches <= budget.patches && stats.bytes <= budget.bytes),
            "frame {frame}: {stats:?} over {budget:?}"
        );
        refined += stats.refined;
        if options.threads > 0 && frame % 20 == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        if frame % 50 == 0 {
            assert_eq!(cracks(&cut, &source), 0);
        }
        if frame % 500 == 0 && options.threads == 0 {
            rest(&mut cut, &source, stand, budget);
        }
    }
    assert!(refined > 0 || options.threads > 0);
}

/// Still frames, after which the cut is the best that fits.
fn rest(cut: &mut Cut, source: &Arc<MemorySource>, stand: Stand, budget: Budget) {
    let here = view(source, stand);
    // What no refinement fits in stays as it is; a fresh cut would be the root.
    let budget = Budget {
        refinements: budget.refinements.max(1),
        upload_bytes: budget.upload_bytes.max(20_000),
        ..budget
    };
    let mut stats = cut.update(&here, &budget).unwrap();
    for _ in 0..300 {
        stats = cut.update(&here, &budget).unwrap();
    }
    let timeless = Budget {
        microseconds: Budget::NO_LIMIT,
        ..budget
    };
    let mut fresh = Cut::new(source.clone(), COMPACT).unwrap();
    let best = settle(&mut fresh, &here, &timeless)
        .largest_error
        .max(stand.tolerance);
    assert!(
        stats.largest_error <= 1.05 * best,
        "{} of {best}, {budget:?}",
        stats.largest_error
    );
}

#[test]
fn half_a_millisecond_a_frame_is_kept_and_suffices() {
    fly(500, COMPACT);
}

#[test]
fn a_millisecond_a_frame_is_kept_and_suffices() {
    fly(1000, COMPACT);
}

#[test]
fn four_milliseconds_a_frame_are_kept_and_suffice() {
    fly(4000, COMPACT);
}

#[test]
fn budgets_are_kept_while_threads_decode() {
    let options = CutOptions {
        threads: 2,
        ..COMPACT
    };
    fly(1000, options);
}
