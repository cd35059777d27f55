//! Heap allocations of a frame that changes nothing. Alone in its process, because the allocator is the process's.

mod support;

use kimberlite::cut::{Cut, CutOptions, DiamondSource, Metric, VertexForm, View};
use kimberlite::schedule::Budget;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use support::camera::looking;
use support::memory::{MemorySource, Raster};

/// The system's, with a count of this thread's allocations.
struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn count_one() {
    // A thread that is ending has none to count.
    let _ = COUNT.try_with(|count| count.set(count.get() + 1));
}

// SAFETY: all is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promise.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(block, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(act: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    act();
    COUNT.get() - before
}

fn mountains() -> Arc<MemorySource> {
    let height = |column: i64, row: i64| ((column * column + 3 * row * column) % 301) as i32;
    let raster = Raster::new(257, 257, |column, row| Some(height(column, row)));
    Arc::new(MemorySource::rough(raster, 3, 40.0))
}

/// From over the middle, the eye `shift` metres to the side.
fn view(source: &MemorySource, shift: f64) -> View {
    let [x, y] = source.frame().grid_to_world(128.0, 128.0);
    looking([x + shift, y - 900.0, 900.0], [x, y, 100.0], 1.0, 8.0)
}

#[test]
fn a_frame_that_changes_nothing_does_not_allocate() {
    let source = mountains();
    for (patches, bytes, metric) in [
        (Budget::NO_LIMIT, Budget::NO_LIMIT, Metric::Geometric),
        (Budget::NO_LIMIT, Budget::NO_LIMIT, Metric::Sampling),
        (60, Budget::NO_LIMIT, Metric::Geometric),
        (Budget::NO_LIMIT, 200_000, Metric::Geometric),
    ] {
        let options = CutOptions {
            vertex_form: VertexForm::Expanded,
            metric,
            ..CutOptions::default()
        };
        let budget = Budget {
            patches,
            bytes,
            ..Budget::UNLIMITED
        };
        let mut cut = Cut::new(source.clone(), options).unwrap();
        for _ in 0..100 {
            cut.update(&view(&source, 0.0), &budget).unwrap();
        }
        assert!(cut.patches().len() > 20);
        let still = allocations(|| {
            for _ in 0..20 {
                let stats = cut.update(&view(&source, 0.0), &budget).unwrap();
                assert_eq!(stats.refined + stats.coarsened + stats.added, 0);
            }
        });
        assert_eq!(still, 0, "{budget:?} {metric:?}");
    }
}

#[test]
fn an_eye_that_moves_without_need_of_change_does_not_allocate() {
    let source = mountains();
    let options = CutOptions {
        vertex_form: VertexForm::Compact,
        ..CutOptions::default()
    };
    let mut cut = Cut::new(source.clone(), options).unwrap();
    // Once there and back, so that all the way's needs are refined and hysteresis keeps them.
    let way = || {
        (0..50)
            .chain((0..50).rev())
            .map(|step| f64::from(step) * 0.2)
    };
    way().for_each(|shift| {
        cut.update(&view(&source, shift), &Budget::UNLIMITED)
            .unwrap();
    });
    let (mut changes, mut orders) = (0, 0);
    let mut first = Vec::with_capacity(10_000);
    let moving = allocations(|| {
        for shift in way() {
            let stats = cut
                .update(&view(&source, shift), &Budget::UNLIMITED)
                .unwrap();
            changes += stats.refined + stats.coarsened;
            let handles = cut.patches().iter().map(|patch| patch.handle);
            orders += u64::from(!handles.eq(first.iter().copied()));
            first.clear();
            first.extend(cut.patches().iter().map(|patch| patch.handle));
        }
    });
    assert_eq!(changes, 0);
    assert!(orders > 2, "patches come in other orders");
    assert_eq!(moving, 0);
}
