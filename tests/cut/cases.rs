//! What holds in a situation of its own.

use crate::scenes::*;
use crate::support::camera::{Depth, looking_with};
use crate::support::memory::MemorySource;
use kimberlite::cut::{Cut, DiamondSource, Patch, VertexForm, View};
use kimberlite::lattice::Lattice;
use kimberlite::schedule::Budget;
use kimberlite::tool::count_cracks;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

fn mountains() -> Arc<MemorySource> {
    Arc::new(MemorySource::exact(hills(129, 97, 5, Voids::None), 3))
}

fn close_up(source: &MemorySource) -> View {
    view(
        source,
        Stand {
            at: [0.4, 0.6],
            above: 50.0,
            target: [0.6, 0.5],
            tolerance: 0.5,
        },
    )
}

#[test]
fn without_time_or_refinements_nothing_is_refined() {
    let source = mountains();
    for budget in [
        Budget {
            microseconds: 0,
            ..Budget::UNLIMITED
        },
        Budget {
            refinements: 0,
            ..Budget::UNLIMITED
        },
        Budget {
            upload_bytes: 0,
            ..Budget::UNLIMITED
        },
    ] {
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let stats = cut.update(&close_up(&source), &budget).unwrap();
        assert_eq!((stats.refined, stats.late_refinements), (0, 0));
        assert!(stats.cut_short && !stats.budget_too_small);
        assert!(source.asked.lock().unwrap().is_empty());
    }
}

#[test]
fn no_refinement_begins_after_the_deadline() {
    let mut source = MemorySource::exact(hills(129, 97, 5, Voids::None), 3);
    source.delay = Duration::from_millis(4);
    let source = Arc::new(source);
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let budget = Budget {
        microseconds: 10_000,
        ..Budget::UNLIMITED
    };
    for update in 1..=5 {
        let stats = cut.update(&close_up(&source), &budget).unwrap();
        assert!(
            stats.refined <= 3,
            "each takes 4 ms, the third begins after 8 ms at the earliest"
        );
        assert!(stats.cut_short, "update {update}");
        assert_eq!(stats.late_refinements, 0);
        assert_eq!(cracks(&cut, &source), 0);
    }
}

#[test]
fn a_frozen_cut_stays_and_still_obeys_smaller_budgets() {
    let source = mountains();
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let held = settle(&mut cut, &close_up(&source), &Budget::UNLIMITED);
    let away = overview(&source, 1000.0);
    let frozen = Budget {
        refinements: 0,
        ..Budget::UNLIMITED
    };
    let stats = cut.update(&away, &frozen).unwrap();
    assert_eq!(
        (stats.refined, stats.coarsened, stats.bytes),
        (0, 0, held.bytes)
    );
    let shrunk = Budget {
        patches: 20,
        bytes: held.bytes / 2,
        ..frozen
    };
    let stats = cut.update(&away, &shrunk).unwrap();
    assert!(stats.coarsened > 0 && stats.patches <= 20 && stats.bytes <= held.bytes / 2);
    assert_eq!(cracks(&cut, &source), 0);
}

#[test]
fn an_eye_that_trembles_at_a_threshold_changes_the_cut_once() {
    let source = mountains();
    for patches in [Budget::NO_LIMIT, 40] {
        let budget = Budget {
            patches,
            ..Budget::UNLIMITED
        };
        let stand = |tolerance: f64, shake: f64| Stand {
            at: [0.5, 0.5],
            above: 9000.0 * (1.0 + shake),
            target: [0.5, 0.5],
            tolerance,
        };
        // The root's own error in pixels, and one of a diamond far below it.
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let frozen = Budget {
            refinements: 0,
            ..Budget::UNLIMITED
        };
        let root = cut
            .update(&view(&source, stand(1.0, 0.0)), &frozen)
            .unwrap();
        let some = Budget {
            refinements: 20,
            ..Budget::UNLIMITED
        };
        let fine = cut
            .update(&view(&source, stand(0.001, 0.0)), &some)
            .unwrap();
        assert!(fine.largest_error < root.largest_error);
        for threshold in [root.largest_error, fine.largest_error] {
            let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
            let mut changed = 0;
            for frame in 0..40 {
                let shake = if frame % 2 == 0 { 0.001 } else { -0.001 };
                let view = view(&source, stand(threshold, shake));
                let stats = cut.update(&view, &budget).unwrap();
                changed = if stats.refined + stats.coarsened > 0 {
                    frame
                } else {
                    changed
                };
            }
            assert!(changed <= 2, "frame {changed}");
        }
    }
}

