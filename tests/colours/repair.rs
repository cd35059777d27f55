//! Images with missing detail.

use crate::image::{Image, decode};
use kimberlite::build::BuildOptions;
use kimberlite::cut::{Layer, Window, read_window};
use kimberlite::geo::SampleType;
use kimberlite::store::{Access, TransformKind};
use kimberlite::tool;

#[test]
fn the_sound_part_of_an_image_changes_in_a_repair() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    let pixel = |column: u32, row: u32| {
        let is_void = column / 9 == 4 && row / 9 == 5;
        let noise = (column * 31) ^ (row * 17);
        (!is_void).then(|| [column + row, 2 * column, noise].map(|number| (number % 256) as u16))
    };
    let image = Image::new(90, 70, SampleType::U8, pixel);
    for transform in [
        TransformKind::Interpolating,
        TransformKind::Lifted,
        TransformKind::TwoStage,
    ] {
        let options = BuildOptions {
            transform,
            cells_log2: 4,
            threads: 2,
            ..BuildOptions::default()
        };
        image.build(&path, &options).unwrap();
        let whole = decode(&path, None).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        let place = bytes.len() - 40;
        bytes[place] ^= 8;
        std::fs::write(&path, bytes).unwrap();
        let report = tool::repair(&path, &path, &mut |_, _| true).unwrap();
        let layer = Layer::open(&path, Access::Map).unwrap();
        let window = Window {
            column: 0,
            row: 0,
            width: 90,
            height: 70,
        };
        let mut found = vec![0.0; whole.len()];
        let coarse = read_window(&layer, layer.lattice().levels(), window, &mut found).unwrap();
        assert!(coarse.count() > 0 && coarse.count() == report.coarse_samples);
        let pixels = found.chunks_exact(3).zip(whole.chunks_exact(3));
        for (index, (found, whole)) in pixels.enumerate() {
            let is_same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
            let is_same = found.iter().zip(whole).all(is_same);
            assert!(is_same || coarse.contains(index), "pixel {index}");
            let is_colour = |number: &f64| number.is_nan() || (0.0..=255.0).contains(number);
            assert!(found.iter().all(is_colour));
        }
    }
}
