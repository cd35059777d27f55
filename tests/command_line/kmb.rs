//! Running `kmb`.

use crate::kmb;
use serde_json::{Map, Value};
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// A folder that goes when the test ends.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Folder {
        Folder(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    pub fn write_f32(&self, name: &str, samples: &[f32]) -> PathBuf {
        let bytes: Vec<u8> = samples
            .iter()
            .flat_map(|sample| sample.to_le_bytes())
            .collect();
        self.write(name, &bytes)
    }

    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    /// A small repository of a shipped raster.
    pub fn small_repository(&self, name: &str) -> PathBuf {
        let output = self.path(name);
        let input = sample("jacksboro_fault_srtm3.tif");
        kmb!["build", &input, "-o", &output, "--max-error", "2"].succeeds();
        output
    }
}

/// A shipped raster.
pub fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name)
}

/// What a run of `kmb` came to.
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl From<Output> for Run {
    fn from(output: Output) -> Run {
        Run {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }
}

pub fn command() -> Command {
    Command::new(env!("CARGO_BIN_EXE_kmb"))
}

pub fn kmb(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Run {
    command().args(arguments).output().unwrap().into()
}

/// Runs `kmb` with arguments that are references to strings or paths.
#[macro_export]
macro_rules! kmb {
    ($($argument:expr),+ $(,)?) => {
        $crate::kmb::kmb([$(::std::ffi::OsString::from($argument)),+])
    };
}

impl Run {
    pub fn succeeds(self) -> Run {
        assert_eq!((self.code, self.stderr.as_str()), (Some(0), ""));
        self
    }

    /// Ends with this code and one line that names `subject` and holds all of `parts`; prints no result.
    pub fn refuses(self, subject: &str, parts: &[&str]) {
        assert_eq!(self.code, Some(2), "{}", self.stderr);
        assert_eq!(self.stdout, "");
        self.complains(subject, parts);
    }

    /// Says one line that names `subject` and holds all of `parts`.
    pub fn complains(&self, subject: &str, parts: &[&str]) {
        let line = &self.stderr;
        assert!(
            line.starts_with("kmb: ") && line.ends_with('\n'),
            "{line:?}"
        );
        assert_eq!(line.lines().count(), 1, "{line:?}");
        for part in parts.iter().chain([&subject]) {
            assert!(line.contains(part), "{part:?} is missing in {line:?}");
        }
    }

    /// The one JSON object that was printed, whatever the code.
    pub fn json(&self) -> Map<String, Value> {
        assert_eq!(
            self.stdout.lines().count(),
            1,
            "{}{}",
            self.stdout,
            self.stderr
        );
        serde_json::from_str(&self.stdout).unwrap()
    }
}

/// Fails unless `keys` are all there and numbers.
pub fn assert_numbers(object: &Map<String, Value>, keys: &[&str]) {
    for &key in keys {
        assert!(
            object.get(key).is_some_and(Value::is_number),
            "{key} in {object:?}"
        );
    }
}
