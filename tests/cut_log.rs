//! What a cut says to the log; alone in its process, because the log is the process's.

mod support;

use kimberlite::cut::{Cut, CutOptions, DiamondSource, VertexForm};
use kimberlite::schedule::Budget;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use support::camera::looking;
use support::memory::{MemorySource, Raster};

#[test]
fn a_broken_diamond_is_reported_once() {
    for threads in [0, 2] {
        report(threads);
    }
}

fn report(threads: usize) {
    let raster = Raster::new(65, 65, |column, row| Some((column * row % 97) as i32));
    let mut source = MemorySource::rough(raster, 3, 1e9);
    let broken = source.lattice().diamonds(2)[1];
    source.broken.insert(broken);
    let source = Arc::new(source);
    let messages = Arc::new(Mutex::new(Vec::new()));
    let sink = messages.clone();
    kimberlite::set_log_callback(Some(Box::new(move |_, message| {
        sink.lock().unwrap().push(message.to_string());
    })));
    let mut cut = Cut::new(
        source.clone(),
        CutOptions {
            vertex_form: VertexForm::Compact,
            threads,
            ..CutOptions::default()
        },
    )
    .unwrap();
    let [x, y] = source.frame().grid_to_world(32.0, 32.0);
    for turn in 0..6 {
        // To and fro, so that the diamond is dropped and comes again.
        let target = [x, y, if turn % 2 == 0 { 0.0 } else { 20_000.0 }];
        let view = looking([x, y, 10_000.0], target, 1.0, 1.0);
        // Threads take their time.
        for _ in 0..10_000 {
            let stats = cut.update(&view, &Budget::UNLIMITED).unwrap();
            if stats.refined + stats.coarsened + stats.awaited == 0 {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    kimberlite::set_log_callback(None);
    let expected = format!(
        "diamond ({}, {}) stays coarse: a broken block",
        broken.x, broken.y
    );
    assert_eq!(*messages.lock().unwrap(), [expected]);
}
