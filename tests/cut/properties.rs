//! What holds for every terrain, view and budget.

use crate::scenes::*;
use crate::support::camera::{VIEWPORT, project};
use crate::support::memory::{MemorySource, Raster};
use kimberlite::cut::{Cut, DiamondSource, Patch};
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

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
        (scene, options) in (scenes(), by_any_metric()),
        (first, second) in (stands(), stands()),
        (mut budget, refinements) in (budgets(), 1u64..50),
    ) {
        budget.refinements = refinements;
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), options).unwrap();
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
        (scene, options) in (scenes(), by_any_metric()),
        stand in stands(),
        patches in prop_oneof![Just(Budget::NO_LIMIT), 4u64..120],
    ) {
        let budget = Budget { patches, ..Budget::UNLIMITED };
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), options).unwrap();
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
                w >= 1.0 && (0.0..=VIEWPORT[0]).contains(&pixel[0])
                    && (0.0..=VIEWPORT[1]).contains(&pixel[1])
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
    fn no_height_error_looks_larger_than_its_bound(
        (stand, error) in (stands(), 1.0f64..300.0),
        points in prop::collection::vec(([0.0f64..1.0, 0.0f64..1.0], 0.0f64..1.0, -1.0f64..1.0), 400),
    ) {
        let source = Arc::new(MemorySource::rough(hills(9, 9, 1, Voids::None), 2, error));
        let mut cut = Cut::new(source.clone(), COMPACT).unwrap();
        let view = view(&source, stand);
        let frozen = Budget { refinements: 0, ..Budget::UNLIMITED };
        let bound = cut.update(&view, &frozen).unwrap().largest_error;
        let [low, high] = source.range().map(f64::from);
        for ([x, y], z, shift) in points {
            let unit = low + z * (high - low);
            let moved = (unit + shift * error).clamp(low, high);
            let [x, y] = source.frame().grid_to_world(8.0 * x, 8.0 * y);
            let [a, b] = [unit, moved].map(|unit| project(&view, [x, y, 100.0 + 0.5 * unit]));
            let on_screen = |[x, y]: [f64; 2]| {
                (0.0..=VIEWPORT[0]).contains(&x) && (0.0..=VIEWPORT[1]).contains(&y)
            };
            if a.1 >= 1.0 && b.1 >= 1.0 && (on_screen(a.0) || on_screen(b.0)) {
                let distance = (a.0[0] - b.0[0]).hypot(a.0[1] - b.0[1]);
                prop_assert!(distance <= bound * (1.0 + 1e-9), "{} over {}", distance, bound);
            }
        }
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
                let along = |axis: usize| p * patch.legs[0][axis] + q * patch.legs[1][axis];
                prop_assert_eq!([along(0), along(1)], [expanded[0], expanded[1]]);
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
pub struct Surface {
    heights: HashMap<[i64; 2], f64>,
}

impl Surface {
    /// Of expanded patches.
    pub fn new(patches: &[Arc<Patch>], cut: &Cut) -> Surface {
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

    /// All samples covered, with their heights.
    pub fn places(&self) -> impl Iterator<Item = ([i64; 2], f64)> + '_ {
        self.heights.iter().map(|(&place, &height)| (place, height))
    }

    pub fn height(&self, place: [i64; 2]) -> Option<f64> {
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
