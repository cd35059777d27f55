//! Properties of cuts: legal, without cracks, within budgets, settled when nothing moves.

mod support;

use kimberlite::cut::{Cut, CutOptions, DiamondSource, Patch, Stats, VertexForm, View};
use kimberlite::lattice::Lattice;
use kimberlite::schedule::Budget;
use kimberlite::tool::count_cracks;
use proptest::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;
use support::camera::{Depth, looking, looking_with, project};
use support::memory::{MemorySource, Raster};

const COMPACT: CutOptions = CutOptions {
    vertex_form: VertexForm::Compact,
};
const EXPANDED: CutOptions = CutOptions {
    vertex_form: VertexForm::Expanded,
};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Voids {
    None,
    Sparse,
    Blob,
}

/// Hills with noise on them.
fn hills(width: u32, height: u32, seed: u64, voids: Voids) -> Raster {
    Raster::new(width, height, |column, row| {
        let mut hash =
            (column as u64) << 32 ^ row as u64 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let noise = (hash >> 40) % 32;
        let wave = 300.0 * (column as f64 / 17.0).sin() * (row as f64 / 23.0).cos();
        let is_void = match voids {
            Voids::None => false,
            Voids::Sparse => (hash >> 20) % 400 == 0,
            Voids::Blob => (column - 20).pow(2) + (row - 30).pow(2) < 150,
        };
        (!is_void).then(|| wave as i32 + noise as i32)
    })
}

/// Hills of some size, in diamonds of some size.
#[derive(Clone, Copy, Debug)]
struct Scene {
    size: [u32; 2],
    seed: u64,
    voids: Voids,
    cells_log2: u32,
}

impl Scene {
    fn raster(&self) -> Raster {
        hills(self.size[0], self.size[1], self.seed, self.voids)
    }

    fn source(&self) -> MemorySource {
        MemorySource::exact(self.raster(), self.cells_log2)
    }
}

fn scenes() -> impl Strategy<Value = Scene> {
    let voids = prop_oneof![Just(Voids::None), Just(Voids::Sparse), Just(Voids::Blob)];
    ([2u32..150, 2u32..150], 0u64..1000, voids, 2u32..5).prop_map(
        |(size, seed, voids, cells_log2)| Scene {
            size,
            seed,
            voids,
            cells_log2,
        },
    )
}

/// A place over the raster in fractions of its sides, a height over the ground in metres, a target.
#[derive(Clone, Copy, Debug)]
struct Stand {
    at: [f64; 2],
    above: f64,
    target: [f64; 2],
    tolerance: f64,
}

fn stands() -> impl Strategy<Value = Stand> {
    let place = || [-0.3f64..1.3, -0.3f64..1.3];
    // Below 15 the eye may be under the ground.
    let above = prop_oneof![-150.0f64..100.0, 100.0f64..5000.0];
    (place(), above, place(), 0.3f64..40.0).prop_map(|(at, above, target, tolerance)| Stand {
        at,
        above,
        target,
        tolerance,
    })
}

fn view(source: &MemorySource, stand: Stand) -> View {
    let ends = [
        f64::from(source.raster.width - 1),
        f64::from(source.raster.height - 1),
    ];
    let place = |at: [f64; 2], z: f64| {
        let [x, y] = source
            .frame()
            .grid_to_world(at[0] * ends[0], at[1] * ends[1]);
        [x, y, z]
    };
    looking(
        place(stand.at, 250.0 + stand.above),
        place(stand.target, 99.0),
        1.0,
        stand.tolerance,
    )
}

fn budgets() -> impl Strategy<Value = Budget> {
    let limit = |range: std::ops::Range<u64>| prop_oneof![2 => Just(Budget::NO_LIMIT), 1 => range];
    (
        limit(0..40),
        limit(0..3_000_000),
        limit(0..300_000),
        limit(1..150),
    )
        .prop_map(|(refinements, bytes, upload_bytes, patches)| Budget {
            microseconds: Budget::NO_LIMIT,
            refinements,
            bytes,
            upload_bytes,
            patches,
        })
}

