//! Colours that cannot be had.

use crate::image::{Image, decode};
use kimberlite::Error;
use kimberlite::build::BuildOptions;
use kimberlite::cut::{Layer, Terrain};
use kimberlite::geo::SampleType;
use kimberlite::store::{Access, TransformKind};

fn image(sample_type: SampleType) -> Image {
    Image::new(90, 70, sample_type, |column, row| {
        Some([column * 2, row, column ^ row].map(|number| number as u16))
    })
}

#[test]
fn colours_of_signed_integers_and_of_floats_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    for sample_type in [SampleType::I16, SampleType::F32, SampleType::U32] {
        let error = image(sample_type).build(&path, &BuildOptions::default());
        let message = error.unwrap_err().to_string();
        assert!(message.contains("u8 or u16"), "{message}");
        assert!(!path.exists());
    }
}

#[test]
fn colours_are_no_terrain() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    image(SampleType::U8)
        .build(&path, &BuildOptions::default())
        .unwrap();
    assert!(Layer::open(&path, Access::Map).is_ok());
    let error = Terrain::open(&path, Access::Map).err().unwrap();
    assert!(matches!(&error, Error::Input { message, .. } if message.contains("colours")));
}

#[test]
fn lifted_promises_no_maximum_error_of_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    let options = BuildOptions {
        transform: TransformKind::Lifted,
        max_error: 3.0,
        ..BuildOptions::default()
    };
    let error = image(SampleType::U8).build(&path, &options).unwrap_err();
    assert!(error.to_string().contains("lifted keeps no maximum error"));
}

#[test]
fn a_flipped_bit_anywhere_is_reported_or_harmless_but_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kmb");
    for transform in [TransformKind::Interpolating, TransformKind::Lifted] {
        let options = BuildOptions {
            transform,
            cells_log2: 4,
            ..BuildOptions::default()
        };
        let image = image(SampleType::U8);
        image.build(&path, &options).unwrap();
        let sound = std::fs::read(&path).unwrap();
        // Without its magic a file is none of ours.
        for place in (8..sound.len()).step_by(37) {
            let mut bytes = sound.clone();
            bytes[place] ^= 1 << (place % 8);
            std::fs::write(&path, &bytes).unwrap();
            match decode(&path, None) {
                Ok(decoded) => assert_eq!(image.largest_error(&decoded), 0.0, "byte {place}"),
                Err(Error::Damaged { .. } | Error::Version { .. }) => {}
                Err(error) => panic!("byte {place}: {error}"),
            }
        }
    }
}
