//! Readers of a repository that is replaced under them.

use crate::kmb;
use crate::kmb::{Folder, command, sample};
use kimberlite::store::{Access, Store};
use std::fs;
use std::process::Stdio;
use std::sync::atomic::{AtomicBool, Ordering};

/// Errors of the two builds that take turns.
const ERRORS: [&str; 2] = ["2", "9"];
const REPLACED: usize = 6;

#[test]
fn two_processes_read_while_a_third_builds_the_successor_and_renames_it() {
    let folder = Folder::new();
    let file = folder.path("a.kmb");
    let input = sample("jacksboro_fault_srtm3.tif");
    let build = |error| kmb!["build", &input, "-o", &file, "--max-error", error].succeeds();
    let versions = ERRORS.map(|error| {
        build(error);
        let output = folder.path("version.tif");
        kmb!["extract", &file, "-o", &output].succeeds();
        (fs::read(&file).unwrap(), fs::read(&output).unwrap())
    });
    let long_reader = || {
        let mut fly = command();
        fly.arg("fly")
            .arg(&file)
            .args(["--frames", "150", "--size", "640x480"]);
        fly.stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    let (folder, file, versions) = (&folder, &file, &versions);
    let done = &AtomicBool::new(false);
    std::thread::scope(|scope| {
        // Each opens the file again and again, and gets one version or the other.
        for reader in 0..2 {
            scope.spawn(move || {
                while !done.load(Ordering::Relaxed) {
                    let output = folder.path(&format!("{reader}.tif"));
                    kmb!["extract", file, "-o", &output].succeeds();
                    let extracted = fs::read(&output).unwrap();
                    assert!(versions.iter().any(|(_, version)| *version == extracted));
                }
            });
        }
        // Others go on with what they opened.
        let stores = [Access::Map, Access::Positioned].map(|access| Store::open(file, access));
        let [first, second] = [long_reader(), long_reader()];
        for turn in 0..REPLACED {
            let outcome = std::panic::catch_unwind(|| build(ERRORS[turn % 2]));
            if outcome.is_err() {
                done.store(true, Ordering::Relaxed);
            }
            outcome.unwrap();
        }
        done.store(true, Ordering::Relaxed);
        for store in stores {
            let store = store.unwrap();
            assert_eq!(store.file_bytes(), versions[1].0.len() as u64);
            assert!(store.verify().is_sound());
        }
        for reader in [first, second] {
            let output = reader.wait_with_output().unwrap();
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success(), "{text}");
        }
    });
    assert_eq!(fs::read(file).unwrap(), versions[(REPLACED - 1) % 2].0);
}
