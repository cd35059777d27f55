//! Damaged files through every command that reads them: found by `verify`, and none crashes, hangs or asks for much memory.
//! With KIMBERLITE_SOAK=1 (`make soak`) on a larger terrain and twenty times as often.

#![cfg(target_os = "linux")]

use crate::kmb;
use crate::kmb::{Folder, Run, command, sample};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// KiB of address space of a command. The small file needs a third.
const MEMORY: u32 = 128 << 10;
/// Seconds until a command is taken to hang.
const PATIENCE: u32 = 60;

fn is_soak() -> bool {
    env::var_os("KIMBERLITE_SOAK").is_some()
}

/// Files of one kind that are tried.
fn trials() -> u64 {
    if is_soak() { 1000 } else { 50 }
}

/// A repository of a real terrain, and what is read from its damaged copies.
struct Victim {
    folder: Folder,
    good: Vec<u8>,
    /// The extracted terrain of the sound file.
    extracted: Vec<u8>,
}

impl Victim {
    fn new() -> Victim {
        let folder = Folder::new();
        let file = folder.path("good.kmb");
        let (input, error) = match is_soak() {
            true => (sample("srtm3_S33W071.tif"), "8"),
            false => (sample("jacksboro_fault_srtm3.tif"), "2"),
        };
        kmb!["build", &input, "-o", &file, "--max-error", error].succeeds();
        let good = fs::read(&file).unwrap();
        let mut victim = Victim {
            folder,
            good,
            extracted: Vec::new(),
        };
        // A sound file needs no more than the limits.
        let output = victim.output();
        for run in victim.read(&file, &output) {
            assert_eq!(run.code, Some(0), "{}", run.stderr);
        }
        victim.extracted = fs::read(&output).unwrap();
        fs::remove_file(output).unwrap();
        victim
    }

    fn output(&self) -> PathBuf {
        self.folder.path("out.tif")
    }

    /// What info, verify, extract and fly come to within the limits.
    fn read(&self, file: &Path, output: &Path) -> [Run; 4] {
        let run = |name: &str, more: &[&str]| -> Run {
            let script = format!("ulimit -v {MEMORY}; exec timeout {PATIENCE} \"$0\" \"$@\"");
            let mut shell = Command::new("sh");
            shell
                .args(["-c", &script])
                .arg(command().get_program())
                .args([name.as_ref(), file.as_os_str()])
                .args(more)
                // Else each thread reserves address space for an arena of its own.
                .env("MALLOC_ARENA_MAX", "1");
            shell.output().unwrap().into()
        };
        let output = output.to_str().unwrap();
        [
            run("info", &[]),
            run("verify", &[]),
            run("extract", &["-o", output]),
            run("fly", &["--frames", "2", "--size", "320x200"]),
        ]
    }

    /// Fails unless `verify` finds that these bytes are damaged, and all commands end with a result or with one line.
    fn is_found(&self, bytes: &[u8], what: &str) {
        let (file, output) = (self.folder.write("damaged.kmb", bytes), self.output());
        let runs = self.read(&file, &output);
        for (place, run) in runs.iter().enumerate() {
            let is_verify = place == 1;
            let codes = if is_verify { [1, 2] } else { [0, 2] };
            let code = run.code.filter(|code| codes.contains(code));
            assert!(
                code.is_some(),
                "{what}, command {place}: {:?} {}",
                run.code,
                run.stderr
            );
            if code != Some(0) {
                run.complains("damaged.kmb", &[]);
            }
        }
        // Ground that is told is the right ground.
        assert_eq!(output.exists(), runs[2].code == Some(0), "{what}");
        if output.exists() {
            assert!(fs::read(&output).unwrap() == self.extracted, "{what}");
            fs::remove_file(output).unwrap();
        }
    }

    /// The number of 8 bytes at a place of the good file's header (docs/format.md).
    fn field(&self, place: usize) -> usize {
        u64::from_le_bytes(self.good[place..place + 8].try_into().unwrap()) as usize
    }
}

/// The same numbers in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        ((u128::from(self.0) * end as u128) >> 64) as usize
    }
}

/// Makes the checksum right that follows these bytes.
fn seal(bytes: &mut [u8], start: usize, end: usize) {
    let checksum = crc32fast::hash(&bytes[start..end]);
    bytes[end..end + 4].copy_from_slice(&checksum.to_le_bytes());
}

#[test]
fn any_single_flipped_bit() {
    let victim = Victim::new();
    let mut random = Random(1);
    for _ in 0..trials() {
        let bit = random.below(8 * victim.good.len());
        let mut bytes = victim.good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        victim.is_found(&bytes, &format!("bit {bit}"));
    }
}

#[test]
fn truncation_at_every_4_kib_and_anywhere_else() {
    let victim = Victim::new();
    let mut random = Random(2);
    let pages = (0..victim.good.len()).step_by(4096);
    let anywhere = (0..trials()).map(|_| random.below(victim.good.len()));
    for length in pages.chain(anywhere) {
        victim.is_found(&victim.good[..length], &format!("{length} bytes"));
    }
}

#[test]
fn a_header_that_asks_for_2_to_the_60_bytes() {
    let victim = Victim::new();
    // Counts of samples and blocks do not say how long something is.
    let fields = std::iter::once(192).chain((200..288).step_by(8));
    for field in fields {
        let mut bytes = victim.good.clone();
        bytes[field..field + 8].copy_from_slice(&(1u64 << 60).to_le_bytes());
        seal(&mut bytes, 0, 300);
        victim.is_found(&bytes, &format!("header field {field}"));
    }
    for field in [12, 28, 32] {
        let mut bytes = victim.good.clone();
        bytes[field..field + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        seal(&mut bytes, 0, 300);
        victim.is_found(&bytes, &format!("header field {field}"));
    }
}

#[test]
fn an_index_that_points_outside_the_file() {
    let victim = Victim::new();
    let (index, blocks) = (victim.field(256), victim.field(272));
    let records = victim.field(192).min(64);
    let end = index + 8 + 5 * records + 4 * records.div_ceil(8);
    assert!(end + 4 <= blocks);
    for base in [victim.good.len() as u64, 1 << 60, u64::MAX] {
        let mut bytes = victim.good.clone();
        bytes[index..index + 8].copy_from_slice(&base.to_le_bytes());
        seal(&mut bytes, index, end);
        victim.is_found(&bytes, &format!("base {base}"));
    }
    for record in 0..records {
        let mut bytes = victim.good.clone();
        // The longest that is not a missing block's.
        let length = (u16::MAX - 1).to_le_bytes();
        bytes[index + 8 + 2 * record..][..2].copy_from_slice(&length);
        seal(&mut bytes, index, end);
        victim.is_found(&bytes, &format!("length of block {record}"));
    }
}
