//! Blocks as PNG images.

use crate::codec::{Content, block, blocks};
use kimberlite::blockmap::{read_png, write_png};
use proptest::prelude::*;
use std::path::Path;

fn in_folder(work: impl FnOnce(&Path)) {
    let folder = tempfile::tempdir().unwrap();
    work(&folder.path().join("block.png"));
}

fn refused(path: &Path) -> String {
    read_png(path).unwrap_err().to_string()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_block_comes_back(map in blocks()) {
        in_folder(|path| {
            write_png(&map, path).unwrap();
            assert_eq!(read_png(path).unwrap(), map);
        });
    }
}

#[test]
fn north_is_at_the_top() {
    let mut map = block(32, 1, false, Content::Constant, 4);
    map.set(3, 31, [1, 2, 3, 4]);
    in_folder(|path| {
        write_png(&map, path).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels[12..16], [1, 2, 3, 4]);
    });
}

#[test]
fn truncated_and_damaged_images_are_refused_or_read() {
    let map = block(32, 1, true, Content::Houses, 6);
    in_folder(|path| {
        write_png(&map, path).unwrap();
        let whole = std::fs::read(path).unwrap();
        for length in (0..whole.len() - 12).step_by(7) {
            std::fs::write(path, &whole[..length]).unwrap();
            assert!(read_png(path).is_err(), "{length} bytes");
        }
        for at in (0..whole.len()).step_by(5) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << (at % 8);
            std::fs::write(path, &bytes).unwrap();
            let _ = read_png(path);
        }
    });
}

/// An image of so many pixels with these texts.
fn image(path: &Path, [width, height]: [u32; 2], colours: png::ColorType, texts: &[(&str, &str)]) {
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(colours);
    for (keyword, text) in texts {
        let (keyword, text) = ((*keyword).to_owned(), (*text).to_owned());
        encoder.add_text_chunk(keyword, text).unwrap();
    }
    let mut writer = encoder.write_header().unwrap();
    let bytes = vec![0; colours.samples() * (width * height) as usize];
    writer.write_image_data(&bytes).unwrap();
}

#[test]
fn what_is_wrong_is_said() {
    let size = [320, 32];
    let whole = [
        ("Corner", "1.5 -2"),
        ("Side", "64"),
        ("Heights", "0 10.5"),
        ("Slices", "2"),
        ("Exposure", "1.5"),
        ("Roof slope", "3"),
    ];
    in_folder(|path| {
        image(path, size, png::ColorType::Rgba, &whole);
        assert_eq!(read_png(path).unwrap().slices, 2);
        image(path, size, png::ColorType::Rgb, &whole);
        assert!(refused(path).contains("instead of RGBA"));
        image(path, [320, 33], png::ColorType::Rgba, &whole);
        assert!(refused(path).contains("320 x 33 pixels"));
        image(path, [321, 32], png::ColorType::Rgba, &whole);
        assert!(refused(path).contains("321 x 32 pixels"));
        image(path, size, png::ColorType::Rgba, &whole[1..]);
        assert!(refused(path).contains("no text `Corner`"));
        for (at, text) in [
            (0, "1.5"),
            (0, "inf 0"),
            (1, "-64"),
            (2, "3 1"),
            (3, "32"),
            (4, "NaN"),
            (5, "steep"),
        ] {
            let mut texts = whole;
            texts[at].1 = text;
            image(path, size, png::ColorType::Rgba, &texts);
            assert!(read_png(path).is_err(), "{text}");
        }
    });
    assert!(refused(Path::new("no such folder/a.png")).contains("cannot open"));
}
