//! Builds that do not fit their memory go on after they were killed.

#![cfg(unix)]

use crate::kmb;
use crate::kmb::{Folder, command, sample};
use std::path::Path;
use std::process::{Child, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const INPUT: &str = "puget_sound_1025_decimetres.png";

/// Begins a build that does not fit its memory.
fn start_build(output: &Path, max_error: &str) -> Child {
    let mut build = command();
    build.arg("build").arg(sample(INPUT)).arg("-o").arg(output);
    build.args(["--max-error", max_error, "--memory", "64", "--json"]);
    let (out, errors) = (Stdio::piped(), Stdio::piped());
    build.stdout(out).stderr(errors).spawn().unwrap()
}

/// The same, to its end; the levels that it did not have to code.
fn build(output: &Path, max_error: &str) -> u64 {
    let run: kmb::Run = start_build(output, max_error)
        .wait_with_output()
        .unwrap()
        .into();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    run.json()["resumed_levels"].as_u64().unwrap()
}

/// Kills a build once its working store holds a file whose name begins so.
fn kill_once_there_is(folder: &Folder, output: &Path, name: &str) {
    let mut build = start_build(output, "10");
    let store = folder.path(".a.kmb.work");
    let has = || {
        let entries = std::fs::read_dir(&store).into_iter().flatten().flatten();
        let mut names = entries.map(|entry| entry.file_name());
        names.any(|own| own.to_string_lossy().starts_with(name))
    };
    let start = Instant::now();
    while !has() {
        assert!(start.elapsed() < Duration::from_secs(60), "no {name}");
        sleep(Duration::from_millis(1));
    }
    build.kill().unwrap();
    build.wait().unwrap();
}

/// How many instants: more with KIMBERLITE_SOAK.
fn instants() -> u32 {
    if std::env::var_os("KIMBERLITE_SOAK").is_some() {
        50
    } else {
        6
    }
}

#[test]
fn a_build_killed_at_any_instant_goes_on_to_the_same_bytes() {
    let folder = Folder::new();
    let (whole, output) = (folder.path("whole.kmb"), folder.path("a.kmb"));
    let input = sample(INPUT);
    kmb!["build", &input, "-o", &whole, "--max-error", "10"].succeeds();
    let start = Instant::now();
    assert_eq!(build(&output, "10"), 0);
    let duration = start.elapsed();
    let expected = std::fs::read(&whole).unwrap();
    assert!(std::fs::read(&output).unwrap() == expected);
    let mut resumed = 0;
    for instant in 0..instants() {
        std::fs::remove_file(&output).unwrap();
        let mut killed = start_build(&output, "10");
        sleep(duration.mul_f64((f64::from(instant) + 0.5) / f64::from(instants())));
        killed.kill().unwrap();
        if !killed.wait().unwrap().success() {
            // Renaming may have been its last act.
            let is_whole = || std::fs::read(&output).unwrap() == expected;
            assert!(!output.exists() || is_whole());
        }
        resumed += build(&output, "10");
        assert!(std::fs::read(&output).unwrap() == expected);
        let left = folder.names();
        let store = left.iter().filter(|name| name.contains(".work"));
        assert_eq!(store.count(), 0, "{left:?}");
    }
    println!("{resumed} levels taken over after {} kills", instants());
    assert!(resumed > 0, "nothing was ever taken over");
    kmb!["clean", &output].succeeds();
    let mut left = folder.names();
    left.sort();
    assert_eq!(left, ["a.kmb", "whole.kmb"]);
}

#[test]
fn an_unfinished_build_of_other_options_is_told_and_can_be_removed() {
    let folder = Folder::new();
    let output = folder.path("a.kmb");
    kill_once_there_is(&folder, &output, "trained-blocks");
    let refused = start_build(&output, "20").wait_with_output().unwrap();
    let refused: kmb::Run = refused.into();
    assert_ne!(refused.code, Some(0));
    let told = ["maximum error 10, not maximum error 20", "kmb clean"];
    for text in told {
        assert!(refused.stderr.contains(text), "{}", refused.stderr);
    }
    assert!(!output.exists());
    let cleaned = kmb!["clean", &output, "--json"].succeeds();
    assert!(cleaned.json()["removed"].as_u64().unwrap() >= 1);
    assert!(folder.names().is_empty(), "{:?}", folder.names());
    assert_eq!(build(&output, "20"), 0);
}

#[test]
fn a_build_killed_while_it_removes_its_store_leaves_nothing_in_the_way() {
    let folder = Folder::new();
    let (output, store) = (folder.path("a.kmb"), folder.path(".a.kmb.work"));
    let files = || std::fs::read_dir(&store).map_or(0, |entries| entries.count());
    let mut left = 0;
    for _ in 0..20 {
        let mut killed = start_build(&output, "10");
        let mut most = 0;
        while killed.try_wait().unwrap().is_none() && (files() >= most || !output.exists()) {
            most = most.max(files());
        }
        killed.kill().unwrap();
        killed.wait().unwrap();
        left += usize::from(files() > 0);
        build(&output, "10");
        assert!(!store.exists());
        std::fs::remove_file(&output).unwrap();
    }
    assert!(left > 0, "none was killed in time");
}

#[test]
fn a_store_whose_maker_was_killed_half_way_does_not_stand_in_the_way() {
    let folder = Folder::new();
    let output = folder.path("a.kmb");
    let store = folder.path(".a.kmb.work");
    for length in [0, 5, 4096, 100_000] {
        std::fs::create_dir(&store).unwrap();
        std::fs::write(store.join("store.redb"), vec![0; length]).unwrap();
        assert_eq!(build(&output, "40"), 0);
        assert!(!store.exists());
    }
    // The files of another output stay.
    let other = folder.write(".a.kmb.kmb.abc123.part", b"");
    folder.write(".a.kmb.abc123.part", b"");
    let cleaned = kmb!["clean", &output, "--json"].succeeds();
    assert_eq!(cleaned.json()["removed"], 1);
    assert!(other.exists());
}

#[test]
fn a_working_store_is_one_builds_alone_and_trusted_by_its_checksums() {
    let folder = Folder::new();
    let output = folder.path("a.kmb");
    kill_once_there_is(&folder, &output, "trained-vertices-7");
    // Of a level that is done.
    let path = folder.path(".a.kmb.work").join("trained-refined-3");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(&path, &bytes).unwrap();
    let run: kmb::Run = start_build(&output, "10")
        .wait_with_output()
        .unwrap()
        .into();
    assert_ne!(run.code, Some(0));
    assert!(run.stderr.contains("trained-refined-3"), "{}", run.stderr);
    assert!(!output.exists());
    kmb!["clean", &output].succeeds();
    let mut first = start_build(&output, "10");
    let store = folder.path(".a.kmb.work").join("store.redb");
    while !store.exists() {
        sleep(Duration::from_millis(1));
    }
    sleep(Duration::from_millis(50));
    let second: kmb::Run = start_build(&output, "10")
        .wait_with_output()
        .unwrap()
        .into();
    assert_ne!(second.code, Some(0));
    let told = "another build is using it";
    assert!(second.stderr.contains(told), "{}", second.stderr);
    assert!(kmb!["clean", &output].code != Some(0));
    assert!(first.wait().unwrap().success());
}
