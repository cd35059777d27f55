//! Heights at random places of a real raster against its own surface.

use crate::surface::Ground;
use kimberlite::build::source::{SourceOptions, open};
use kimberlite::build::{BuildOptions, build};
use kimberlite::cut::{Query, Terrain};
use kimberlite::store::Access;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Uniform in 0..1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut hash = *state;
    hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((hash ^ (hash >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// The raster that `KIMBERLITE_HEIGHTS` names, else one of `data/`.
fn raster() -> PathBuf {
    let shipped = || Path::new(env!("CARGO_MANIFEST_DIR")).join("data/srtm3_S33W071.tif");
    std::env::var_os("KIMBERLITE_HEIGHTS").map_or_else(shipped, PathBuf::from)
}

/// `make soak` takes a million, and tells how long they take.
#[test]
fn heights_at_random_places_are_within_their_bound_of_the_input() {
    let is_soak = std::env::var_os("KIMBERLITE_SOAK").is_some();
    let count = if is_soak { 1_000_000 } else { 100_000 };
    let folder = tempfile::tempdir().unwrap();
    let raster = raster();
    for max_error in [0.0, 3.0] {
        let mut source = open(&raster, &SourceOptions::default()).unwrap();
        let info = source.info().clone();
        let mut samples = vec![0.0; info.width as usize * info.height as usize];
        source.read_rows(&mut samples).unwrap();
        let mut source = open(&raster, &SourceOptions::default()).unwrap();
        let path = folder.path().join(format!("{max_error}.kmb"));
        let options = BuildOptions {
            max_error,
            ..BuildOptions::default()
        };
        build(source.as_mut(), &options, &path, &mut |_, _| true).unwrap();
        let terrain = Arc::new(Terrain::open(&path, Access::Map).unwrap());
        let ground = Ground::new(&terrain, &samples);
        let mut query = Query::new(terrain, 256 << 20);
        let last = ground.size.map(|side| side as f64 - 1.0);
        let (mut state, mut largest, begun) = (1, 0.0f64, Instant::now());
        for _ in 0..count {
            let at = last.map(|last| last * random(&mut state));
            let found = query.height_at_grid(at[0], at[1]).unwrap();
            let expected = ground.height(at);
            assert_eq!(found.is_some(), expected.is_some(), "{at:?}");
            let (Some(found), Some(expected)) = (found, expected) else {
                continue;
            };
            let distance = (found.height - expected).abs();
            let rounding = 1e-9 * (1.0 + expected.abs());
            assert!(
                distance <= found.error_bound + rounding,
                "{distance} at {at:?}"
            );
            assert!(found.error_bound <= max_error * info.value_scale.abs());
            largest = largest.max(distance);
        }
        let seconds = begun.elapsed().as_secs_f64();
        println!("{count} heights at {max_error}: at most {largest} apart, {seconds:.2} s");
    }
}
