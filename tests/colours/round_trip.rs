//! Images through every transform and coder.

use crate::image::{Image, decode};
use kimberlite::build::BuildOptions;
use kimberlite::geo::SampleType;
use kimberlite::store::{EntropyKind, TransformKind};
use proptest::prelude::*;

const TRANSFORMS: [TransformKind; 3] = [
    TransformKind::Interpolating,
    TransformKind::Lifted,
    TransformKind::TwoStage,
];

fn options(transform: TransformKind, entropy: EntropyKind, max_error: f64) -> BuildOptions {
    BuildOptions {
        transform,
        entropy,
        max_error,
        cells_log2: 4,
        threads: 2,
        ..BuildOptions::default()
    }
}

/// Images of awkward sizes, from noise to ramps, some with voids.
fn images() -> impl Strategy<Value = Image> {
    let shapes = (2u32..70, 2u32..70, any::<bool>());
    (shapes, any::<u32>(), 0u32..16, 0u32..4).prop_map(
        |((width, height, wide), seed, bits, voids)| {
            let (sample_type, most) = match wide {
                true => (SampleType::U16, 65535u32),
                false => (SampleType::U8, 255),
            };
            let noise = move |column: u32, row: u32, band: u32| {
                let parts = [column, row, band].map(|part| part + 1);
                let [a, b, c] = parts;
                let mixed = a.wrapping_mul(0x9E37_79B1)
                    ^ b.wrapping_mul(0x85EB_CA77)
                    ^ c.wrapping_mul(0xC2B2_AE3D)
                    ^ seed;
                let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
                mixed ^ (mixed >> 13)
            };
            let pixel = move |column: u32, row: u32| {
                let is_void = voids > 0 && noise(column / 5, row / 5, 7) % 8 < voids;
                let ramp = |band: u32| (column * (band + 3) + row * 5) % (most + 1);
                let grain = |band: u32| noise(column, row, band) & ((1 << bits) - 1);
                let number = |band: u32| ((ramp(band) + grain(band)) & most) as u16;
                (!is_void).then(|| [0, 1, 2].map(number))
            };
            Image::new(width, height, sample_type, pixel)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 16,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn lossless_images_come_back_whatever_transform_and_coder(image in images()) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.kmb");
        for transform in TRANSFORMS {
            for entropy in [EntropyKind::Gamma, EntropyKind::Rans] {
                let report = image.build(&path, &options(transform, entropy, 0.0)).unwrap();
                prop_assert_eq!((report.max_error, report.rms_error), (0.0, 0.0));
                prop_assert_eq!(report.void_samples, image.voids());
                prop_assert_eq!(image.largest_error(&decode(&path, None).unwrap()), 0.0);
            }
        }
    }

    #[test]
    fn red_green_and_blue_stay_each_within_the_error(image in images(), max_error in 1u32..300) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.kmb");
        for transform in [TransformKind::Interpolating, TransformKind::TwoStage] {
            for entropy in [EntropyKind::Gamma, EntropyKind::Rans] {
                let options = options(transform, entropy, f64::from(max_error));
                let report = image.build(&path, &options).unwrap();
                let found = image.largest_error(&decode(&path, None).unwrap());
                prop_assert!(found <= f64::from(max_error), "{transform:?}: {found} over {max_error}");
                prop_assert_eq!(report.max_error, found);
            }
        }
    }

    #[test]
    fn no_valid_colour_becomes_the_nodata_value(mut image in images(), max_error in 1u32..40) {
        image.info.nodata = Some(17.0);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.kmb");
        let pixels = image.numbers.chunks_exact_mut(3);
        pixels.filter(|pixel| *pixel == [17.0; 3]).for_each(|pixel| pixel[1] = 18.0);
        let options = options(TransformKind::Interpolating, EntropyKind::Rans, f64::from(max_error));
        image.build(&path, &options).unwrap();
        let decoded = decode(&path, None).unwrap();
        prop_assert!(image.largest_error(&decoded) <= f64::from(max_error));
        prop_assert!(decoded.chunks_exact(3).all(|pixel| pixel != [17.0; 3]));
    }

    #[test]
    fn lifted_colours_keep_their_root_mean_square_error(image in images(), tenths in 5u32..200) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.kmb");
        let limit = f64::from(tenths) / 10.0;
        let options = BuildOptions {
            rms_error: Some(limit),
            ..options(TransformKind::Lifted, EntropyKind::Rans, 0.0)
        };
        let report = image.build(&path, &options).unwrap();
        let decoded = decode(&path, None).unwrap();
        let squares = decoded.iter().zip(&image.numbers).filter(|(_, given)| !given.is_nan());
        let squares: Vec<f64> = squares.map(|(decoded, given)| (decoded - given).powi(2)).collect();
        let rms_error = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        prop_assert!(rms_error <= limit && (rms_error - report.rms_error).abs() < 1e-9);
        prop_assert_eq!(image.largest_error(&decoded), report.max_error);
    }
}

#[test]
fn extremes_of_both_types_come_back_from_every_transform() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    for (sample_type, most) in [(SampleType::U8, 255), (SampleType::U16, 65535)] {
        let pixel = |column: u32, row: u32| {
            Some([column ^ row, column, row].map(|number| if number & 1 == 0 { 0 } else { most }))
        };
        let image = Image::new(83, 50, sample_type, pixel);
        for transform in TRANSFORMS {
            let options = options(transform, EntropyKind::Rans, 0.0);
            image.build(&path, &options).unwrap();
            assert_eq!(image.largest_error(&decode(&path, None).unwrap()), 0.0);
        }
    }
}

#[test]
fn threads_do_not_change_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let image = Image::new(300, 211, SampleType::U8, |column, row| {
        Some([column * row % 251, column % 256, row].map(|number| number as u16))
    });
    for transform in TRANSFORMS {
        let made = [1, 3].map(|threads| {
            let path = folder.path().join("image.kmb");
            let options = BuildOptions {
                threads,
                ..options(transform, EntropyKind::Rans, 0.0)
            };
            image.build(&path, &options).unwrap();
            std::fs::read(path).unwrap()
        });
        assert_eq!(made[0], made[1]);
    }
}

#[test]
fn coarse_levels_of_interpolating_are_every_second_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    let image = Image::new(120, 77, SampleType::U8, |column, row| {
        Some([column + row, 255 - column, row * 3].map(|number| number as u16))
    });
    let options = options(TransformKind::Interpolating, EntropyKind::Rans, 0.0);
    image.build(&path, &options).unwrap();
    let coarse = decode(&path, Some(4)).unwrap();
    let given = image.numbers.chunks_exact(3);
    let picked = given
        .enumerate()
        .filter(|(index, _)| index % 120 % 2 == 0 && index / 120 % 2 == 0)
        .flat_map(|(_, pixel)| pixel.to_vec());
    assert_eq!(coarse, picked.collect::<Vec<f64>>());
}
