//! Cuts of repositories whose levels are filtered, where refining a diamond moves its inner vertices.

use crate::properties::Surface;
use crate::scenes::*;
use crate::support::camera::{VIEWPORT, project};
use crate::support::memory::MemorySource;
use crate::support::repositories::{build_at, repaired_repository, repository};
use kimberlite::build::BuildOptions;
use kimberlite::cut::{Cut, Layer, Terrain};
use kimberlite::schedule::Budget;
use kimberlite::store::{Access, TransformKind};
use proptest::prelude::*;
use std::sync::Arc;

fn filtering() -> impl Strategy<Value = BuildOptions> {
    let options = |transform, max_error, rms_error| BuildOptions {
        transform,
        max_error,
        rms_error,
        cells_log2: 4,
        threads: 1,
        ..BuildOptions::default()
    };
    prop_oneof![
        Just(options(TransformKind::Lifted, 0.0, None)),
        Just(options(TransformKind::Lifted, 0.0, Some(20.0))),
        Just(options(TransformKind::TwoStage, 0.0, None)),
        Just(options(TransformKind::TwoStage, 25.0, None)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_cut_of_a_repaired_terrain_has_a_crack_or_never_settles(
        scene in scenes(),
        options in filtering(),
        places in prop::collection::vec(0.0f64..1.0, 1..4),
        (first, second) in (stands(), stands()),
        (mut budget, refinements) in (budgets(), 1u64..50),
    ) {
        budget.refinements = refinements;
        let source = MemorySource::rough(scene.raster(), 4, 0.0);
        let mut cut = Cut::new(repaired_repository(&source, &options, &places), COMPACT).unwrap();
        for stand in [first, second] {
            let stats = settle(&mut cut, &view(&source, stand), &budget);
            prop_assert_eq!(cracks(&cut, &source), 0);
            prop_assert!(stats.budget_too_small || stats.patches <= budget.patches);
        }
    }

    #[test]
    fn no_cut_of_filtered_levels_has_a_crack(
        scene in scenes(),
        options in filtering(),
        frames in prop::collection::vec((stands(), budgets()), 1..7),
        expanded in any::<bool>(),
    ) {
        let source = MemorySource::rough(scene.raster(), 4, 0.0);
        let form = if expanded { EXPANDED } else { COMPACT };
        let mut cut = Cut::new(repository(&source, &options), form).unwrap();
        for (stand, budget) in frames {
            cut.update(&view(&source, stand), &budget).unwrap();
            prop_assert_eq!(cracks(&cut, &source), 0);
        }
    }

    #[test]
    fn coarse_filtered_levels_stay_within_the_tolerance_on_the_screen(
        scene in scenes(),
        options in filtering(),
        stand in stands(),
    ) {
        prop_assume!(options.max_error == 0.0 && options.rms_error.is_none());
        let source = MemorySource::rough(scene.raster(), 4, 0.0);
        let mut cut = Cut::new(repository(&source, &options), EXPANDED).unwrap();
        let view = view(&source, stand);
        settle(&mut cut, &view, &Budget::UNLIMITED);
        let surface = Surface::new(cut.patches(), &cut);
        let (w, h) = (i64::from(source.raster.width), i64::from(source.raster.height));
        for at in (0..w * h).map(|k| [k % w, k / w]) {
            let (Some(sample), Some(drawn)) = (source.raster.at(at), surface.height(at)) else {
                continue;
            };
            let [a, b] = [f64::from(sample), drawn].map(|unit| project(&view, source.world(at, unit)));
            let on_screen = |[x, y]: [f64; 2]| {
                (0.0..=VIEWPORT[0]).contains(&x) && (0.0..=VIEWPORT[1]).contains(&y)
            };
            if a.1 >= 1.0 && b.1 >= 1.0 && (on_screen(a.0) || on_screen(b.0)) {
                let distance = (a.0[0] - b.0[0]).hypot(a.0[1] - b.0[1]);
                prop_assert!(distance <= stand.tolerance * (1.0 + 1e-9), "{} pixels", distance);
            }
        }
    }
}

#[test]
fn a_second_cut_takes_what_the_first_has_decoded() {
    let source = Scene {
        size: [129, 97],
        seed: 5,
        voids: Voids::None,
        cells_log2: 4,
    }
    .source();
    let stand = Stand {
        at: [0.4, 0.6],
        above: 50.0,
        target: [0.6, 0.5],
        tolerance: 0.5,
    };
    let settled = |terrain: &Arc<Terrain>| {
        let mut cut = Cut::new(terrain.clone(), EXPANDED).unwrap();
        settle(&mut cut, &view(&source, stand), &Budget::UNLIMITED);
        drawn(&cut)
    };
    for shared_bytes in [0, u64::MAX] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        let options = BuildOptions {
            cells_log2: 4,
            ..BuildOptions::default()
        };
        build_at(&path, &source, &options);
        let layer = Layer::open(&path, Access::Positioned).unwrap();
        let layer = layer.sharing(shared_bytes).unwrap();
        let terrain = Arc::new(Terrain::of(Arc::new(layer)).unwrap());
        let first = settled(&terrain);
        // What was verified is not verified again: a second decoding gives other heights.
        let mut bytes = std::fs::read(&path).unwrap();
        let blocks = u64::from_le_bytes(bytes[272..280].try_into().unwrap()) as usize;
        bytes[blocks..].fill(0x5a);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(settled(&terrain) == first, shared_bytes > 0);
    }
}