#[test]
fn an_eye_that_trembles_at_the_edge_of_the_screen_changes_the_cut_once() {
    let source = mountains();
    for start in 0..60 {
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        for frame in 0..12 {
            let shake = if frame % 2 == 0 { 0.002 } else { -0.002 };
            let angle = f64::from(start) * 0.1 + shake;
            let stand = Stand {
                at: [0.5, 0.5],
                above: 50.0,
                target: [0.5 + 0.5 * angle.cos(), 0.5 + 0.5 * angle.sin()],
                tolerance: 0.5,
            };
            let stats = cut
                .update(&view(&source, stand), &Budget::UNLIMITED)
                .unwrap();
            assert!(
                frame < 2 || stats.refined + stats.coarsened == 0,
                "from {start}: {stats:?}"
            );
        }
    }
}

#[test]
fn what_is_out_of_sight_or_needlessly_fine_is_given_back() {
    let source = mountains();
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let held = settle(&mut cut, &close_up(&source), &Budget::UNLIMITED);
    let far = settle(&mut cut, &overview(&source, 1000.0), &Budget::UNLIMITED);
    assert!(held.patches > 50);
    assert_eq!((far.patches, cut.all_patches().count()), (2, 2));
}

#[test]
fn garbage_goes_even_if_time_never_lasts() {
    let source = Arc::new(MemorySource::rough(hills(257, 257, 5, Voids::None), 2, 1e9));
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let budget = Budget {
        refinements: 1,
        ..Budget::UNLIMITED
    };
    let frames = 2000;
    for frame in 0..frames {
        let angle = f64::from(frame) * 0.1;
        let stand = Stand {
            at: [0.5, 0.5],
            above: 20.0,
            target: [0.5 + angle.cos(), 0.5 + angle.sin()],
            tolerance: 0.05,
        };
        let stats = cut.update(&view(&source, stand), &budget).unwrap();
        assert!(stats.cut_short, "frame {frame}: {stats:?}");
    }
    // Each refinement adds up to two patches for good, if nothing is given back.
    let left = cut.all_patches().count();
    assert!(left < frames as usize / 2, "{left} patches");
}

#[test]
fn a_budget_below_the_root_shows_the_root() {
    let source = mountains();
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    settle(&mut cut, &close_up(&source), &Budget::UNLIMITED);
    let budgets = [
        Budget {
            patches: 1,
            ..Budget::UNLIMITED
        },
        Budget {
            bytes: 100,
            ..Budget::UNLIMITED
        },
    ];
    for budget in budgets {
        let stats = cut.update(&overview(&source, 1.0), &budget).unwrap();
        assert!(stats.budget_too_small);
        assert_eq!((stats.patches, cut.all_patches().count()), (2, 2));
        assert!(
            !cut.update(&close_up(&source), &Budget::UNLIMITED)
                .unwrap()
                .budget_too_small
        );
    }
}

#[test]
fn a_patch_outlives_its_removal() {
    let source = mountains();
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    settle(&mut cut, &close_up(&source), &Budget::UNLIMITED);
    let kept: Vec<Arc<Patch>> = cut.all_patches().cloned().collect();
    let copies: Vec<Patch> = kept.iter().map(|patch| (**patch).clone()).collect();
    settle(&mut cut, &overview(&source, 1000.0), &Budget::UNLIMITED);
    drop(cut);
    for (kept, copy) in kept.iter().zip(&copies) {
        assert_eq!((kept.handle, &kept.vertices), (copy.handle, &copy.vertices));
    }
}

