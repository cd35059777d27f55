//! What is said of files that cannot be read.

use std::path::Path;

use kimberlite::build::source::{RasterSource, RowSource, SourceOptions, open};
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::tool::raster_file::write_geotiff;

use proptest::prelude::*;

use crate::rasters::{Raster, ascii_grid, in_folder, message, plain_tiff, png, read_file};
use crate::{defaults, few_cases};

fn said_of(name: &str, bytes: &[u8]) -> String {
    let (_folder, path) = in_folder(name, bytes);
    let text = message(&path, &defaults());
    let about = format!("{}: ", path.display());
    text.strip_prefix(&about)
        .unwrap_or_else(|| panic!("`{text}` does not begin with {about}"))
        .into()
}

fn said_of_grid(text: &str) -> String {
    said_of("a.asc", text.as_bytes())
}

/// What is said of `header` beside six bytes.
fn said_of_header(header: &str) -> String {
    let (_folder, path) = in_folder("a.bil", &[0; 6]);
    std::fs::write(path.with_extension("hdr"), header).unwrap();
    let text = message(&path, &defaults());
    text.split_once(": ").unwrap().1.to_string()
}

fn noise(width: u32, height: u32, sample_type: SampleType) -> Raster {
    let info = RasterInfo::new(width, height, sample_type);
    let samples = (0..width * height)
        .map(|index| f64::from(index.wrapping_mul(2_654_435_761) >> 24))
        .collect();
    Raster { info, samples }
}

#[test]
fn missing_file_is_named() {
    for name in ["a.tif", "a.png", "a.hgt", "a.asc", "a.bil"] {
        let path = Path::new("no such folder").join(name);
        let text = message(&path, &defaults());
        assert!(
            text.starts_with(&format!("{}: cannot open: ", path.display())),
            "{text}"
        );
    }
    let options = SourceOptions {
        raw: Some((1, 1, SampleType::U8)),
        ..defaults()
    };
    assert!(message(Path::new("no such file"), &options).contains("no such file: cannot open: "));
}

#[test]
fn text_with_the_name_of_another_format_is_told() {
    let text = b"hello, world, this is text and nothing else";
    assert_eq!(
        said_of("a.tif", text),
        "not a TIFF file (its first bytes are \"hell\")"
    );
    assert_eq!(
        said_of("a.tif", b""),
        "not a TIFF file (its first bytes are \"\")"
    );
    assert!(said_of("a.png", text).starts_with("cannot read the PNG header: "));
    assert!(said_of("a.hgt", text).contains("no square of 16-bit samples"));
    assert!(said_of("a.asc", text).starts_with("line 1: `hello,` is not a header key"));
    assert!(said_of("a.asc", &[0xff, 0xfe, 0x00]).starts_with("line 1: not text"));
    assert!(said_of("a.img", b"EHFA_HEADER_TAG and more").contains("ERDAS Imagine"));
}

#[test]
fn unknown_extension_lists_what_is_supported() {
    let text = said_of("a.jp2", b"");
    assert!(text.starts_with("extension .jp2 is unknown; supported: GeoTIFF (.tif, .tiff), "));
    for extension in [".png", ".hgt", ".asc", ".bil", ".dat", ".img", ".bin"] {
        assert!(text.contains(extension), "{text}");
    }
    assert!(said_of("a", b"").starts_with("no file extension; supported: "));
}

