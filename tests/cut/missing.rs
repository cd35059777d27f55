//! Cuts of terrains with diamonds whose detail is missing.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use kimberlite::cut::{Cut, DiamondSource};
use kimberlite::lattice::Diamond;
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

/// The source with one in every so many diamonds missing.
fn with_missing(scene: &Scene, every: u64, first: u64) -> Arc<MemorySource> {
    let mut source = scene.source();
    let lattice = source.lattice().clone();
    let ranks = (0..lattice.diamond_count()).filter(|rank| rank * 7 % every == first % every);
    source.missing = ranks.map(|rank| lattice.diamond(rank)).collect();
    Arc::new(source)
}

/// The missing diamonds and all that descend from them.
fn blocked(source: &MemorySource) -> HashSet<Diamond> {
    let lattice = source.lattice();
    let mut blocked = source.missing.clone();
    for rank in 0..lattice.diamond_count() {
        let diamond = lattice.diamond(rank);
        let parents = lattice.parents(diamond).into_iter().flatten();
        if parents.into_iter().any(|parent| blocked.contains(&parent)) {
            blocked.insert(diamond);
        }
    }
    blocked
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn missing_detail_is_asked_for_or_tears_the_ground(
        scene in scenes(),
        (every, first) in (2u64..40, 0u64..40),
        frames in prop::collection::vec((stands(), budgets()), 1..7),
    ) {
        let source = with_missing(&scene, every, first);
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        for (stand, budget) in frames {
            let stats = cut.update(&view(&source, stand), &budget).unwrap();
            prop_assert_eq!(cracks(&cut, &source), 0);
            if !stats.budget_too_small {
                prop_assert!(stats.patches <= budget.patches && stats.bytes <= budget.bytes);
            }
        }
        let blocked = blocked(&source);
        let asked = source.asked.lock().unwrap();
        prop_assert!(asked.iter().all(|(diamond, _)| !blocked.contains(diamond)));
    }

    #[test]
    fn a_cut_around_missing_detail_never_settles(
        scene in scenes(),
        (every, first) in (2u64..40, 0u64..40),
        (stand, mut budget, refinements) in (stands(), budgets(), 1u64..50),
    ) {
        budget.refinements = refinements;
        let source = with_missing(&scene, every, first);
        let view = view(&source, stand);
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let settled = settle(&mut cut, &view, &budget);
        let asked = source.asked.lock().unwrap().len();
        for _ in 0..5 {
            let stats = cut.update(&view, &budget).unwrap();
            prop_assert_eq!([stats.refined, stats.coarsened, stats.added, stats.removed], [0; 4]);
            prop_assert_eq!(stats.bytes, settled.bytes);
        }
        prop_assert_eq!(source.asked.lock().unwrap().len(), asked);
    }

    #[test]
    fn missing_detail_keeps_other_ground_from_its_tolerance(
        scene in scenes(),
        (every, first) in (2u64..40, 0u64..40),
        stand in stands(),
    ) {
        let source = with_missing(&scene, every, first);
        let whole = Arc::new(scene.source());
        let view = view(&source, stand);
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let stats = settle(&mut cut, &view, &Budget::UNLIMITED);
        prop_assert!(!stats.cut_short);
        let mut other = Cut::new(whole.clone(), COMPACT).unwrap();
        settle(&mut other, &view, &Budget::UNLIMITED);
        let refined = |source: &MemorySource| -> HashSet<Diamond> {
            source.asked.lock().unwrap().iter().map(|(diamond, _)| *diamond).collect()
        };
        // Some are only refined to let blocked ones be.
        prop_assert!(refined(&source).is_subset(&refined(&whole)));
        let blocked = blocked(&source);
        let is_blocked = cut.patches().iter().any(|patch| blocked.contains(&patch.diamond));
        prop_assert!(is_blocked || stats.largest_error <= stand.tolerance);
    }
}
