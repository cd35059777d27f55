//! Images of red, green and blue in every format, in and out.

use std::path::Path;

use jpeg_encoder::{ColorType as JpegColour, Encoder};
use kimberlite::build::source::{Mosaic, RowSource, SourceOptions, open_all};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use kimberlite::tool::raster_file::write_geotiff;
use proptest::prelude::*;

use crate::few_cases;
use crate::rasters::{
    Raster, banded_tiff, georeferenced, in_folder, message, read_all, read_file, sample_bytes,
};

const COLOUR_TYPES: [SampleType; 2] = [SampleType::U8, SampleType::U16];

fn colours() -> SourceOptions {
    SourceOptions {
        colour: true,
        ..SourceOptions::default()
    }
}

/// Images without a georeference; where `with_alpha`, one pixel in four is void.
fn images(with_alpha: bool) -> impl Strategy<Value = Raster> {
    (prop::sample::select(&COLOUR_TYPES[..]), 1u32..30, 1u32..30)
        .prop_flat_map(|(sample_type, width, height)| {
            let bits = prop::collection::vec(any::<[u16; 4]>(), (width * height) as usize);
            (Just(RasterInfo::new(width, height, sample_type)), bits)
        })
        .prop_map(move |(mut info, bits)| {
            info.bands = 3;
            info.alpha = with_alpha;
            let greatest = info.sample_type.greatest() as u16;
            let pixel = |&[red, green, blue, void]: &[u16; 4]| match void % 4 {
                0 if with_alpha => [f64::NAN; 3],
                _ => [red, green, blue].map(|number| f64::from(number & greatest)),
            };
            let samples = bits.iter().flat_map(pixel).collect();
            Raster { info, samples }
        })
}

/// What a file stores: three bands, or four with alpha.
fn stored_bands(raster: &Raster) -> Vec<f64> {
    let opaque = raster.info.sample_type.greatest();
    let pixel = |pixel: &[f64]| match (raster.info.alpha, pixel[0].is_nan()) {
        (false, _) => pixel.to_vec(),
        (true, true) => vec![1.0, 2.0, 3.0, 0.0],
        (true, false) => vec![pixel[0], pixel[1], pixel[2], opaque],
    };
    raster.samples.chunks(3).flat_map(pixel).collect()
}

fn png(raster: &Raster, color: ::png::ColorType, stored: &[f64]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, raster.info.width, raster.info.height);
    encoder.set_color(color);
    let depth = 8 * raster.info.sample_type.size() as u8;
    encoder.set_depth(::png::BitDepth::from_u8(depth).unwrap());
    let data = stored
        .iter()
        .flat_map(|&number| sample_bytes(raster.info.sample_type, number, true));
    let data: Vec<u8> = data.collect();
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&data)
        .unwrap();
    bytes
}

fn jpeg(width: u16, height: u16, data: &[u8], colour: JpegColour, progressive: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 100);
    encoder.set_progressive(progressive);
    encoder.encode(data, width, height, colour).unwrap();
    bytes
}

/// Red, green and blue of a smooth image.
fn smooth(width: u32, height: u32) -> Vec<u8> {
    let pixel = |row: u32, column: u32| {
        [column * 3 + row, 255 - row * 2, 40 + column + row].map(|number| number as u8)
    };
    (0..height)
        .flat_map(|row| (0..width).flat_map(move |column| pixel(row, column)))
        .collect()
}

fn written_and_read(raster: &Raster) -> Raster {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let rows = |first, rows: &mut [f64]| raster.copy_rows(first, rows);
    write_geotiff(&path, &raster.info, rows).unwrap();
    read_file(&path, &colours()).unwrap()
}

fn any_image() -> impl Strategy<Value = Raster> {
    prop_oneof![images(false), images(true)]
}