#[test]
fn truncated_files_say_which_row() {
    let raster = noise(40, 40, SampleType::U16);
    let folder = tempfile::tempdir().unwrap();
    let deflated = folder.path().join("a.tif");
    write_geotiff(&deflated, &raster.info, |first, rows| {
        raster.copy_rows(first, rows)
    })
    .unwrap();
    let deflated = std::fs::read(deflated).unwrap();
    assert!(
        said_of("a.tif", &deflated[..deflated.len() / 2])
            .starts_with("cannot read the TIFF directory: ")
    );

    let mut plain = plain_tiff(&raster, false, 8, None);
    let start = u32::from_le_bytes(plain[4..8].try_into().unwrap()) as usize;
    assert!(said_of("a.tif", &plain[..start - 10]).starts_with("cannot read the TIFF directory: "));
    // With the five strips' offsets moved on, the samples reach beyond the end of the file, as they do
    // in a truncated one that has its directory in front.
    for strip in 0..5 {
        let at = start - 4 * 10 + 4 * strip;
        let far = u32::from_le_bytes(plain[at..at + 4].try_into().unwrap()) + 1000;
        plain[at..at + 4].copy_from_slice(&far.to_le_bytes());
    }
    let row = (plain.len() - 8 - 1000) / 80;
    let expected = format!("truncated: row {row} of 40 cannot be read ");
    assert!(said_of("a.tif", &plain).starts_with(&expected));

    let encoded = png(&raster);
    let text = said_of("a.png", &encoded[..encoded.len() / 2]);
    assert!(text.starts_with("cannot read row "), "{text}");
    assert!(said_of("N01E001.hgt", &[0; 2 * 30 * 30 - 2]).contains("truncated"));

    let grid = ascii_grid(&raster, "cellsize 1\n");
    let half = &grid[..grid.len() / 2];
    let text = said_of_grid(half);
    assert!(
        text.starts_with("truncated: row ") && text.contains(" of 40 cannot be read"),
        "{text}"
    );

    let (_folder, path) = in_folder("a.bil", &[0; 50]);
    std::fs::write(path.with_extension("hdr"), "ncols 10\nnrows 6\n").unwrap();
    let text = message(&path, &defaults());
    assert!(
        text.ends_with("truncated: row 5 of 6 cannot be read (50 bytes of 60)"),
        "{text}"
    );
}

#[test]
fn tile_that_is_cut_off_says_which_rows() {
    let raster = noise(40, 40, SampleType::U16);
    let mut bytes = plain_tiff(&raster, false, 8, Some(16));
    let start = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    // The offset of the last of nine tiles, after which nine lengths follow.
    let at = start - 4 * 10;
    bytes[at..at + 4].copy_from_slice(&0x00ff_0000u32.to_le_bytes());
    assert!(said_of("a.tif", &bytes).starts_with("cannot read rows 32 to 39: "));
}

#[test]
fn infinity_is_refused_with_its_place() {
    for value in [f64::INFINITY, f64::NEG_INFINITY] {
        let mut raster = noise(5, 7, SampleType::F32);
        raster.samples[4 * 5 + 3] = value;
        let place = "the sample at column 3, row 4 is infinite";
        assert_eq!(
            said_of("a.tif", &plain_tiff(&raster, false, 2, None)),
            place
        );
        let (_folder, path) = in_folder("a.raw", &raster.bytes(false));
        let options = SourceOptions {
            raw: Some((5, 7, SampleType::F32)),
            ..defaults()
        };
        assert!(message(&path, &options).ends_with(place));
        let info = raster.info.clone();
        let callback = move |first: u32, rows: &mut [f64]| raster.copy_rows(first, rows);
        let mut source = RowSource::new(info, Box::new(callback));
        let text = source.read_rows(&mut [0.0; 35]).unwrap_err().to_string();
        assert_eq!(text, format!("(rows): {place}"));
    }
    let grid = "ncols 2\nnrows 2\ncellsize 1\n1 2\n3 1e999\n";
    assert_eq!(
        said_of_grid(grid),
        "the sample at column 1, row 1 is infinite"
    );
}

