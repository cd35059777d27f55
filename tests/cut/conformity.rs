//! Random legal cuts: what is refined has nothing to do with any ground or view.

use crate::scenes::*;
use crate::support::memory::MemorySource;
use kimberlite::cut::{Cut, CutOptions, VertexForm};
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::sync::Arc;

proptest! {
    #![proptest_config(config(500))]

    #[test]
    fn no_random_legal_cut_has_a_crack(
        (scene, seed) in (scenes(), any::<u64>()),
        steps in prop::collection::vec((1u64..120, 0.1f64..2000.0), 1..4),
        is_expanded in any::<bool>(),
    ) {
        let mut source = MemorySource::rough(scene.raster(), scene.cells_log2, 0.0);
        source.random_errors = Some(seed);
        let source = Arc::new(source);
        let vertex_form = if is_expanded { VertexForm::Expanded } else { VertexForm::Compact };
        let mut cut = Cut::new(source.clone(), CutOptions { vertex_form, ..COMPACT }).unwrap();
        for (refinements, tolerance) in steps {
            // A greater tolerance than before coarsens as randomly.
            let budget = Budget { refinements, ..Budget::UNLIMITED };
            cut.update(&overview(&source, tolerance), &budget).unwrap();
            prop_assert_eq!(cracks(&cut, &source), 0);
        }
    }
}
