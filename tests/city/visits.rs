//! What is drawn of a city within a budget.

use crate::samples::*;
use glam::DVec3;
use glam::dcamera::rh::{proj::opengl, view};
use kimberlite::blockmap::{ALL_QUARTERS, City, CityOptions, Drawn, Visit, VisitStats};
use kimberlite::geo::View;
use kimberlite::schedule::Budget;
use kimberlite::store::Access;
use std::collections::HashSet;
use std::sync::Arc;

/// From a height above a place of the city, in shares of its side, at its middle.
fn look(city: &City, [x, y]: [f64; 2], height: f64, tolerance: f64) -> View {
    let tree = city.tree();
    let at = |x: f64, y: f64, z: f64| {
        DVec3::new(
            tree.corner[0] + x * tree.side,
            tree.corner[1] + y * tree.side,
            z * tree.side,
        )
    };
    let (eye, middle) = (at(x, y, height), at(0.5, 0.5, 0.0));
    let lens = opengl::perspective(1.0, 1.25, 1.0, 8.0 * tree.side);
    let camera = view::look_to_mat4(eye, (middle - eye).normalize(), DVec3::Z);
    View {
        eye: eye.to_array(),
        world_to_clip: (lens * camera).to_cols_array(),
        viewport: [1280.0, 1024.0],
        tolerance,
    }
}

/// How often each finest square is drawn.
fn cover(city: &City, drawn: &[Drawn]) -> Vec<u32> {
    let tree = city.tree();
    let along = 1usize << tree.depth();
    let mut counts = vec![0; along * along];
    for entry in drawn {
        let node = &tree.nodes[entry.node as usize];
        let size = along >> node.level;
        for row in 0..size {
            for column in 0..size {
                let quarter = usize::from(2 * column >= size) + 2 * usize::from(2 * row >= size);
                if entry.quarters >> quarter & 1 == 1 {
                    let x = node.place[0] as usize * size + column;
                    let y = node.place[1] as usize * size + row;
                    counts[y * along + x] += 1;
                }
            }
        }
    }
    counts
}

fn settle(visit: &mut Visit, view: &View, budget: &Budget) -> VisitStats {
    let mut stats = VisitStats::default();
    for _ in 0..300 {
        stats = visit.update(view, budget).unwrap();
    }
    stats
}

#[test]
fn a_square_is_drawn_twice_or_a_seen_one_never() {
    let city = shared_city();
    let mut visit = Visit::new(city.clone(), 0).unwrap();
    let each = visit.block_bytes();
    for step in 0..200u64 {
        let turn = step as f64 * 0.1;
        let view = look(
            &city,
            [0.5 + 0.6 * turn.cos(), 0.5 + 0.6 * turn.sin()],
            0.1 + turn % 1.0,
            1.0,
        );
        let budget = Budget {
            bytes: each * (3 + step % 40),
            refinements: step % 7,
            ..Budget::UNLIMITED
        };
        visit.update(&view, &budget).unwrap();
        let counts = cover(&city, visit.drawn());
        assert!(
            counts.iter().all(|count| *count <= 1),
            "{:?}",
            visit.drawn()
        );
    }
    // From straight above all is seen.
    let view = look(&city, [0.5, 0.49], 3.0, 0.1);
    settle(&mut visit, &view, &Budget::UNLIMITED);
    assert!(cover(&city, visit.drawn()).iter().all(|count| *count == 1));
}

#[test]
fn a_budget_is_exceeded_or_what_fits_never_comes() {
    let city = shared_city();
    let view = look(&city, [0.5, -0.2], 0.6, 0.5);
    let mut best = f64::INFINITY;
    for blocks in [1u64, 2, 3, 5, 9, 17, 33, 65, 200] {
        for threads in [0, 2] {
            let mut visit = Visit::new(city.clone(), threads).unwrap();
            let each = visit.block_bytes();
            let budget = Budget {
                bytes: blocks * each + each / 2,
                upload_bytes: 2 * each,
                ..Budget::UNLIMITED
            };
            for _ in 0..300 {
                let stats = visit.update(&view, &budget).unwrap();
                assert!(stats.bytes <= budget.bytes, "{stats:?}");
                assert!(stats.loaded <= 2, "{stats:?}");
                if threads > 0 {
                    std::thread::sleep(std::time::Duration::from_micros(200));
                }
            }
            let stats = visit.update(&view, &budget).unwrap();
            assert_eq!(
                (stats.loaded, stats.dropped),
                (0, 0),
                "{blocks} blocks: {stats:?}"
            );
            assert!(
                stats.largest_error <= best + 1e-9,
                "{blocks} blocks: {stats:?}"
            );
            if threads > 0 {
                best = stats.largest_error;
            }
        }
    }
    assert!(best <= 0.5, "{best}");
}