#[test]
fn ragged_ascii_grid_is_refused_in_its_line() {
    let head = "ncols 3\nnrows 2\ncellsize 1\n";
    assert_eq!(
        said_of_grid(&format!("{head}1 2\n4 5 6\n")),
        "line 5: row 0 does not have 3 values"
    );
    assert_eq!(
        said_of_grid(&format!("{head}1 2 3 4\n4 5 6\n")),
        "line 4: row 0 does not have 3 values"
    );
    assert_eq!(
        said_of_grid(&format!("{head}1 2 3\n4 5 6\n7\n")),
        "line 6: more than 2 rows"
    );
    assert_eq!(
        said_of_grid(&format!("{head}1 2 3\n4 5\n")),
        "truncated: row 1 of 2 cannot be read (2 values of 3)"
    );
    assert_eq!(
        said_of_grid(&format!("{head}1 2 3\n4 five 6\n")),
        "line 5: column 1, row 1: `five` is not a number"
    );
}

#[test]
fn wrong_header_of_an_ascii_grid_is_named() {
    assert!(
        said_of_grid("ncols 2\nrows 2\n1 2\n").starts_with("line 2: `rows` is not a header key")
    );
    assert!(said_of_grid("ncols two\nnrows 2\n").starts_with("line 1: ncols: `two` is not"));
    assert!(said_of_grid("ncols 0\nnrows 2\n").starts_with("line 1: ncols: `0` is not"));
    assert_eq!(
        said_of_grid("ncols 2\ncellsize 1\n1 2\n"),
        "the header has no nrows"
    );
    assert!(said_of_grid("ncols 2\nnrows 2\n").ends_with("the file ends before the first sample"));
    let placed = "ncols 2\nnrows 1\nxllcorner 0\n";
    assert!(said_of_grid(&format!("{placed}yllcorner 0\n1 2\n")).contains("no cellsize"));
    assert!(
        said_of_grid(&format!("{placed}yllcenter 0\ncellsize 1\n1 2\n")).contains("no pair of")
    );
}

#[test]
fn wrong_header_beside_samples_is_named() {
    assert_eq!(
        said_of_header("ncols 3\nnrows x\n"),
        "line 2: nrows: `x` is not a number that fits"
    );
    assert_eq!(said_of_header("ncols 3\n"), "the header has no nrows");
    assert!(
        said_of_header("ncols 3\nnrows 2\nnbits 12\n").starts_with("line 3: nbits: `12` is not")
    );
    let text = said_of_header("ncols 3\nnrows 2\npixeltype COMPLEX\n");
    assert!(
        text.starts_with("line 3: pixeltype: `COMPLEX` is none of"),
        "{text}"
    );
    assert!(
        said_of_header("ncols 3\nnrows 2\nbyteorder X\n").starts_with("line 3: byteorder: `X`")
    );
    assert!(said_of_header("ncols 0\nnrows 2\n").contains("0 x 2 samples"));
    assert_eq!(
        said_of_header("ENVI\nlines = 2\nbands = 1\n"),
        "the header has no samples"
    );
    let envi = "ENVI\nsamples = 3\nlines = 2\ndata type = 6\n";
    assert!(said_of_header(envi).starts_with("line 4: data type: `6` is not a supported type"));
    let envi = "ENVI\nsamples = 3\nlines = 2\ndata type = 1\nmap info = {UTM, 1, 1, a, 2, 3, 4}\n";
    assert!(said_of_header(envi).starts_with("line 5: map info: "));
    assert!(
        said_of_header("ENVI\nmap info = {UTM,\n").contains("line 2: map info: no closing brace")
    );
    assert!(said_of("a.bil", &[0; 6]).starts_with("there is no header "));
}

#[test]
fn several_bands_are_refused() {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(::png::ColorType::Rgb);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&[1, 2, 3])
        .unwrap();
    assert_eq!(said_of("a.png", &bytes), "3 bands; heights have one");

    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    encoder
        .write_image::<tiff::encoder::colortype::RGB8>(1, 1, &[1, 2, 3])
        .unwrap();
    assert_eq!(
        said_of("a.tif", bytes.get_ref()),
        "3 bands; heights have one"
    );

    let text = said_of_header("ncols 1\nnrows 2\nnbands 3\n");
    assert_eq!(text, "line 3: nbands: `3` bands; heights have one");
    let text = said_of_header("ENVI\nsamples = 1\nlines = 2\nbands = 3\ndata type = 1\n");
    assert_eq!(text, "line 4: bands: `3` bands; heights have one");
}

