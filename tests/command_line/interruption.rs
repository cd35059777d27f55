//! What commands leave behind when they are stopped half-way.

#![cfg(unix)]

use crate::kmb;
use crate::kmb::{Folder, Run, command, sample};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Begins a build that takes a while.
fn start_build(output: &Path) -> Child {
    let mut build = command();
    build
        .arg("build")
        .arg(sample("srtm3_N49W124.tif"))
        .arg(sample("srtm3_N49W123.tif"));
    build
        .arg("-o")
        .arg(output)
        .args(["--max-error", "0", "--threads", "1"]);
    build
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits until the build has begun to write, or fails.
fn wait_for_writing(folder: &Folder) {
    let start = Instant::now();
    while folder.names().is_empty() {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "nothing is written"
        );
        sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_killed_build_leaves_no_file_under_the_output_name() {
    let folder = Folder::new();
    let output = folder.path("a.kmb");
    let mut build = start_build(&output);
    wait_for_writing(&folder);
    build.kill().unwrap();
    build.wait().unwrap();
    assert!(!output.exists());
    // What is left does not stand in the way of the next build.
    let input = sample("rocky_mountain_np_dem.tif");
    kmb!["build", &input, "-o", &output, "--max-error", "1"].succeeds();
    kmb!["verify", &output].succeeds();
}

#[test]
fn an_interrupted_build_cleans_up() {
    for signal in ["INT", "TERM"] {
        let folder = Folder::new();
        let build = start_build(&folder.path("a.kmb"));
        wait_for_writing(&folder);
        let kill = format!("kill -{signal} {}", build.id());
        assert!(
            Command::new("sh")
                .args(["-c", &kill])
                .status()
                .unwrap()
                .success()
        );
        let run: Run = build.wait_with_output().unwrap().into();
        assert_eq!(run.code, Some(130), "{}", run.stderr);
        run.complains("srtm3_N49W124.tif", &["cancelled"]);
        assert!(folder.names().is_empty());
    }
}

#[test]
fn a_full_disk_leaves_nothing() {
    let folder = Folder::new();
    let repository = folder.small_repository("small.kmb");
    let output = folder.path("out");
    // Files larger than some KiB cannot be written; the signal that says so is ignored, so that the write
    // itself fails, as it does on a full disk.
    let limited = |arguments: &[&Path]| -> Run {
        let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"";
        let mut shell = Command::new("sh");
        shell
            .args(["-c", script, env!("CARGO_BIN_EXE_kmb")])
            .args(arguments);
        shell.output().unwrap().into()
    };
    let input = sample("jacksboro_fault_srtm3.tif");
    let [build, extract, o] = ["build", "extract", "-o"].map(Path::new);
    let error = ["--max-error", "0"].map(Path::new);
    let run = limited(&[build, &input, o, &output, error[0], error[1]]);
    run.refuses("out", &["File too large"]);
    limited(&[extract, &repository, o, &output]).refuses("out", &["File too large"]);
    assert_eq!(folder.names(), ["small.kmb"]);
}

#[test]
fn a_file_system_without_room_leaves_nothing() {
    let folder = Folder::new();
    let repository = folder.small_repository("small.kmb");
    let mount = folder.path("mount");
    std::fs::create_dir(&mount).unwrap();
    let input = sample("jacksboro_fault_srtm3.tif");
    // A small file system of its own, where this user may mount one.
    let limited = |arguments: &[&Path]| -> Option<Run> {
        let script = "mount -t tmpfs -o size=12k none \"$0\" || exit 77; \"$@\"; code=$?; ls -A \"$0\"; exit $code";
        let mut shell = Command::new("unshare");
        shell
            .args(["--mount", "--map-root-user", "sh", "-c", script])
            .arg(&mount)
            .arg(env!("CARGO_BIN_EXE_kmb"))
            .args(arguments);
        let run: Run = shell.output().ok()?.into();
        let is_possible = run.code != Some(77) && !run.stderr.starts_with("unshare:");
        is_possible.then_some(run)
    };
    let [build, extract, o] = ["build", "extract", "-o"].map(Path::new);
    let error = ["--max-error", "0"].map(Path::new);
    let outputs = ["out.kmb", "out.tif"].map(|name| mount.join(name));
    let runs = [
        limited(&[build, &input, o, &outputs[0], error[0], error[1]]),
        limited(&[extract, &repository, o, &outputs[1]]),
    ];
    for (run, output) in runs.into_iter().zip(&outputs) {
        let Some(run) = run else {
            println!("passed over: no file system can be mounted");
            continue;
        };
        let name = output.file_name().and_then(|name| name.to_str()).unwrap();
        // What is printed are the names that are left.
        run.refuses(name, &["No space left"]);
    }
}

#[test]
fn a_result_that_cannot_be_printed_is_an_error() {
    let folder = Folder::new();
    let repository = folder.small_repository("a.kmb");
    let Ok(full) = std::fs::File::options().write(true).open("/dev/full") else {
        return;
    };
    let output = command()
        .arg("info")
        .arg(repository)
        .stdout(full)
        .output()
        .unwrap();
    Run::from(output).refuses("standard output", &["No space left"]);
}
