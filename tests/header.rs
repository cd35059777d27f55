//! The committed header is what the C boundary says; `KMB_WRITE_HEADER=1` writes it.

use std::fs;
use std::path::Path;

const CAVEATS: &str = include_str!("header.h.in");

/// Sections of the header in its order: title, file of `src/ffi/`, and the types that no function
/// names.
const SECTIONS: [(&str, &str, &[&str]); 15] = [
    ("Version, errors, messages", "status", &["kmb_log_level"]),
    (
        "Repositories: opening, what is known of them, coordinates",
        "repository",
        &[
            "kmb_kind",
            "kmb_access",
            "kmb_sample_type",
            "kmb_registration",
        ],
    ),
    (
        "Queries: heights and windows of samples, without any view",
        "query",
        &[],
    ),
    ("Rays and lines of sight", "ray", &[]),
    (
        "Profiles along lines, statistics of polygons",
        "profile",
        &[],
    ),
    ("Patches: what is drawn", "patch", &[]),
    (
        "Cuts: from views to patches",
        "cut",
        &["kmb_vertex_form", "kmb_metric", "kmb_colour_form"],
    ),
    (
        "Builders: from rows to repositories",
        "builder",
        &["kmb_transform", "kmb_entropy"],
    ),
    (
        "Updates: other samples in a part of a repository",
        "update",
        &[],
    ),
    (
        "Repairs: what is left of a damaged repository",
        "repair",
        &[],
    ),
    (
        "Rasters: samples to the bytes of a repository in memory, and back",
        "raster",
        &[],
    ),
    ("Codecs: the heights of one diamond as bytes", "codec", &[]),
    (
        "Cities: opening, what is known of them, single blocks",
        "city",
        &[],
    ),
    (
        "Visits of a city: from views to blocks, and rays against them",
        "city_visit",
        &[],
    ),
    (
        "City builders: from triangles and files to cities",
        "city_builder",
        &["kmb_paint_kind"],
    ),
];

fn section(root: &Path, file: &str, types: &[&str]) -> String {
    let mut config = cbindgen::Config::from_root_or_default(root);
    config.export.include = types.iter().map(|name| (*name).to_owned()).collect();
    let source = root.join(format!("src/ffi/{file}.rs"));
    let builder = cbindgen::Builder::new().with_config(config);
    let bindings = builder
        .with_src(source)
        .generate()
        .expect("the sources parse");
    let mut bytes = Vec::new();
    bindings.write(&mut bytes);
    String::from_utf8(bytes).expect("the header is text")
}

fn header(root: &Path) -> String {
    let sections = SECTIONS.map(|(title, file, types)| {
        let rule = "=".repeat(96);
        let text = section(root, file, types);
        format!("/* {rule}\n * {title}\n * {rule} */\n\n{}\n", text.trim())
    });
    CAVEATS.replace("@SECTIONS@\n", &sections.join("\n"))
}

#[test]
fn the_header_is_that_of_the_sources() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("include/kimberlite.h");
    let generated = header(root);
    if std::env::var_os("KMB_WRITE_HEADER").is_some() {
        fs::write(&path, &generated).expect("the header can be written");
    }
    let committed = fs::read_to_string(&path).expect("the header can be read");
    let differs = committed
        .lines()
        .zip(generated.lines())
        .position(|(a, b)| a != b);
    assert!(
        committed == generated,
        "include/kimberlite.h differs from src/ffi/ at line {:?}; KMB_WRITE_HEADER=1 writes it",
        differs.map(|line| line + 1)
    );
}

/// Those that only appear as numbers must be asked for by name.
#[test]
fn every_type_of_the_interface_is_in_the_header() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let header = fs::read_to_string(root.join("include/kimberlite.h")).expect("the header");
    let mut count = 0;
    for entry in fs::read_dir(root.join("src/ffi")).expect("the sources") {
        let source = fs::read_to_string(entry.expect("a source").path()).expect("a source");
        let words = source.lines().filter_map(|line| {
            let rest = line
                .strip_prefix("pub struct ")
                .or_else(|| line.strip_prefix("pub enum "))?;
            rest.split([' ', '(', ';']).next()
        });
        for name in words.filter(|name| name.starts_with("kmb_")) {
            let is_there = header.contains(&format!("}} {name};"))
                || header.contains(&format!("struct {name} {name};"));
            assert!(is_there, "{name} is missing");
            count += 1;
        }
    }
    assert!(count > 20, "{count} types");
}