#[test]
fn raw_file_of_another_length_is_refused() {
    for length in [0, 11, 13] {
        let (_folder, path) = in_folder("a.raw", &vec![0; length]);
        let options = SourceOptions {
            raw: Some((3, 2, SampleType::U16)),
            ..defaults()
        };
        let text = message(&path, &options);
        assert!(text.ends_with(&format!(
            "{length} bytes, but 3 x 2 samples of u16 are 12 bytes"
        )));
    }
    let (_folder, path) = in_folder("a.raw", &[0; 4]);
    let huge = SourceOptions {
        raw: Some((u32::MAX, u32::MAX, SampleType::F64)),
        ..defaults()
    };
    assert!(message(&path, &huge).contains("4 bytes, but 4294967295 x 4294967295"));
    let none = SourceOptions {
        raw: Some((0, 2, SampleType::U16)),
        ..defaults()
    };
    assert!(message(&path, &none).ends_with("0 x 2 samples"));
}

#[test]
fn options_out_of_range_are_refused() {
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let spacing = SourceOptions {
            spacing: Some(value),
            ..defaults()
        };
        assert_eq!(
            message(Path::new("a.png"), &spacing),
            format!("spacing {value} is not a positive number")
        );
        let scale = SourceOptions {
            scale: Some(value),
            ..defaults()
        };
        assert!(message(Path::new("a.png"), &scale).starts_with("scale "));
    }
}

#[test]
fn more_rows_than_there_are_is_an_error() {
    let raster = noise(3, 2, SampleType::U8);
    let (_folder, path) = in_folder("a.png", &png(&raster));
    let mut source = open(&path, &defaults()).unwrap();
    assert!(source.read_rows(&mut [0.0; 4]).is_err(), "not a whole row");
    source.read_rows(&mut [0.0; 6]).unwrap();
    assert!(source.read_rows(&mut [0.0; 3]).is_err());
    source.read_rows(&mut []).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..few_cases() })]

    /// The values may come out wrong, but there is no panic, and errors name the file.
    #[test]
    fn damaged_files_are_read_or_refused(
        format in 0usize..5,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let raster = noise(21, 18, SampleType::U8);
        let (name, mut bytes) = match format {
            0 => ("a.tif", plain_tiff(&raster, false, 4, None)),
            1 => ("a.tif", plain_tiff(&raster, true, 4, Some(16))),
            2 => ("a.png", png(&raster)),
            3 => ("a.asc", ascii_grid(&raster, "cellsize 1\n").into_bytes()),
            _ => {
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("a.tif");
                let rows = |first, rows: &mut [f64]| raster.copy_rows(first, rows);
                write_geotiff(&path, &raster.info, rows).unwrap();
                ("a.tif", std::fs::read(&path).unwrap())
            }
        };
        // Headers and directories are at the ends, and are where damage does most.
        let ends: Vec<usize> =
            (0..bytes.len()).filter(|&at| at < 60 || at + 250 > bytes.len()).collect();
        for (at, value) in changes {
            bytes[ends[at.index(ends.len())]] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let (_folder, path) = in_folder(name, &bytes);
        let small = match open(&path, &defaults()) {
            Ok(source) => u64::from(source.info().width) * u64::from(source.info().height) < 1 << 22,
            Err(error) => {
                prop_assert!(error.to_string().starts_with(&path.display().to_string()));
                false
            }
        };
        if small && let Err(error) = read_file(&path, &defaults()) {
            prop_assert!(error.to_string().starts_with(&path.display().to_string()));
        }
    }
}