/// Whether a void or the outside is so near a segment that a triangle at it may not be drawn.
fn may_be_open(raster: &Raster, a: [i64; 2], b: [i64; 2]) -> bool {
    let reach = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    let span = |axis: usize| a[axis].min(b[axis]) - reach..=a[axis].max(b[axis]) + reach;
    span(1).any(|row| span(0).any(|column| raster.at([column, row]).is_none()))
}

fn cracks(cut: &Cut, source: &MemorySource) -> u64 {
    let has_voids = source.raster.samples.iter().any(|sample| sample.is_none());
    let patches = cut.all_patches().map(|patch| &**patch);
    count_cracks(patches, source.lattice(), |a, b| {
        has_voids && may_be_open(&source.raster, a, b)
    })
}

fn settle(cut: &mut Cut, view: &View, budget: &Budget) -> Stats {
    for _ in 0..5000 {
        let stats = cut.update(view, budget).unwrap();
        if stats.refined + stats.coarsened + stats.added == 0 {
            return stats;
        }
    }
    panic!("a still view never settles");
}

/// A camera high above the middle that sees everything.
fn overview(source: &MemorySource, tolerance: f64) -> View {
    let side = f64::from(source.raster.width.max(source.raster.height)) * 30.0;
    view(
        source,
        Stand {
            at: [0.5, 0.5],
            above: 3.0 * side,
            target: [0.5, 0.5],
            tolerance,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn no_cut_has_a_crack_and_no_budget_is_exceeded(
        scene in scenes(),
        frames in prop::collection::vec((stands(), budgets()), 1..7),
        expanded in any::<bool>(),
    ) {
        let source = Arc::new(scene.source());
        let options = if expanded { EXPANDED } else { COMPACT };
        let mut cut = Cut::new(source.clone(), options).unwrap();
        let root_bytes: u64 = cut.all_patches().map(|patch| patch.bytes()).sum();
        let mut mirror: BTreeMap<u64, Arc<Patch>> = BTreeMap::new();
        for (stand, budget) in frames {
            let before: u64 = cut.update(&view(&source, stand), &Budget { refinements: 0, ..budget })
                .unwrap().removed;
            let changes = cut.take_changes();
            prop_assert!(changes.removed.len() as u64 >= before);
            apply(&mut mirror, changes);
            let stats = cut.update(&view(&source, stand), &budget).unwrap();
            prop_assert_eq!(cracks(&cut, &source), 0);
            if !stats.budget_too_small {
                prop_assert!(stats.patches <= budget.patches);
                prop_assert!(stats.bytes <= budget.bytes);
            }
            prop_assert!(stats.refined <= budget.refinements);
            prop_assert_eq!(stats.late_refinements, 0);
            let changes = cut.take_changes();
            let uploaded: u64 = changes.added.iter().map(|patch| patch.bytes()).sum();
            prop_assert!(uploaded <= budget.upload_bytes.max(root_bytes));
            prop_assert_eq!(changes.added.len() as u64, stats.added);
            prop_assert_eq!(changes.removed.len() as u64, stats.removed);
            apply(&mut mirror, changes);
            let drawn: BTreeMap<u64, _> = cut.all_patches().map(|p| (p.handle, p.clone())).collect();
            prop_assert_eq!(drawn.keys().collect::<Vec<_>>(), mirror.keys().collect::<Vec<_>>());
            prop_assert!(drawn.iter().all(|(handle, patch)| Arc::ptr_eq(patch, &mirror[handle])));
            prop_assert_eq!(stats.patches as usize, cut.patches().len());
        }
        check_order(&source)?;
    }

    #[test]
    fn a_still_view_settles_and_then_nothing_changes(
        scene in scenes(),
        (first, second) in (stands(), stands()),
        (mut budget, refinements) in (budgets(), 1u64..50),
    ) {
        budget.refinements = refinements;
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        for stand in [first, second] {
            let view = view(&source, stand);
            let settled = settle(&mut cut, &view, &budget);
            for _ in 0..5 {
                let stats = cut.update(&view, &budget).unwrap();
                prop_assert_eq!([stats.refined, stats.coarsened, stats.added, stats.removed], [0; 4]);
                prop_assert_eq!(stats.bytes, settled.bytes);
            }
        }
    }

    #[test]
    fn a_trembling_eye_does_not_make_the_cut_oscillate(
        scene in scenes(),
        stand in stands(),
        patches in prop_oneof![Just(Budget::NO_LIMIT), 4u64..120],
    ) {
        let budget = Budget { patches, ..Budget::UNLIMITED };
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let trembling = |frame: usize| {
            let mut moved = stand;
            moved.above *= 1.0 + 0.0005 * [0.0, 1.0, -1.0, 0.5][frame % 4];
            view(&source, moved)
        };
        for frame in 0..40 {
            cut.update(&trembling(frame), &budget).unwrap();
        }
        for frame in 0..40 {
            let stats = cut.update(&trembling(frame), &budget).unwrap();
            // What comes over the screen's edge may still push the whole over a patch budget.
            if patches == Budget::NO_LIMIT {
                prop_assert_eq!([stats.refined, stats.coarsened], [0; 2], "frame {}", frame);
            }
        }
    }

    #[test]
    fn the_error_on_the_screen_stays_within_the_tolerance(
        scene in scenes(),
        stand in stands(),
    ) {
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), EXPANDED).unwrap();
        let view = view(&source, stand);
        let stats = settle(&mut cut, &view, &Budget::UNLIMITED);
        prop_assert!(!stats.cut_short);
        prop_assert!(stats.largest_error <= stand.tolerance);
        let surface = Surface::new(cut.patches(), &cut);
        let (w, h) = (i64::from(source.raster.width), i64::from(source.raster.height));
        for (column, row) in (0..w * h).map(|k| (k % w, k / w)) {
            let Some(sample) = source.raster.at([column, row]) else { continue };
            let (finest, depth) = project(&view, source.world([column, row], f64::from(sample)));
            let drawn = surface.height([column, row]);
            let on_screen = |pixel: [f64; 2], w: f64| {
                w >= 1.0 && (0.0..=1280.0).contains(&pixel[0]) && (0.0..=1024.0).contains(&pixel[1])
            };
            let Some(drawn) = drawn else {
                let is_lonely = may_be_open(&source.raster, [column, row], [column + 1, row]);
                prop_assert!(is_lonely || !on_screen(finest, depth), "visible ground is not drawn");
                continue;
            };
            let (own, own_depth) = project(&view, source.world([column, row], drawn));
            let both = depth >= 1.0 && own_depth >= 1.0;
            if both && (on_screen(finest, depth) || on_screen(own, own_depth)) {
                let distance = (finest[0] - own[0]).hypot(finest[1] - own[1]);
                prop_assert!(distance <= stand.tolerance * (1.0 + 1e-9), "{} pixels", distance);
            }
        }
    }

    #[test]
    fn a_settled_cut_is_as_good_as_a_fresh_one(
        scene in scenes(),
        (first, second) in (stands(), stands()),
        patches in 4u64..150,
    ) {
        let budget = Budget { patches, ..Budget::UNLIMITED };
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        settle(&mut cut, &view(&source, first), &budget);
        let here = view(&source, second);
        let old = settle(&mut cut, &here, &budget);
        let fresh = settle(&mut Cut::new(source.clone(), COMPACT).unwrap(), &here, &budget);
        let tolerated = fresh.largest_error.max(second.tolerance);
        prop_assert!(old.largest_error <= 1.05 * tolerated, "{} {}", old.largest_error, tolerated);
    }

    #[test]
    fn compact_and_expanded_vertices_are_one_surface(
        scene in scenes(),
        stand in stands(),
    ) {
        let source = Arc::new(scene.source());
        let here = view(&source, stand);
        let [compact, expanded] = [COMPACT, EXPANDED].map(|options| {
            let mut cut = Cut::new(source.clone(), options).unwrap();
            cut.update(&here, &Budget::UNLIMITED).unwrap();
            cut
        });
        let grid = compact.grid().to_vec();
        let patches = expanded.all_patches().map(|patch| ((patch.diamond, patch.half), patch));
        let expanded: HashMap<_, _> = patches.collect();
        prop_assert_eq!(compact.all_patches().count(), expanded.len());
        for patch in compact.all_patches() {
            let other = expanded[&(patch.diamond, patch.half)];
            prop_assert_eq!(&patch.indices, &other.indices);
            prop_assert_eq!((patch.origin, patch.corners), (other.origin, other.corners));
            let vertices = patch.vertices.chunks(3).zip(other.vertices.chunks(6)).zip(&grid);
            for ((compact, expanded), [p, q]) in vertices {
                prop_assert_eq!(compact[0], expanded[2]);
                for axis in 0..2 {
                    let place = p * patch.legs[0][axis] + q * patch.legs[1][axis];
                    prop_assert_eq!(place, expanded[axis]);
                }
                let length = expanded[3..].iter().map(|n| n * n).sum::<f32>().sqrt();
                prop_assert!((length - 1.0).abs() < 1e-6);
                prop_assert!((compact[1] + expanded[3] / expanded[5]).abs() <= 1e-5 * (1.0 + compact[1].abs()));
                prop_assert!((compact[2] + expanded[4] / expanded[5]).abs() <= 1e-5 * (1.0 + compact[2].abs()));
            }
        }
    }

    #[test]
    fn the_finest_patches_are_the_samples(scene in scenes()) {
        let source = Arc::new(MemorySource::rough(scene.raster(), scene.cells_log2, 1e9));
        let mut cut = Cut::new(source.clone(), EXPANDED).unwrap();
        cut.update(&overview(&source, 1.0), &Budget::UNLIMITED).unwrap();
        let mut seen = HashSet::new();
        for patch in cut.all_patches() {
            prop_assert_eq!(patch.level, source.lattice().levels());
            let indices = patch.indices.as_deref().unwrap_or(cut.triangle_list());
            for &index in indices {
                let vertex = &patch.vertices[usize::from(index) * 6..][..3];
                let at = [0, 1].map(|axis| patch.origin[axis] as i64 + vertex[axis] as i64);
                let height = patch.origin[2] as i32 + vertex[2] as i32;
                prop_assert_eq!(source.raster.at(at), Some(height));
                seen.insert(at);
            }
        }
        if source.raster.samples.iter().all(|sample| sample.is_some()) {
            prop_assert_eq!(seen.len(), source.raster.samples.len());
        }
    }

    #[test]
    fn patches_come_near_to_far(
        scene in scenes(),
        stand in stands(),
    ) {
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let view = view(&source, stand);
        cut.update(&view, &Budget::UNLIMITED).unwrap();
        let distance = |patch: &Patch| -> f64 {
            let [low, high] = patch.bounds;
            let nearest = |axis: usize| view.eye[axis].clamp(low[axis], high[axis]) - view.eye[axis];
            (0..3).map(|axis| nearest(axis).powi(2)).sum()
        };
        prop_assert!(cut.patches().is_sorted_by_key(|patch| distance(patch)));
    }

    #[test]
    fn a_plane_has_one_slope_everywhere(
        (a, b) in (-50i32..50, -50i32..50),
        (depth, cells) in (0u32..4, 2u32..5),
        frames in prop::collection::vec(stands(), 1..4),
    ) {
        let side = (1 << (depth + cells)) + 1;
        let plane = |column: i64, row: i64| Some(a * column as i32 + b * row as i32);
        let source = Arc::new(MemorySource::rough(Raster::new(side, side, plane), cells, 100.0));
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        // Half a metre a unit, thirty metres a sample, rows running south.
        let expected = [a as f32 * 0.5 / 30.0, b as f32 * 0.5 / -30.0];
        for stand in frames {
            cut.update(&view(&source, stand), &Budget::UNLIMITED).unwrap();
            for patch in cut.all_patches() {
                for vertex in patch.vertices.chunks(3) {
                    prop_assert!((vertex[1] - expected[0]).abs() < 1e-5, "{:?} {:?}", vertex, expected);
                    prop_assert!((vertex[2] - expected[1]).abs() < 1e-5, "{:?} {:?}", vertex, expected);
                }
            }
        }
    }

    #[test]
    fn a_failing_source_leaves_a_legal_cut(
        scene in scenes(),
        frames in prop::collection::vec(stands(), 1..5),
        every in 2u64..12,
    ) {
        let mut source = scene.source();
        let lattice = source.lattice().clone();
        let all = (0..lattice.diamond_count()).filter(|rank| (rank * 7 + 3) % every == 0);
        source.broken = all.map(|rank| lattice.diamond(rank)).collect();
        let source = Arc::new(source);
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        for stand in frames {
            let view = view(&source, stand);
            settle(&mut cut, &view, &Budget::UNLIMITED);
            prop_assert_eq!(cracks(&cut, &source), 0);
        }
        let asked = source.asked.lock().unwrap();
        let mut failures = asked.iter().filter(|(diamond, _)| source.broken.contains(diamond));
        let mut once = HashSet::new();
        prop_assert!(failures.all(|(diamond, _)| once.insert(*diamond)));
    }
}

