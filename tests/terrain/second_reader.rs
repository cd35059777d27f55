//! What `docs/format.md` is worth: a reader in Python that was written after it decodes what the library does.

use crate::methods::METHODS;
use crate::rasters::{Raster, decode};
use kimberlite::geo::SampleType;
use kimberlite::store::Access;
use std::path::Path;
use std::process::Command;

/// What the reader in Python decodes of a repository of heights, row by row; `None` where there is no Python.
pub fn read(repository: &Path) -> Option<Vec<f64>> {
    let reader = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reader/reader.py");
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.f64");
    // -B: the source folder stays clean.
    let mut python = Command::new("python3");
    python.arg("-B").arg(&reader).args([repository, &output]);
    let Ok(done) = python.output() else {
        println!("passed over: there is no python3");
        return None;
    };
    let complaint = String::from_utf8_lossy(&done.stderr);
    assert!(
        done.status.success(),
        "{}: {complaint}",
        repository.display()
    );
    let bytes = std::fs::read(&output).unwrap();
    let numbers = bytes
        .chunks_exact(8)
        .map(|number| number.try_into().unwrap());
    Some(numbers.map(f64::from_le_bytes).collect())
}

/// Hills with a cliff and some noise.
fn height(column: u32, row: u32) -> f64 {
    let noise = ((column * 7919) ^ (row * 104_729)).wrapping_mul(2_654_435_761) >> 28;
    let hill = 700.0 * (f64::from(column) * 0.06).sin() * (f64::from(row) * 0.045).cos();
    let cliff = if 3 * column > row + 90 { 400.0 } else { 0.0 };
    (hill + cliff + f64::from(noise)).round()
}

fn raster(
    width: u32,
    height_: u32,
    sample_type: SampleType,
    sample: impl Fn(u32, u32) -> f64,
) -> Raster {
    let samples = (0..width * height_).map(|index| sample(index % width, index / width));
    Raster::new(width, height_, sample_type, samples.collect())
}

#[test]
fn a_reader_written_after_the_format_page_decodes_the_same_samples() {
    let blob =
        |c: u32, r: u32| (c / 9 + r / 7).is_multiple_of(5) || (c * 13 + r * 7).is_multiple_of(31);
    let with_voids = |c, r| if blob(c, r) { f64::NAN } else { height(c, r) };
    let cases = [
        (raster(61, 50, SampleType::I16, with_voids), 0.0, 4),
        (raster(70, 40, SampleType::I16, height), 3.0, 4),
        (raster(129, 66, SampleType::I16, height), 0.0, 6),
        (
            raster(40, 131, SampleType::I32, |c, r| 1e6 * height(c, r)),
            0.0,
            4,
        ),
        (
            raster(66, 40, SampleType::I16, |c, r| {
                7.0 * (height(c, r) / 20.0).floor()
            }),
            0.0,
            4,
        ),
        (
            raster(60, 50, SampleType::F32, |c, r| 0.25 * with_voids(c, r)),
            0.1,
            4,
        ),
        (
            raster(3, 17, SampleType::U16, |c, r| height(c, r) + 9000.0),
            0.0,
            7,
        ),
    ];
    let folder = tempfile::tempdir().unwrap();
    let repository = folder.path().join("a.kmb");
    for (place, (raster, error, cells_log2)) in cases.into_iter().enumerate() {
        // All of them for voids lossless and for hills with an error, else the default.
        let methods = if place < 2 {
            &METHODS[..]
        } else {
            &METHODS[..1]
        };
        for &method in methods {
            let options = method.options(error, cells_log2);
            raster.build_with(&repository, &options).unwrap();
            let Some(found) = read(&repository) else {
                return;
            };
            let expected = decode(&repository, Access::Map).unwrap();
            assert_eq!(found.len(), expected.len());
            let is_same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
            let first = found.iter().zip(&expected).position(|pair| !is_same(pair));
            assert_eq!(first, None, "{raster:?} {method:?}");
        }
    }
}
