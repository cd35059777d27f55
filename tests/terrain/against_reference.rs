//! The real repository against the reference model: every vertex of every diamond, its validity, and its
//! stored error and range.

use crate::rasters::{Raster, decode_diamonds};
use crate::reference::model::{Model, encode_from};
use kimberlite::build::BuildOptions;
use kimberlite::cut::{DiamondSource, Terrain};
use kimberlite::geo::SampleType;
use kimberlite::lattice::Diamond;
use kimberlite::store::Access;
use proptest::prelude::*;

fn rasters() -> impl Strategy<Value = Raster> {
    (2u32..70, 2u32..70, any::<u64>(), 0u32..4).prop_map(|(width, height, seed, voids)| {
        let mut state = seed | 1;
        let mut random = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        let samples = (0..width * height).map(|index| {
            let (column, row) = (index % width, index / width);
            let is_void = match voids {
                0 => false,
                1 => random() % 9 == 0,
                2 => column / 9 == 1 || row / 11 == 2,
                _ => random() % 9 != 0,
            };
            let height = f64::from(column * row % 97) - 40.0 + (random() % 25) as f64;
            if is_void { f64::NAN } else { height }
        });
        Raster::new(width, height, SampleType::I16, samples.collect())
    })
}

fn model_of(raster: &Raster, terrain: &Terrain, bound: i64) -> Model {
    let unit = |sample: &f64| (!sample.is_nan()).then_some(*sample as i64);
    let samples = raster.samples.iter().map(unit).collect();
    let (width, height) = (raster.info.width as usize, raster.info.height as usize);
    let model = crate::reference::model::Raster::new(width, height, samples);
    let side = terrain.lattice().cells() + 1;
    encode_from(
        &model,
        terrain.lattice().cells_log2(),
        bound,
        |(i, j), input| {
            let value = i64::from(terrain.root().values[j as usize * side + i as usize]);
            assert!(
                (value - input).abs() <= bound,
                "a root vertex is off by more than {bound}"
            );
            value
        },
    )
}

/// Descends through the first existing parents, whose ranges the codes refer to.
pub fn summary_of(terrain: &Terrain, diamond: Diamond) -> kimberlite::cut::Summary {
    let parent = terrain
        .lattice()
        .parents(diamond)
        .into_iter()
        .flatten()
        .next();
    let range = parent.map_or(terrain.range(), |parent| summary_of(terrain, parent).range);
    terrain.summary(diamond, range).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_vertex_error_and_range_is_the_reference_models(raster in rasters(), bound in 0i64..6) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        // The model's prediction is the fixed rule.
        let options = BuildOptions {
            max_error: bound as f64,
            adaptive: Some(false),
            cells_log2: 4,
            ..BuildOptions::default()
        };
        raster.build_with(&path, &options).unwrap();
        let terrain = Terrain::open(&path, Access::Map).unwrap();
        let model = model_of(&raster, &terrain, bound);
        let all = decode_diamonds(&terrain);
        prop_assert_eq!(all.len(), model.diamonds.len());
        let errors = model.errors();
        for (diamond, record) in &model.diamonds {
            let id = Diamond::planar(diamond.x as i32, diamond.y as i32);
            let (vertices, refined) = &all[&id];
            for (index, expected) in record.vertices.iter().enumerate() {
                prop_assert_eq!(i64::from(vertices.values[index]), expected.value, "{:?}", diamond);
            }
            for (index, expected) in record.centres.iter().enumerate() {
                let Some(expected) = expected else { continue };
                let centres = &refined.as_ref().unwrap().centres;
                prop_assert_eq!(i64::from(centres.values[index]), *expected, "{:?}", diamond);
                prop_assert_eq!(centres.is_valid(index), record.coefficients[index].is_some());
            }
            if diamond.level < model.lattice.leaf_level() {
                let summary = summary_of(&terrain, id);
                let exact = errors[diamond];
                prop_assert!(summary.error >= exact, "{:?}: {} under {}", diamond, summary.error, exact);
                let allowed = (1.25 * exact).max(1.0 / 64.0);
                prop_assert!(exact == 0.0 && summary.error == 0.0 || summary.error <= allowed,
                    "{:?}: {} over {}", diamond, summary.error, exact);
                for vertex in &record.vertices {
                    let range = i64::from(summary.range[0])..=i64::from(summary.range[1]);
                    prop_assert!(range.contains(&vertex.value));
                }
            }
        }
    }

    #[test]
    fn errors_and_ranges_of_a_diamond_contain_those_of_its_children(raster in rasters()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        raster.build(&path, 2.0, 4).unwrap();
        let terrain = Terrain::open(&path, Access::Map).unwrap();
        let lattice = terrain.lattice();
        for level in 1..lattice.levels() {
            for child in lattice.diamonds(level) {
                let inner = summary_of(&terrain, child);
                for (place, parent) in lattice.parents(child).into_iter().flatten().enumerate() {
                    let outer = summary_of(&terrain, parent);
                    prop_assert!(outer.error >= inner.error);
                    if place == 0 {
                        prop_assert!(outer.range[0] <= inner.range[0]);
                        prop_assert!(outer.range[1] >= inner.range[1]);
                    }
                }
            }
        }
    }
}
