//! The best that fits: after enough still frames a cut is as good as one made afresh, whatever it held before.

use crate::scenes::*;
use kimberlite::cut::{Cut, CutOptions};
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::sync::Arc;

/// What the largest error may exceed that of a fresh cut by.
const FACTOR: f64 = 1.05;

/// Largest errors at the last of some stands of a cut that has settled at each, and of a fresh cut.
fn errors(scene: &Scene, options: CutOptions, stands: &[Stand], budget: &Budget) -> [f64; 2] {
    let source = Arc::new(scene.source());
    let mut cut = Cut::new(source.clone(), options.clone()).unwrap();
    let mut here = view(&source, stands[0]);
    let mut old = 0.0;
    for &stand in stands {
        here = view(&source, stand);
        old = settle(&mut cut, &here, budget).largest_error;
    }
    let fresh = settle(
        &mut Cut::new(source.clone(), options).unwrap(),
        &here,
        budget,
    );
    [old, fresh.largest_error]
}

fn check(
    scene: &Scene,
    options: CutOptions,
    stands: &[Stand],
    budget: &Budget,
) -> Result<(), TestCaseError> {
    let [old, fresh] = errors(scene, options, stands, budget);
    let tolerated = fresh.max(stands[stands.len() - 1].tolerance);
    prop_assert!(old <= FACTOR * tolerated, "{old} of a fresh cut's {fresh}");
    Ok(())
}

proptest! {
    #![proptest_config(config(256))]

    #[test]
    fn a_settled_cut_is_as_good_as_a_fresh_one_of_so_many_patches(
        (scene, options) in (scenes(), by_any_metric()),
        stands in prop::collection::vec(stands(), 2..4),
        patches in 4u64..150,
    ) {
        check(&scene, options, &stands, &Budget { patches, ..Budget::UNLIMITED })?;
    }

    #[test]
    fn a_settled_cut_is_as_good_as_a_fresh_one_of_so_many_bytes(
        (scene, options) in (scenes(), by_any_metric()),
        stands in prop::collection::vec(stands(), 2..4),
        nodes in 4u64..200,
    ) {
        let side = (1u64 << scene.cells_log2) + 1;
        check(&scene, options, &stands, &Budget { bytes: nodes * side * side * 24, ..Budget::UNLIMITED })?;
    }

    #[test]
    fn a_settled_cut_is_as_good_as_a_fresh_one_within_any_budget(
        (scene, options) in (scenes(), by_any_metric()),
        stands in prop::collection::vec(stands(), 2..4),
        (mut budget, refinements) in (budgets(), 1u64..50),
    ) {
        budget.refinements = refinements;
        check(&scene, options, &stands, &budget)?;
    }
}

/// What leaves the screen is held by a larger error than what is on it has.
#[test]
fn what_is_just_out_of_sight_does_not_keep_room_from_what_is_seen() {
    let scene = Scene {
        size: [106, 52],
        seed: 737,
        voids: Voids::None,
        cells_log2: 2,
    };
    let first = Stand {
        at: [0.6468354954355131, 0.0],
        above: 0.0,
        target: [0.0, 1.106169565778392],
        tolerance: 0.3,
    };
    let second = Stand {
        at: [1.2724413859562766, 0.8243039186944537],
        above: -83.18085268551567,
        target: [0.21441521611816136, 0.18555021124148846],
        tolerance: 0.3,
    };
    let budget = Budget {
        patches: 122,
        ..Budget::UNLIMITED
    };
    check(&scene, COMPACT, &[first, second], &budget).unwrap();
}
