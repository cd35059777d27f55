//! What tolerances are about: errors on the screen, or the size of triangles.

use crate::scenes::*;
use crate::support::camera::{VIEWPORT, project};
use crate::support::memory::{MemorySource, Raster};
use kimberlite::cut::{Cut, CutOptions, DiamondSource, Metric, Patch, View};
use kimberlite::schedule::Budget;
use proptest::prelude::*;
use std::sync::Arc;

const SAMPLING: CutOptions = CutOptions {
    metric: Metric::Sampling,
    ..EXPANDED
};

/// Width and height of what is on the screen of a patch's box, in pixels; `None` where some of it is not in front
/// of the eye.
fn box_on_screen(cut: &Cut, patch: &Patch, view: &View) -> Option<[f64; 2]> {
    let map = cut.grid_to_world();
    let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for vertex in patch.vertices.chunks(6) {
        let place: [f64; 3] = std::array::from_fn(|axis| {
            map.origin[axis] + map.step[axis] * (patch.origin[axis] + f64::from(vertex[axis]))
        });
        let (pixel, depth) = project(view, place);
        if depth < 1.0 {
            return None;
        }
        for axis in 0..2 {
            let at = pixel[axis].clamp(0.0, VIEWPORT[axis]);
            ends[axis] = [ends[axis][0].min(at), ends[axis][1].max(at)];
        }
    }
    Some(ends.map(|[low, high]| high - low))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn by_sampling_triangles_are_no_larger_than_the_tolerance(
        scene in scenes(),
        stand in stands(),
    ) {
        let source = Arc::new(scene.source());
        let mut cut = Cut::new(source.clone(), SAMPLING).unwrap();
        let view = view(&source, stand);
        let stats = settle(&mut cut, &view, &Budget::UNLIMITED);
        prop_assert!(!stats.cut_short && stats.largest_error <= stand.tolerance);
        let lattice = source.lattice();
        for patch in cut.patches().iter().filter(|patch| patch.level < lattice.levels()) {
            let Some([width, height]) = box_on_screen(&cut, patch, &view) else { continue };
            let side = (width * height).sqrt() / lattice.cells() as f64;
            prop_assert!(side <= stand.tolerance * (1.0 + 1e-9), "{} pixels", side);
        }
        prop_assert_eq!(cracks(&cut, &source), 0);
    }
}

#[test]
fn flat_land_is_refined_for_its_size_but_not_for_its_error() {
    let flat = Raster::new(129, 129, |_, _| Some(7));
    let source = Arc::new(MemorySource::exact(flat, 3));
    let view = overview(&source, 2.0);
    let count = |metric: Metric| {
        let mut cut = Cut::new(source.clone(), CutOptions { metric, ..COMPACT }).unwrap();
        settle(&mut cut, &view, &Budget::UNLIMITED).patches
    };
    assert_eq!(count(Metric::Geometric), 2);
    assert!(count(Metric::Sampling) > 30);
}