fn apply(mirror: &mut BTreeMap<u64, Arc<Patch>>, changes: kimberlite::cut::Changes) {
    for handle in changes.removed {
        assert!(
            mirror.remove(&handle).is_some(),
            "removed what was never added"
        );
    }
    for patch in changes.added {
        assert!(mirror.insert(patch.handle, patch).is_none(), "added twice");
    }
}

/// Every diamond's parents were refined before it.
fn check_order(source: &MemorySource) -> Result<(), TestCaseError> {
    let mut seen = HashSet::new();
    for (diamond, _) in source.asked.lock().unwrap().iter() {
        for parent in source.lattice().parents(*diamond).into_iter().flatten() {
            prop_assert!(seen.contains(&parent));
        }
        seen.insert(*diamond);
    }
    Ok(())
}

/// The drawn triangles, found again by the samples under them.
struct Surface {
    heights: HashMap<[i64; 2], f64>,
}

impl Surface {
    /// Of expanded patches.
    fn new(patches: &[Arc<Patch>], cut: &Cut) -> Surface {
        let mut heights = HashMap::new();
        for patch in patches {
            let vertex = |index: u16| {
                let vertex = &patch.vertices[usize::from(index) * 6..][..3];
                let place = [0, 1, 2].map(|axis| patch.origin[axis] + f64::from(vertex[axis]));
                ([place[0] as i64, place[1] as i64], place[2])
            };
            let indices = patch.indices.as_deref().unwrap_or(cut.triangle_list());
            for triangle in indices.chunks(3) {
                add_samples([0, 1, 2].map(|k| vertex(triangle[k])), &mut heights);
            }
        }
        Surface { heights }
    }

    fn height(&self, place: [i64; 2]) -> Option<f64> {
        self.heights.get(&place).copied()
    }
}

/// Heights of all samples that a triangle covers.
fn add_samples(corners: [([i64; 2], f64); 3], heights: &mut HashMap<[i64; 2], f64>) {
    let places = corners.map(|(place, _)| place);
    let span = |axis: usize| {
        let ends = places.map(|place| place[axis]);
        ends.into_iter().min().unwrap()..=ends.into_iter().max().unwrap()
    };
    let cross = |a: [i64; 2], b: [i64; 2], c: [i64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    let area = cross(places[0], places[1], places[2]);
    for row in span(1) {
        for column in span(0) {
            let at = [column, row];
            let parts = [
                cross(at, places[1], places[2]),
                cross(places[0], at, places[2]),
                cross(places[0], places[1], at),
            ];
            if parts.iter().all(|part| part * area.signum() >= 0) {
                let height: f64 = parts
                    .iter()
                    .zip(corners)
                    .map(|(&p, (_, z))| p as f64 * z)
                    .sum();
                heights.insert(at, height / area as f64);
            }
        }
    }
}

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
        let mut cut = Cut::new(source.clone(), options).unwrap();
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
            if options == EXPANDED && float < 2 {
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
