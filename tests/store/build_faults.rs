//! Whole builds onto a medium that fails: the file, or an error and nothing; and what the medium lost without a word is found.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use kimberlite::build::source::InMemory;
use kimberlite::build::{BuildOptions, BuildReport, Predecessor, Replacement, build_into, replace};
use kimberlite::codec::Components;
use kimberlite::cut::Layer;
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::store::Access;
use kimberlite::tool;
use kimberlite::{Error, Result};

use crate::content::Folder;
use crate::faulty_sink::{Fault, FaultySink};

const SIDES: [u32; 2] = [45, 38];
/// Bytes of a write: many calls for a small file.
const STEP: usize = 96;

/// Builds a small terrain with voids through a sink; returns also the calls that the sink got.
fn build(path: &Path, change: impl Fn(&mut FaultySink)) -> (Result<BuildReport>, usize) {
    let mut info = RasterInfo::new(SIDES[0], SIDES[1], SampleType::I16);
    info.nodata = Some(-32768.0);
    info.crs = "EPSG:26910".to_owned();
    let height = |index: u32| match [index % SIDES[0], index / SIDES[0]] {
        [column, row] if column / 7 == row / 5 => i16::MIN,
        [column, row] => (column * row % 97 + 3 * column) as i16,
    };
    let samples: Vec<i16> = (0..SIDES[0] * SIDES[1]).map(height).collect();
    let options = BuildOptions {
        cells_log2: 4,
        threads: 1,
        ..BuildOptions::default()
    };
    let mut source = InMemory::new(info, &samples).unwrap();
    let mut sink = FaultySink::new(path);
    sink.step = STEP;
    change(&mut sink);
    let calls = Arc::clone(&sink.calls);
    let result = build_into(&mut source, &options, path, Box::new(sink), &mut |_, _| {
        true
    });
    (result, calls.load(Ordering::Relaxed))
}

/// The file of an undisturbed build, and the calls that it takes.
fn undisturbed() -> (Vec<u8>, usize) {
    let folder = Folder::new();
    let (result, calls) = build(&folder.file(), |_| ());
    let bytes = std::fs::read(folder.file()).unwrap();
    assert_eq!(result.unwrap().bytes, bytes.len() as u64);
    assert!(calls > 20, "too few calls to tell: {calls}");
    (bytes, calls)
}

fn assert_nothing_left(folder: &Folder, result: Result<BuildReport>, what: &str) {
    let error = result.expect_err(what);
    assert!(matches!(error, Error::Io { .. }), "{what}: {error}");
    let (line, file) = (error.to_string(), folder.file());
    let names_file = line.starts_with(&file.display().to_string());
    assert!(names_file && !line.contains('\n'), "{what}: {line}");
    assert!(folder.names().is_empty(), "{what}: {:?}", folder.names());
}

/// Whether opening or verifying the file tells that it is not as it was written.
fn is_detected(path: &Path) -> bool {
    Layer::open(path, Access::Map).map_or_else(
        |error| matches!(error, Error::Damaged { .. } | Error::Input { .. }),
        |layer| !tool::verify(&layer, None, &mut |_, _| true).unwrap().ok,
    )
}

#[test]
fn a_write_error_a_torn_write_a_failing_sync_or_publish_at_any_call_of_a_build() {
    let (good, calls) = undisturbed();
    for fault in [Fault::Error, Fault::OneError, Fault::TornError] {
        for call in 1..=calls {
            let folder = Folder::new();
            let (result, _) = build(&folder.file(), |sink| {
                (sink.fault, sink.fault_at) = (fault, call)
            });
            assert_nothing_left(&folder, result, &format!("{fault:?} at call {call}"));
        }
    }
    // The same medium, once it is well again.
    let folder = Folder::new();
    build(&folder.file(), |sink| sink.fault_at = 5)
        .0
        .unwrap_err();
    build(&folder.file(), |_| ()).0.unwrap();
    assert_eq!(std::fs::read(folder.file()).unwrap(), good);
}

/// Replaces a few samples through a sink; returns also the calls that the sink got.
fn update(path: &Path, change: impl Fn(&mut FaultySink)) -> (Result<u64>, usize) {
    let layer = Layer::open(path, Access::Map).unwrap();
    let Components::Height(units) = layer.components() else {
        unreachable!("it holds heights");
    };
    let old = Predecessor {
        store: layer.store(),
        lattice: layer.lattice(),
        units,
        codec: layer.codec(),
        root: layer.root(),
    };
    let new = Replacement::new(layer.header(), [40, 30], 2, vec![7.0; 4]).unwrap();
    let mut sink = FaultySink::new(path);
    sink.step = STEP;
    change(&mut sink);
    let calls = Arc::clone(&sink.calls);
    let replaced = replace(&old, &new, (path, Box::new(sink)), 1, &mut |_, _| true);
    let diamonds = replaced.map(|replaced| replaced.expect("few diamonds").diamonds);
    (diamonds, calls.load(Ordering::Relaxed))
}

#[test]
fn an_update_that_fails_at_any_call_leaves_the_old_file() {
    let folder = Folder::new();
    build(&folder.file(), |_| ()).0.unwrap();
    let old = std::fs::read(folder.file()).unwrap();
    let (diamonds, calls) = update(&folder.file(), |_| ());
    assert!(diamonds.unwrap() > 0 && calls > 20);
    assert_ne!(std::fs::read(folder.file()).unwrap(), old);
    for fault in [Fault::Error, Fault::OneError, Fault::TornError] {
        for call in 1..=calls {
            std::fs::write(folder.file(), &old).unwrap();
            let (result, _) = update(&folder.file(), |sink| {
                (sink.fault, sink.fault_at) = (fault, call)
            });
            assert!(
                matches!(result, Err(Error::Io { .. })),
                "{fault:?} at call {call}"
            );
            assert_eq!(
                std::fs::read(folder.file()).unwrap(),
                old,
                "{fault:?} at call {call}"
            );
            assert_eq!(folder.names().len(), 1, "{:?}", folder.names());
        }
    }
}

#[test]
fn a_full_disk_at_any_write_of_a_build() {
    let (good, _) = undisturbed();
    for space in (0..good.len()).step_by(STEP).chain([good.len() - 1]) {
        let folder = Folder::new();
        let (result, _) = build(&folder.file(), |sink| sink.space = space);
        assert_nothing_left(&folder, result, &format!("room for {space} bytes"));
    }
    let folder = Folder::new();
    build(&folder.file(), |sink| sink.space = good.len())
        .0
        .unwrap();
    assert_eq!(std::fs::read(folder.file()).unwrap(), good);
}

#[test]
fn a_write_that_vanishes_or_a_tail_that_does_is_found_by_verify() {
    let (good, calls) = undisturbed();
    let mut detected = 0;
    for fault in [Fault::Lost, Fault::Torn] {
        // The last two calls are sync and publish.
        for call in 1..=calls - 2 {
            let folder = Folder::new();
            let (result, _) = build(&folder.file(), |sink| {
                (sink.fault, sink.fault_at) = (fault, call)
            });
            result.unwrap();
            let same = std::fs::read(folder.file()).unwrap() == good;
            assert_eq!(
                !is_detected(&folder.file()),
                same,
                "{fault:?} of call {call}"
            );
            detected += usize::from(!same);
        }
    }
    // What was lost is rarely what a hole in a file reads as.
    assert!(detected > 2 * calls - 10, "{detected} of {calls} calls");
}
