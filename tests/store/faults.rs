//! A medium that fails: a whole file, or an error and nothing.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use kimberlite::store::{Store, Writer};
use kimberlite::{Error, Result};

use crate::content::{BOTH, Content, Folder};
use crate::faulty_sink::{Fault, FaultySink};

/// Writes 70 small blocks through a sink.
fn write(folder: &Folder, change: impl Fn(&mut FaultySink)) -> (Result<u64>, usize) {
    let mut sink = FaultySink::new(&folder.file());
    change(&mut sink);
    let calls = Arc::clone(&sink.calls);
    let result = Content::small(70).write_to_sink(&folder.file(), Box::new(sink));
    (result, calls.load(Ordering::Relaxed))
}

fn assert_whole(folder: &Folder) {
    assert_eq!(folder.names(), ["terrain.kmb"]);
    assert_eq!(
        std::fs::read(folder.file()).unwrap(),
        Content::small(70).bytes()
    );
    for access in BOTH {
        Content::small(70).assert_held_by(&Store::open(&folder.file(), access).unwrap());
    }
}

#[test]
fn a_failure_at_the_nth_call_leaves_something() {
    for step in [usize::MAX, 61] {
        let folder = Folder::new();
        let (result, calls) = write(&folder, |sink| sink.step = step);
        result.unwrap();
        assert_whole(&folder);
        assert!(calls >= 6);
        for fail_at in 1..=calls {
            for fault in [Fault::Error, Fault::OneError, Fault::TornError] {
                let folder = Folder::new();
                let (result, _) = write(&folder, |sink| {
                    (sink.step, sink.fault_at, sink.fault) = (step, fail_at, fault);
                });
                let error = result.unwrap_err();
                assert!(matches!(error, Error::Io { .. }));
                let line = error.to_string();
                assert!(
                    line.starts_with(&folder.file().display().to_string()),
                    "{line}"
                );
                assert!(line.ends_with("injected"), "{line}");
                assert!(
                    folder.names().is_empty(),
                    "call {fail_at}: {:?}",
                    folder.names()
                );
            }
        }
    }
}

#[test]
fn a_failure_takes_the_file_that_was_there() {
    let folder = Folder::new();
    let (_, calls) = write(&Folder::new(), |_| ());
    for fail_at in 1..=calls {
        std::fs::write(folder.file(), b"older").unwrap();
        write(&folder, |sink| sink.fault_at = fail_at)
            .0
            .unwrap_err();
        assert_eq!(folder.names(), ["terrain.kmb"]);
        assert_eq!(std::fs::read(folder.file()).unwrap(), b"older");
    }
    write(&folder, |_| ()).0.unwrap();
    assert_whole(&folder);
}

#[test]
fn short_or_interrupted_writes_change_the_file() {
    for step in [1, 2, 7, 100] {
        let folder = Folder::new();
        write(&folder, |sink| {
            (sink.step, sink.interrupt_every) = (step, 2)
        })
        .0
        .unwrap();
        assert_whole(&folder);
    }
}

#[test]
fn a_full_disk_leaves_something() {
    let whole = Content::small(70).bytes().len();
    for space in (0..whole).step_by(7).chain([whole - 1]) {
        let folder = Folder::new();
        let error = write(&folder, |sink| sink.space = space).0.unwrap_err();
        let full = io::Error::from(io::ErrorKind::StorageFull);
        assert_eq!(
            error.to_string(),
            format!("{}: cannot write: {full}", folder.file().display())
        );
        assert!(folder.names().is_empty());
    }
    let folder = Folder::new();
    write(&folder, |sink| sink.space = whole).0.unwrap();
    assert_whole(&folder);
}

#[test]
fn a_sink_that_takes_nothing_hangs_the_writer() {
    let folder = Folder::new();
    let error = write(&folder, |sink| sink.step = 0).0.unwrap_err();
    assert!(matches!(error, Error::Io { .. }));
    assert!(folder.names().is_empty());
}

#[test]
fn a_write_error_that_was_ignored_ends_in_a_published_file() {
    let folder = Folder::new();
    let mut content = Content::small(70);
    content.blocks.fill(vec![3; 60_000]);
    let mut sink = FaultySink::new(&folder.file());
    (sink.fault_at, sink.fault) = (2, Fault::OneError);
    let mut writer =
        Writer::with_sink(&folder.file(), Box::new(sink), &content.header, b"", b"").unwrap();
    let mut refused = 0;
    for block in &content.blocks {
        refused += usize::from(writer.push(block).is_err());
    }
    assert!(refused > 0);
    for _ in 0..refused {
        let _ = writer.push(&content.blocks[0]);
    }
    writer.finish(&content.header, &content.codes).unwrap_err();
    assert!(folder.names().is_empty());
}

#[test]
fn an_unfinished_writer_leaves_something() {
    let folder = Folder::new();
    let content = Content::small(70);
    let begin = || Writer::create(&folder.file(), &content.header, b"", b"").unwrap();
    let mut writer = begin();
    writer.push(b"block").unwrap();
    assert_eq!(folder.names().len(), 1);
    assert!(!folder.file().exists());
    drop(writer);
    assert!(folder.names().is_empty());

    let mut writer = begin();
    writer.push(b"block").unwrap();
    let error = writer.finish(&content.header, &content.codes).unwrap_err();
    assert_eq!(error.to_string(), "1 blocks and 70 codes instead of 70");
    let mut writer = begin();
    for block in &content.blocks {
        writer.push(block).unwrap();
    }
    assert_eq!(
        writer.push(b"").unwrap_err().to_string(),
        "more than 70 blocks"
    );
    let error = writer
        .finish(&content.header, &content.codes[..69])
        .unwrap_err();
    assert_eq!(error.to_string(), "70 blocks and 69 codes instead of 70");
    let mut header = content.header.clone();
    header.raster.units = "ft".to_owned();
    let error = begin().finish(&header, &content.codes).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("metadata or count of blocks changed")
    );
    assert!(folder.names().is_empty());
}

#[test]
fn an_impossible_output_is_begun() {
    let folder = Folder::new();
    let header = Content::small(0).header;
    let message = |path: &Path| {
        Writer::create(path, &header, b"", b"")
            .err()
            .unwrap()
            .to_string()
    };
    let missing = folder.path().join("none");
    let prefix = format!("{}: cannot write into the folder: ", missing.display());
    assert!(message(&missing.join("terrain.kmb")).starts_with(&prefix));
    std::fs::write(folder.file(), b"").unwrap();
    let prefix = format!(
        "{}: cannot write into the folder: ",
        folder.file().display()
    );
    assert!(message(&folder.file().join("terrain.kmb")).starts_with(&prefix));
    let expected = format!(
        "{}: cannot write: it exists and is not a regular file",
        folder.path().display()
    );
    assert_eq!(message(folder.path()), expected);
    assert_eq!(
        message(Path::new("")),
        "the path of the repository is empty"
    );
    assert_eq!(
        message(Path::new("/")),
        "\"/\" cannot be written: it names no file"
    );
    assert_eq!(folder.names(), ["terrain.kmb"]);
}

#[cfg(unix)]
#[test]
fn a_repository_is_readable_by_its_owner_only() {
    use std::os::unix::fs::PermissionsExt;

    let folder = Folder::new();
    Content::small(3).write(&folder.file()).unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    let plain = folder.path().join("plain");
    std::fs::write(&plain, b"").unwrap();
    assert_eq!(mode(&folder.file()), mode(&plain));
}
