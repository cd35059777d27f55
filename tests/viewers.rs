//! Several viewers at once on one repository. Alone in its process, because the memory that is counted is the process's.

#[allow(dead_code)]
#[path = "cut/scenes.rs"]
mod scenes;
mod support;

use kimberlite::build::BuildOptions;
use kimberlite::cut::{Cut, CutOptions, Layer, Terrain};
use kimberlite::schedule::Budget;
use kimberlite::store::Access;
use scenes::*;
use std::sync::Arc;
use std::time::{Duration, Instant};
use support::memory::MemorySource;
use support::repositories::build_at;

const SHARED: u64 = 4 << 20;

/// One viewer's flight until `end`: the frames flown.
fn view_until(end: Instant, number: u32, terrain: &Arc<Terrain>, source: &MemorySource) -> u64 {
    let options = CutOptions {
        threads: number as usize,
        ..EXPANDED
    };
    let budget = Budget {
        microseconds: 4000,
        bytes: 8 << 20,
        ..Budget::UNLIMITED
    };
    let mut cut = Cut::new(terrain.clone(), options).unwrap();
    let mut frames = 0u64;
    while Instant::now() < end || frames < 100 {
        let turn = frames as f64 / 150.0 + f64::from(number);
        let here = Stand {
            at: [0.5 + 0.4 * turn.sin(), 0.5 + 0.4 * (1.3 * turn).cos()],
            above: 40.0 + 400.0 * (0.7 * turn).sin().abs(),
            target: [0.5, 0.5],
            tolerance: 0.5,
        };
        let stats = cut.update(&view(source, here), &budget).unwrap();
        assert!(stats.bytes <= budget.bytes && stats.late_refinements == 0);
        cut.take_changes();
        if frames.is_multiple_of(100) {
            assert_eq!(cracks(&cut, source), 0);
        }
        frames += 1;
    }
    frames
}

/// Pages of memory that the process has, where that is told.
fn pages() -> Option<u64> {
    let told = std::fs::read_to_string("/proc/self/statm").ok()?;
    told.split(' ').nth(1)?.parse().ok()
}

/// With KIMBERLITE_SOAK ten minutes.
#[test]
fn four_viewers_on_one_repository_neither_race_nor_leak() {
    let soak = std::env::var_os("KIMBERLITE_SOAK").is_some();
    let duration = Duration::from_millis(if soak { 600_000 } else { 1500 });
    let source = Scene {
        size: [400, 300],
        seed: 5,
        voids: Voids::Blob,
        cells_log2: 4,
    }
    .source();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let options = BuildOptions {
        cells_log2: 4,
        ..BuildOptions::default()
    };
    build_at(&path, &source, &options);
    let layer = Layer::open(&path, Access::Map).unwrap();
    let layer = layer.sharing(SHARED).unwrap();
    let terrain = Arc::new(Terrain::of(Arc::new(layer)).unwrap());
    let fly = |duration: Duration| {
        let end = Instant::now() + duration;
        std::thread::scope(|scope| {
            let (terrain, source) = (&terrain, &source);
            let viewers: Vec<_> = (0..4)
                .map(|number| scope.spawn(move || view_until(end, number, terrain, source)))
                .collect();
            let frames = viewers.into_iter().map(|viewer| viewer.join().unwrap());
            frames.sum::<u64>()
        })
    };
    fly(duration / 10);
    let before = pages();
    let frames = fly(duration);
    println!(
        "{frames} frames; pages before and after: {before:?}, {:?}",
        pages()
    );
    if let (Some(before), Some(after)) = (before, pages()) {
        assert!(after < before + 4096, "{before} pages became {after}");
    }
    assert_eq!(
        Arc::strong_count(&terrain),
        1,
        "cuts or their threads remain"
    );
}