proptest! {
    #![proptest_config(few_cases())]

    #[test]
    fn png_colours_survive(raster in any_image()) {
        let color = if raster.info.alpha { ::png::ColorType::Rgba } else { ::png::ColorType::Rgb };
        let (_folder, path) = in_folder("a.png", &png(&raster, color, &stored_bands(&raster)));
        let read = read_file(&path, &colours()).unwrap();
        prop_assert_eq!(&read.info, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn tiff_colours_survive_interleaved_and_by_plane(
        raster in any_image(),
        planar in any::<bool>(),
        big in any::<bool>(),
        rows in 1usize..9,
        tile in prop::option::of(Just(16)),
    ) {
        let (info, bands) = (&raster.info, if raster.info.alpha { 4 } else { 3 });
        let bytes = banded_tiff(info, &stored_bands(&raster), bands, planar, big, rows, tile);
        let (_folder, path) = in_folder("a.tif", &bytes);
        let read = read_file(&path, &colours()).unwrap();
        prop_assert_eq!(&read.info, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn written_colours_read_back_with_their_georeference(
        raster in any_image(), point in any::<bool>(),
    ) {
        let registration = if point { Registration::Point } else { Registration::Area };
        let mut info = georeferenced(raster.info.clone(), registration);
        info.crs = "EPSG:32613".to_string();
        let raster = Raster { info, ..raster };
        let read = written_and_read(&raster);
        let without_tags = RasterInfo { metadata: Default::default(), ..read.info };
        prop_assert_eq!(&without_tags, &raster.info);
        raster.assert_same_samples(&read.samples);
    }
}

#[test]
fn jpeg_colours_are_near_those_encoded() {
    for progressive in [false, true] {
        let stored = smooth(50, 37);
        let bytes = jpeg(50, 37, &stored, JpegColour::Rgb, progressive);
        for name in ["a.jpg", "a.JPEG"] {
            let (_folder, path) = in_folder(name, &bytes);
            let read = read_file(&path, &colours()).unwrap();
            let info = &read.info;
            assert_eq!((info.width, info.height, info.bands), (50, 37, 3));
            assert_eq!(info.sample_type, SampleType::U8);
            for (index, (&a, &b)) in stored.iter().zip(&read.samples).enumerate() {
                assert!(
                    (f64::from(a) - b).abs() <= 6.0,
                    "number {index}: {a} became {b}"
                );
            }
        }
    }
}

#[test]
fn jpeg_that_is_cut_off_is_refused() {
    let bytes = jpeg(200, 100, &smooth(200, 100), JpegColour::Rgb, false);
    for length in [3, 100, bytes.len() / 2, bytes.len() * 9 / 10] {
        let (_folder, path) = in_folder("a.jpg", &bytes[..length]);
        let text = message(&path, &colours());
        assert!(text.contains("a.jpg: cannot "), "{length} bytes: {text}");
    }
}

#[test]
fn palette_and_transparent_colour_of_a_png_become_colours_and_voids() {
    let mut bytes = Vec::new();
    let mut encoder = ::png::Encoder::new(&mut bytes, 3, 1);
    encoder.set_color(::png::ColorType::Indexed);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_palette(vec![1, 2, 3, 250, 251, 252]);
    encoder.set_trns(vec![255, 0]);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(&[0, 1, 0])
        .unwrap();
    let (_folder, path) = in_folder("a.png", &bytes);
    let read = read_file(&path, &colours()).unwrap();
    let void = [f64::NAN; 3];
    let expected = [[1.0, 2.0, 3.0], void, [1.0, 2.0, 3.0]].concat();
    assert!(read.info.alpha);
    Raster {
        info: read.info,
        samples: expected,
    }
    .assert_same_samples(&read.samples);
}

fn pixels(pixels: &[[f64; 3]], nodata: Option<f64>) -> Raster {
    let mut info = RasterInfo::new(pixels.len() as u32, 1, SampleType::U8);
    info.bands = 3;
    info.nodata = nodata;
    Raster {
        info,
        samples: pixels.concat(),
    }
}

#[test]
fn pixel_is_void_where_all_bands_have_the_nodata_value() {
    let stored = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0; 3]];
    let raster = pixels(&stored, None);
    let bytes = png(&raster, ::png::ColorType::Rgb, &raster.samples);
    let (_folder, path) = in_folder("a.png", &bytes);
    let options = SourceOptions {
        nodata: Some(0.0),
        ..colours()
    };
    let read = read_file(&path, &options).unwrap();
    let expected = pixels(&[[f64::NAN; 3], stored[1], [f64::NAN; 3]], Some(0.0));
    expected.assert_same_samples(&read.samples);
    // Written again, the nodata value stands for the voids; a valid pixel must not look like one.
    let again = written_and_read(&expected);
    assert_eq!((again.info.nodata, again.info.alpha), (Some(0.0), false));
    expected.assert_same_samples(&again.samples);
    let folder = tempfile::tempdir().unwrap();
    let refused = |raster: &Raster| {
        let rows = |first, rows: &mut [f64]| raster.copy_rows(first, rows);
        let written = write_geotiff(&folder.path().join("a.tif"), &raster.info, rows);
        written.unwrap_err().to_string()
    };
    let hidden = refused(&pixels(&[[1.0; 3], [0.0; 3]], Some(0.0)));
    assert!(
        hidden.ends_with("column 1, row 0 is valid, but equals the nodata value 0"),
        "{hidden}"
    );
    let void = refused(&pixels(&[[f64::NAN; 3]], None));
    assert!(void.contains("column 0, row 0 is void"), "{void}");
    let large = refused(&pixels(&[[0.0, 256.0, 0.0]], None));
    assert!(large.contains("is 256, which u8 cannot hold"), "{large}");
}

#[test]
fn half_transparent_pixels_are_refused_with_their_place() {
    let mut raster = pixels(&[[1.0; 3], [2.0; 3]], None);
    let stored = [1.0, 1.0, 1.0, 255.0, 2.0, 2.0, 2.0, 128.0];
    let expected = "row 0: the pixel at column 1 is half transparent (alpha 128); \
                    alpha must be 0, a void, or 255";
    let (_folder, path) = in_folder("a.png", &png(&raster, ::png::ColorType::Rgba, &stored));
    assert!(message(&path, &colours()).contains(expected));
    raster.info.alpha = true;
    let bytes = banded_tiff(&raster.info, &stored, 4, false, false, 1, None);
    let (_folder, path) = in_folder("a.tif", &bytes);
    assert!(message(&path, &colours()).contains(expected));
}

#[test]
fn heights_are_refused_as_colours() {
    let grey = Raster {
        info: RasterInfo::new(2, 1, SampleType::U8),
        samples: vec![1.0, 2.0],
    };
    let one = "1 band; colours have three: red, green and blue";
    let said = |name: &str, bytes: &[u8]| {
        let (_folder, path) = in_folder(name, bytes);
        let text = message(&path, &colours());
        text.split_once(": ").unwrap().1.to_string()
    };
    assert_eq!(
        said(
            "a.png",
            &png(&grey, ::png::ColorType::Grayscale, &grey.samples)
        ),
        one
    );
    assert_eq!(
        said("a.tif", &crate::rasters::plain_tiff(&grey, false, 1, None)),
        one
    );
    assert_eq!(
        said("a.jpg", &jpeg(2, 1, &[1, 2], JpegColour::Luma, false)),
        one
    );
    for extension in ["hgt", "asc", "bil", "img"] {
        let text = said(&format!("a.{extension}"), b"");
        assert!(
            text.starts_with("a format of heights; colours come from GeoTIFF"),
            "{text}"
        );
    }
    assert!(said("a.gif", b"").starts_with("extension .gif is unknown; supported: GeoTIFF"));
    let (_folder, path) = in_folder("a.raw", &[0; 2]);
    let options = SourceOptions {
        raw: Some((2, 1, SampleType::U8)),
        ..colours()
    };
    assert!(message(&path, &options).ends_with(one));
    let mut signed = RasterInfo::new(1, 1, SampleType::I16);
    let tiff = |info: &RasterInfo, bands: usize| {
        banded_tiff(
            info,
            &[1.0, 2.0, 3.0, 4.0, 5.0],
            bands,
            false,
            false,
            1,
            None,
        )
    };
    assert_eq!(
        said("a.tif", &tiff(&signed, 3)),
        "i16 samples; colours are u8 or u16"
    );
    signed.sample_type = SampleType::U8;
    let five = "5 bands; colours have three: red, green and blue";
    assert_eq!(said("a.tif", &tiff(&signed, 5)), five);
    let cmyk = said("a.jpg", &jpeg(1, 1, &[1, 2, 3, 4], JpegColour::Cmyk, false));
    assert!(cmyk.contains("colours are not supported"), "{cmyk}");
}

#[test]
fn colours_are_refused_as_heights() {
    let (_folder, path) = in_folder("a.jpg", &jpeg(8, 8, &smooth(8, 8), JpegColour::Rgb, false));
    let text = message(&path, &SourceOptions::default());
    assert!(
        text.ends_with("a JPEG image holds colours, not heights"),
        "{text}"
    );
}

#[test]
fn bounds_place_an_image_by_its_outer_edges() {
    let bytes = jpeg(4, 2, &smooth(4, 2), JpegColour::Rgb, false);
    let (_folder, path) = in_folder("a.jpg", &bytes);
    let with = |bounds| SourceOptions {
        bounds: Some(bounds),
        ..colours()
    };
    for bounds in [[10.0, 20.0, 12.0, 19.0], [12.0, 19.0, 10.0, 20.0]] {
        let info = read_file(&path, &with(bounds)).unwrap().info;
        assert_eq!(info.geotransform, [10.0, 0.5, 0.0, 20.0, 0.0, -0.5]);
        assert!(info.georeferenced && info.registration == Registration::Area);
        assert_eq!(info.sample_to_crs(0.0, 0.0), [10.25, 19.75]);
    }
    for bounds in [[1.0, 0.0, 1.0, 2.0], [0.0, 0.0, f64::NAN, 2.0]] {
        assert!(message(&path, &with(bounds)).contains("are not corners of an area"));
    }
    let both = SourceOptions {
        spacing: Some(1.0),
        ..with([0.0, 0.0, 1.0, 1.0])
    };
    assert_eq!(message(&path, &both), "bounds already give the spacing");
    let several = open_all(&[path.clone(), path.clone()], &with([0.0, 0.0, 1.0, 1.0]));
    let text = several.err().unwrap().to_string();
    assert_eq!(
        text,
        "bounds are those of one raster, and there are several"
    );
}

#[test]
fn mosaic_of_images_joins_whole_pixels() {
    let placed = |column: f64, pixel: [f64; 3]| {
        let mut raster = pixels(&[pixel, pixel], None);
        raster.info.geotransform = [column, 1.0, 0.0, 0.0, 0.0, -1.0];
        raster.info.georeferenced = true;
        raster
    };
    let source = |raster: Raster| {
        let info = raster.info.clone();
        let callback = move |first: u32, rows: &mut [f64]| raster.copy_rows(first, rows);
        (
            Path::new("part").to_path_buf(),
            Box::new(RowSource::new(info, Box::new(callback))) as Box<_>,
        )
    };
    let parts = [
        placed(0.0, [1.0, 2.0, 3.0]),
        placed(1.0, [4.0, f64::NAN, 6.0]),
        placed(3.0, [7.0, 8.0, 9.0]),
    ];
    let mut mosaic = Mosaic::new(parts.map(source).into()).unwrap();
    let read = read_all(&mut mosaic).unwrap();
    let (first, void, last) = ([1.0, 2.0, 3.0], [f64::NAN; 3], [7.0, 8.0, 9.0]);
    pixels(&[first, first, void, last, last], None).assert_same_samples(&read);
    let mut grey = placed(0.0, [0.0; 3]);
    grey.info.bands = 1;
    let error = Mosaic::new([placed(0.0, [0.0; 3]), grey].map(source).into());
    assert!(
        error
            .err()
            .unwrap()
            .to_string()
            .contains("it has 1 bands and not 3")
    );
}
