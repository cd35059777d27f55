//! The rules of the house (`docs/design.md`) that a compiler does not check.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Rooms by floor, from the ground up.
const FLOORS: [&[&str]; 5] = [
    &["lattice", "geo"],
    &["transform", "entropy"],
    &["codec", "schedule", "store"],
    &["tool", "build", "cut", "blockmap"],
    &["ffi"],
];
/// Whom `tool` may use on its own floor.
const SHOWN_TO_TOOL: [&str; 3] = ["build", "cut", "blockmap"];

/// A file of `src`, without comments.
struct Source {
    /// Relative to `src`.
    path: PathBuf,
    code: String,
}

impl Source {
    /// The room that the file lies in; `None` for `lib.rs` and its like.
    fn room(&self) -> Option<&str> {
        let first = self.path.components().next()?.as_os_str().to_str()?;
        let name = first.strip_suffix(".rs").unwrap_or(first);
        floor(name).map(|_| name)
    }
}

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

fn sources() -> Vec<Source> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut folders = vec![root.clone()];
    let mut sources = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let lines = text
                    .lines()
                    .map(|line| line.split("//").next().unwrap_or(""));
                let path = path.strip_prefix(&root).unwrap().to_path_buf();
                sources.push(Source {
                    path,
                    code: lines.collect::<Vec<_>>().join("\n"),
                });
            }
        }
    }
    assert!(sources.len() > 20, "the sources were not found");
    sources
}

/// The names that directly follow `prefix::`, alone or in braces.
fn names_after(code: &str, prefix: &str) -> Vec<String> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut names = Vec::new();
    for (at, _) in code.match_indices(&format!("{prefix}::")) {
        if code[..at].ends_with(|c: char| is_name(c) || c == '$') {
            continue;
        }
        let rest = &code[at + prefix.len() + 2..];
        let Some(list) = rest.strip_prefix('{') else {
            names.push(rest.chars().take_while(|&c| is_name(c)).collect());
            continue;
        };
        let (mut depth, mut start) = (1, 0);
        for (index, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if (depth == 1 && c == ',') || depth == 0 {
                let item = list[start..index].trim_start();
                names.push(item.chars().take_while(|&c| is_name(c)).collect());
                start = index + 1;
            }
            if depth == 0 {
                break;
            }
        }
    }
    names
}

fn may_use(room: &str, other: &str) -> bool {
    let (Some(own), Some(others)) = (floor(room), floor(other)) else {
        return true;
    };
    room == other || others < own || (room == "tool" && SHOWN_TO_TOOL.contains(&other))
}

#[test]
fn no_room_uses_one_above_or_beside_it() {
    let mut breaches = Vec::new();
    let mut uses: HashMap<String, usize> = HashMap::new();
    for source in sources() {
        let Some(room) = source.room() else { continue };
        for name in names_after(&source.code, "crate") {
            *uses.entry(room.to_owned()).or_default() += usize::from(floor(&name).is_some());
            if !may_use(room, &name) {
                breaches.push(format!("{} uses {name}", source.path.display()));
            }
        }
    }
    assert!(
        uses["tool"] > 0 && uses["codec"] > 0,
        "no uses were found: {uses:?}"
    );
    assert!(breaches.is_empty(), "{breaches:#?}");
}

#[test]
fn the_command_line_never_goes_through_the_c_boundary() {
    for source in sources()
        .iter()
        .filter(|source| source.path.starts_with("bin"))
    {
        let names = names_after(&source.code, "kimberlite");
        assert!(
            !names.contains(&"ffi".to_owned()),
            "{}",
            source.path.display()
        );
    }
}

#[test]
fn unsafe_code_stays_at_the_c_boundary_in_the_memory_map_and_in_vectors() {
    for source in sources() {
        let name = source.path.file_name().and_then(|name| name.to_str());
        let is_kernel = name.is_some_and(|name| name.ends_with("_avx2.rs"));
        let files = [Path::new("store/map.rs"), Path::new("vectors.rs")];
        if source.path.starts_with("ffi") || files.contains(&&*source.path) || is_kernel {
            continue;
        }
        let mut words = source
            .code
            .split(|c: char| !c.is_alphanumeric() && c != '_');
        assert!(
            words.all(|word| word != "unsafe"),
            "unsafe in {}",
            source.path.display()
        );
    }
}

#[test]
fn upward_and_sideways_uses_would_be_found() {
    let code = "use crate::{Error, codec::{Matrix, Units}, build};\nlet x = crate::cut::Cut;";
    assert_eq!(
        names_after(code, "crate"),
        ["Error", "codec", "build", "cut"]
    );
    assert!(names_after("use other_crate::build;", "crate").is_empty());
    assert!(may_use("tool", "build") && may_use("cut", "codec") && may_use("cut", "cut"));
    assert!(!may_use("cut", "build") && !may_use("store", "codec") && !may_use("geo", "store"));
    assert!(!may_use("build", "tool") && !may_use("tool", "ffi"));
}
