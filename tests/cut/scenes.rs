//! Terrains, views and budgets to try a cut with.

use crate::support::camera::looking;
use crate::support::memory::{MemorySource, Raster};
use kimberlite::cut::{Cut, CutOptions, DiamondSource, Metric, Stats, VertexForm, View};
use kimberlite::lattice::Diamond;
use kimberlite::schedule::Budget;
use kimberlite::tool::count_cracks;
use proptest::prelude::*;

pub const COMPACT: CutOptions = CutOptions {
    vertex_form: VertexForm::Compact,
    ..EXPANDED
};
pub const EXPANDED: CutOptions = CutOptions::DEFAULT;

/// Random cases; KIMBERLITE_CASES asks for another number.
pub fn config(cases: u32) -> ProptestConfig {
    let asked = std::env::var("KIMBERLITE_CASES").ok();
    let asked = asked.and_then(|asked| asked.parse().ok());
    ProptestConfig::with_cases(asked.unwrap_or(cases))
}

/// Of errors on the screen or of the size of triangles.
pub fn by_any_metric() -> impl Strategy<Value = CutOptions> {
    let metrics = prop_oneof![Just(Metric::Geometric), Just(Metric::Sampling)];
    metrics.prop_map(|metric| CutOptions { metric, ..COMPACT })
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Voids {
    None,
    Sparse,
    Blob,
}

/// Hills with noise on them.
pub fn hills(width: u32, height: u32, seed: u64, voids: Voids) -> Raster {
    Raster::new(width, height, |column, row| {
        let mut hash =
            (column as u64) << 32 ^ row as u64 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let noise = (hash >> 40) % 32;
        let wave = 300.0 * (column as f64 / 17.0).sin() * (row as f64 / 23.0).cos();
        let is_void = match voids {
            Voids::None => false,
            Voids::Sparse => (hash >> 20).is_multiple_of(400),
            Voids::Blob => (column - 20).pow(2) + (row - 30).pow(2) < 150,
        };
        (!is_void).then(|| wave as i32 + noise as i32)
    })
}

/// Hills of some size, in diamonds of some size.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub size: [u32; 2],
    pub seed: u64,
    pub voids: Voids,
    pub cells_log2: u32,
}

impl Scene {
    pub fn raster(&self) -> Raster {
        hills(self.size[0], self.size[1], self.seed, self.voids)
    }

    pub fn source(&self) -> MemorySource {
        MemorySource::exact(self.raster(), self.cells_log2)
    }
}

pub fn scenes() -> impl Strategy<Value = Scene> {
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
pub struct Stand {
    pub at: [f64; 2],
    pub above: f64,
    pub target: [f64; 2],
    pub tolerance: f64,
}

pub fn stands() -> impl Strategy<Value = Stand> {
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

pub fn view(source: &MemorySource, stand: Stand) -> View {
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

pub fn budgets() -> impl Strategy<Value = Budget> {
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
pub fn may_be_open(raster: &Raster, a: [i64; 2], b: [i64; 2]) -> bool {
    let reach = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    let span = |axis: usize| a[axis].min(b[axis]) - reach..=a[axis].max(b[axis]) + reach;
    span(1).any(|row| span(0).any(|column| raster.at([column, row]).is_none()))
}

pub fn cracks(cut: &Cut, source: &MemorySource) -> u64 {
    let has_voids = source.raster.samples.iter().any(|sample| sample.is_none());
    let patches = cut.all_patches().map(|patch| &**patch);
    count_cracks(patches, source.lattice(), |a, b| {
        has_voids && may_be_open(&source.raster, a, b)
    })
}

pub fn settle(cut: &mut Cut, view: &View, budget: &Budget) -> Stats {
    for _ in 0..5000 {
        let stats = cut.update(view, budget).unwrap();
        assert!(
            stats.budget_too_small
                || (stats.patches <= budget.patches && stats.bytes <= budget.bytes),
            "{stats:?} over {budget:?}"
        );
        if stats.refined + stats.coarsened + stats.added == 0 {
            return stats;
        }
    }
    panic!("a still view never settles");
}

/// A camera high above the middle that sees everything.
pub fn overview(source: &MemorySource, tolerance: f64) -> View {
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

pub type Drawn = Vec<(Diamond, u8, Vec<u32>)>;

/// Every half of a cut with the bits of its vertices.
pub fn drawn(cut: &Cut) -> Drawn {
    let bits = |vertices: &[f32]| vertices.iter().map(|number| number.to_bits()).collect();
    let all = cut.all_patches();
    let mut all: Drawn = all
        .map(|patch| (patch.diamond, patch.half, bits(&patch.vertices)))
        .collect();
    all.sort();
    all
}