#[test]
fn a_view_that_means_nothing_is_refused_and_changes_nothing() {
    let source = mountains();
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let good = close_up(&source);
    let stats = settle(&mut cut, &good, &Budget::UNLIMITED);
    let mut views = vec![good; 9];
    views[0].eye[1] = f64::NAN;
    views[1].world_to_clip[3] = f64::INFINITY;
    views[2].world_to_clip = [0.0; 16];
    views[3].world_to_clip = [1.0; 16];
    views[4].viewport[0] = 0.0;
    views[5].viewport[1] = -3.0;
    views[6].tolerance = 0.0;
    views[7].tolerance = f64::NAN;
    views[8].tolerance = f64::INFINITY;
    for view in &views {
        let error = cut.update(view, &Budget::UNLIMITED).unwrap_err();
        assert!(matches!(error, kimberlite::Error::Argument(_)), "{error}");
    }
    let after = cut.update(&good, &Budget::UNLIMITED).unwrap();
    assert_eq!(
        (after.refined, after.coarsened, after.bytes),
        (0, 0, stats.bytes)
    );
}

#[test]
fn conventions_of_depth_do_not_change_the_cut() {
    let source = mountains();
    let gl = close_up(&source);
    let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
    let expected = settle(&mut cut, &gl, &Budget::UNLIMITED);
    let [x, y] = source.frame().grid_to_world(0.6 * 128.0, 0.5 * 96.0);
    for depth in [Depth::ZeroToOne, Depth::Reversed] {
        let view = looking_with(depth, gl.eye, [x, y, 99.0], 1.0, gl.tolerance);
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let stats = settle(&mut cut, &view, &Budget::UNLIMITED);
        assert_eq!(
            (stats.patches, stats.triangles),
            (expected.patches, expected.triangles)
        );
    }
}

#[test]
fn the_crack_checker_sees_cracks() {
    let source = mountains();
    for options in [COMPACT, EXPANDED] {
        let mut cut = Cut::new(source.clone(), options.clone()).unwrap();
        settle(&mut cut, &close_up(&source), &Budget::UNLIMITED);
        let whole: Vec<Patch> = cut.all_patches().map(|patch| (**patch).clone()).collect();
        let count = |patches: &[Patch]| count_strictly(patches, source.lattice());
        assert_eq!(count(&whole), 0);
        let middle = (0..whole.len())
            .find(|&k| {
                let own = &whole[k];
                own.corners.iter().all(|corner| {
                    let [column, row] = source.frame().world_to_grid(corner[0], corner[1]);
                    column > 1.0 && row > 1.0 && column < 127.0 && row < 95.0
                })
            })
            .unwrap();
        // A height, a slope or a normal that differs; a patch that is missing; one that is coarser.
        for float in 0..whole[middle].vertices.len() / 45 {
            if options.vertex_form == VertexForm::Expanded && float < 2 {
                continue;
            }
            let mut torn = whole.clone();
            let bits = torn[middle].vertices[float].to_bits();
            torn[middle].vertices[float] = f32::from_bits(bits ^ 1);
            assert!(count(&torn) > 0, "float {float}");
        }
        let mut holed = whole.clone();
        holed.remove(middle);
        assert!(count(&holed) > 0);
        let mut root = Cut::new(source.clone(), options).unwrap();
        root.update(
            &close_up(&source),
            &Budget {
                refinements: 6,
                ..Budget::UNLIMITED
            },
        )
        .unwrap();
        let coarse: HashMap<_, _> = root
            .all_patches()
            .map(|p| ((p.diamond, p.half), (**p).clone()))
            .collect();
        let mixed: Vec<Patch> = whole.iter().chain(coarse.values()).cloned().collect();
        assert!(count_with_voids(&mixed, source.lattice()) > 0);
    }
}

fn count_strictly(patches: &[Patch], lattice: &Lattice) -> u64 {
    count_cracks(patches.iter(), lattice, |_, _| false)
}

fn count_with_voids(patches: &[Patch], lattice: &Lattice) -> u64 {
    count_cracks(patches.iter(), lattice, |_, _| true)
}