#[test]
fn a_visit_without_refinements_loads_or_a_shrunken_budget_is_exceeded() {
    let city = shared_city();
    let mut visit = Visit::new(city.clone(), 0).unwrap();
    let view = look(&city, [0.5, -0.2], 0.6, 0.5);
    let none = Budget {
        refinements: 0,
        ..Budget::UNLIMITED
    };
    let stats = visit.update(&view, &none).unwrap();
    assert_eq!((stats.loaded, stats.resident), (0, 1));
    assert_eq!(visit.drawn()[0].quarters, ALL_QUARTERS);
    settle(&mut visit, &view, &Budget::UNLIMITED);
    let each = visit.block_bytes();
    let small = Budget {
        bytes: 6 * each,
        ..Budget::UNLIMITED
    };
    let stats = visit.update(&view, &small).unwrap();
    assert!(stats.bytes <= small.bytes && stats.dropped > 0, "{stats:?}");
    let tiny = Budget {
        bytes: 1,
        ..Budget::UNLIMITED
    };
    let stats = visit.update(&view, &tiny).unwrap();
    assert!(stats.budget_too_small && stats.resident == 1, "{stats:?}");
}

#[test]
fn added_and_removed_do_not_add_up_to_what_is_held() {
    let city = shared_city();
    let mut visit = Visit::new(city.clone(), 0).unwrap();
    let each = visit.block_bytes();
    let mut held = HashSet::new();
    for step in 0..100 {
        let turn = f64::from(step) * 0.37;
        let view = look(&city, [0.5 + turn.cos(), 0.5 + turn.sin()], 0.3, 1.0);
        let budget = Budget {
            bytes: 20 * each,
            ..Budget::UNLIMITED
        };
        let stats = visit.update(&view, &budget).unwrap();
        for node in visit.removed() {
            assert!(held.remove(node), "{node} was not held");
        }
        for &node in visit.added() {
            assert!(held.insert(node), "{node} was held");
        }
        assert_eq!(held.len() as u64, stats.resident);
        assert!(visit.drawn().iter().all(|entry| held.contains(&entry.node)));
    }
}

#[test]
fn a_damaged_block_stops_a_visit_or_leaves_a_gap() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("city.kmb");
    let options = CityOptions {
        bake: coarse_bake(32),
        leaf_side: 32.0,
        ..CityOptions::default()
    };
    build_at(&path, &procedural(4, 120.0, 20), &options);
    let mut bytes = std::fs::read(&path).unwrap();
    let last = bytes.len() - 10;
    bytes[last] ^= 0x55;
    std::fs::write(&path, bytes).unwrap();
    let city = Arc::new(City::open(&path, Access::Positioned).unwrap());
    let mut visit = Visit::new(city.clone(), 0).unwrap();
    let view = look(&city, [0.5, 0.49], 3.0, 0.0);
    let stats = settle(&mut visit, &view, &Budget::UNLIMITED);
    assert!(stats.failed >= 1 && stats.partial >= 1, "{stats:?}");
    assert!(cover(&city, visit.drawn()).iter().all(|count| *count == 1));
}

#[test]
fn the_number_of_threads_changes_a_city() {
    let folder = tempfile::tempdir().unwrap();
    let scene = procedural(6, 150.0, 30);
    let files = [1, 2, 3].map(|threads| {
        let path = folder.path().join(format!("{threads}.kmb"));
        let options = CityOptions {
            bake: coarse_bake(32),
            leaf_side: 40.0,
            threads,
            ..CityOptions::default()
        };
        build_at(&path, &scene, &options);
        std::fs::read(&path).unwrap()
    });
    assert!(files[0] == files[1] && files[0] == files[2]);
}
