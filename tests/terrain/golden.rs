//! Files of every released version stay readable for ever: tests/golden/ has a folder for each read version.

use crate::methods::METHODS;
use crate::rasters::Raster;
use crate::second_reader;
use kimberlite::build;
use kimberlite::build::source::{self, RowSource, SourceOptions};
use kimberlite::cut::{Layer, Window, read_window};
use kimberlite::geo::SampleType;
use kimberlite::store::{Access, READ_VERSION};
use kimberlite::tool;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// Of a folder: for each file its name, width, height, voids and the checksum of its samples.
const LIST: &str = "samples.txt";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_path_buf()
}

/// All numbers of the finest level, row by row.
fn decode(layer: &Layer) -> Vec<f64> {
    let info = layer.raster_info();
    let window = Window {
        column: 0,
        row: 0,
        width: info.width,
        height: info.height,
    };
    let mut numbers = vec![0.0; info.row_length() * info.height as usize];
    read_window(layer, layer.lattice().levels(), window, &mut numbers).unwrap();
    numbers
}

/// The CRC-32 of numbers as little-endian doubles, every void the same.
fn checksum(numbers: &[f64]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    for &number in numbers {
        let bits = if number.is_nan() {
            u64::MAX
        } else {
            number.to_bits()
        };
        hasher.update(&bits.to_le_bytes());
    }
    hasher.finalize()
}

/// The line of the list that a file must have.
fn describe(file: &Path) -> (String, Layer) {
    let layer = Layer::open(file, Access::Map).unwrap();
    assert!(tool::verify(&layer, None, &mut |_, _| true).unwrap().ok);
    let name = file.file_name().and_then(|name| name.to_str()).unwrap();
    let header = layer.header();
    let line = format!(
        "{name} {} {} {} {:08x}",
        header.raster.width,
        header.raster.height,
        header.void_samples,
        checksum(&decode(&layer))
    );
    (line, layer)
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_released_file_decodes_to_other_samples_or_not_at_all() {
    let mut versions = 0;
    for folder in files(&root().join("tests/golden")) {
        versions += 1;
        let list = fs::read_to_string(folder.join(LIST)).unwrap();
        let kmb = |file: &PathBuf| file.extension().is_some_and(|extension| extension == "kmb");
        let files: Vec<PathBuf> = files(&folder).into_iter().filter(kmb).collect();
        assert_eq!(list.lines().count(), files.len(), "{}", folder.display());
        for (file, expected) in files.iter().zip(list.lines()) {
            let (line, layer) = describe(file);
            assert_eq!(line, expected);
            let is_heights = layer.raster_info().bands == 1;
            let second = if is_heights {
                second_reader::read(file)
            } else {
                None
            };
            if let Some(samples) = second {
                let found = format!("{:08x}", checksum(&samples));
                assert_eq!(expected.split(' ').next_back(), Some(&*found), "{line}");
            }
        }
    }
    assert!(versions >= usize::from(READ_VERSION));
}

/// A shipped raster, one void in a place of it.
fn heights_with_voids() -> Raster {
    let file = root().join("data/rocky_mountain_np_dem.tif");
    let mut input = source::open(&file, &SourceOptions::default()).unwrap();
    let info = input.info().clone();
    let mut samples = vec![0.0; info.row_length() * info.height as usize];
    input.read_rows(&mut samples).unwrap();
    for (index, sample) in samples.iter_mut().enumerate() {
        let (column, row) = (index % info.width as usize, index / info.width as usize);
        if column.abs_diff(90) + row.abs_diff(60) < 17 || column == 3 && row > 100 {
            *sample = f64::NAN;
        }
    }
    Raster { info, samples }
}

/// A part of a shipped image, by lifted.
fn write_colours(path: &Path) {
    let file = root().join("data/rocky_mountain_np_landsat_rgb.png");
    let options = SourceOptions {
        colour: true,
        ..SourceOptions::default()
    };
    let mut image = source::open(&file, &options).unwrap();
    let mut row = vec![0.0; image.info().row_length()];
    let mut part = image.info().clone();
    (part.width, part.height) = (90, 70);
    let fill = move |_: u32, rows: &mut [f64]| {
        for part in rows.chunks_exact_mut(3 * 90) {
            image.read_rows(&mut row)?;
            part.copy_from_slice(&row[..3 * 90]);
        }
        Ok(())
    };
    let mut source = RowSource::new(part, Box::new(fill));
    let options = METHODS[3].options(9.0, 4);
    build::build(&mut source, &options, path, &mut |_, _| true).unwrap();
}

/// Writes the golden files of the version that the library writes: `cargo test --test terrain golden -- --ignored`.
/// Only before a version is released; afterwards its files never change.
#[test]
#[ignore = "changes tests/golden"]
fn write_golden_files() {
    let folder = root().join(format!("tests/golden/version_{READ_VERSION}"));
    fs::create_dir_all(&folder).unwrap();
    let heights = heights_with_voids();
    let trained = folder.join("heights_rans.kmb");
    heights
        .build_with(&trained, &METHODS[0].options(20.0, 6))
        .unwrap();
    let model = Layer::open(&trained, Access::Map).unwrap();
    assert!(
        model.model().unwrap().adaptive,
        "its weights are not trained"
    );
    let height = |index: i64| (index % 33 * 40 - (index / 33 * (index % 33)) % 61) as f64;
    let small = Raster::new(33, 29, SampleType::I16, (0..33 * 29).map(height).collect());
    small
        .build_with(
            &folder.join("heights_gamma.kmb"),
            &METHODS[8].options(3.0, 4),
        )
        .unwrap();
    write_colours(&folder.join("colours.kmb"));
    let mut list = String::new();
    for file in files(&folder) {
        if file.extension().is_some_and(|extension| extension == "kmb") {
            writeln!(list, "{}", describe(&file).0).unwrap();
        }
    }
    fs::write(folder.join(LIST), list).unwrap();
}
