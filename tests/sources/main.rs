//! Rasters in every format: what is read is what was written, and what is wrong is said.

#![allow(clippy::unwrap_used, clippy::expect_used)]

mod bad_input;
mod colour;
mod geotiff;
mod mosaic;
mod rasters;
mod resample;

use kimberlite::build::source::{RowSource, SourceOptions, open, parse_raw_shape};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use proptest::prelude::*;
use rasters::{Raster, ascii_grid, in_folder, plain_tiff, png, rasters, read_all, read_file};

fn defaults() -> SourceOptions {
    SourceOptions::default()
}

fn few_cases() -> ProptestConfig {
    ProptestConfig {
        cases: 48,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// One line of an ESRI header for each thing that is not its default.
fn bil_header(raster: &Raster, big: bool) -> String {
    let kind = raster.info.sample_type;
    let pixel_type = match kind {
        SampleType::U8 | SampleType::U16 | SampleType::U32 => "UNSIGNEDINT",
        SampleType::I8 | SampleType::I16 | SampleType::I32 => "SIGNEDINT",
        SampleType::F32 | SampleType::F64 => "FLOAT",
    };
    let mut text = format!(
        "NROWS {}\r\nNCOLS      {}\r\nNBANDS 1\r\nNBITS {}\r\nPIXELTYPE {pixel_type}\r\n\
         BYTEORDER {}\r\nULXMAP 1000.5\r\nULYMAP -20.25\r\nXDIM 0.5\r\nYDIM 0.25\r\nSKIPBYTES 5\r\n",
        raster.info.height,
        raster.info.width,
        8 * kind.size(),
        if big { "M" } else { "I" },
    );
    if let Some(nodata) = raster.info.nodata {
        text += &format!("NODATA {nodata}\r\n");
    }
    text
}

proptest! {
    #![proptest_config(few_cases())]

    #[test]
    fn raw_samples_survive(raster in rasters(&SampleType::ALL, true)) {
        let (_folder, path) = in_folder("a.raw", &raster.bytes(false));
        let shape = (raster.info.width, raster.info.height, raster.info.sample_type);
        let nodata = raster.info.nodata;
        let options = SourceOptions { raw: Some(shape), nodata, ..defaults() };
        let read = read_file(&path, &options).unwrap();
        prop_assert_eq!(&read.info, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn png_samples_survive(
        raster in rasters(&[SampleType::U8, SampleType::U16], true), spacing in 0.1..100.0,
    ) {
        let (_folder, path) = in_folder("a.PNG", &png(&raster));
        let options = SourceOptions {
            spacing: Some(spacing), scale: Some(0.1), nodata: raster.info.nodata, ..defaults()
        };
        let read = read_file(&path, &options).unwrap();
        let top = spacing * f64::from(raster.info.height - 1);
        let expected = RasterInfo {
            geotransform: [0.0, spacing, 0.0, top, 0.0, -spacing],
            value_scale: 0.1,
            ..raster.info.clone()
        };
        prop_assert_eq!(&read.info, &expected);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn tile_of_srtm_survives(side in 2u32..30, bits in prop::collection::vec(any::<i16>(), 900)) {
        let side_samples = side as usize * side as usize;
        let stored = &bits[..side_samples];
        let bytes: Vec<u8> = stored.iter().flat_map(|sample| sample.to_be_bytes()).collect();
        let (_folder, path) = in_folder("S05E013.hgt", &bytes);
        let read = read_file(&path, &defaults()).unwrap();
        let step = 1.0 / f64::from(side - 1);
        prop_assert_eq!(read.info.geotransform, [13.0, step, 0.0, -4.0, 0.0, -step]);
        prop_assert_eq!(read.info.sample_to_crs(0.0, 0.0), [13.0, -4.0]);
        prop_assert!(read.info.georeferenced && read.info.geographic);
        prop_assert_eq!((read.info.crs.as_str(), read.info.units.as_str()), ("EPSG:4326", "m"));
        for (&sample, &read) in stored.iter().zip(&read.samples) {
            let void = sample == -32768;
            prop_assert!(void && read.is_nan() || !void && read == f64::from(sample));
        }
    }

    #[test]
    fn text_of_ascii_grid_survives(
        raster in rasters(&[SampleType::I32, SampleType::F64], true), centred in any::<bool>(),
    ) {
        let place = if centred { "center" } else { "corner" };
        let nodata = raster.info.nodata.unwrap();
        let header =
            format!("xll{place} 10.5\nYLL{place} -3\ncellsize 0.25\nNODATA_value {nodata}\n");
        let (_folder, path) = in_folder("a.asc", ascii_grid(&raster, &header).as_bytes());
        let read = read_file(&path, &defaults()).unwrap();
        prop_assert_eq!(read.info.sample_type, raster.info.sample_type);
        prop_assert_eq!(read.info.nodata, raster.info.nodata);
        let half = if centred { 0.0 } else { 0.125 };
        let lower_left = read.info.sample_to_crs(0.0, f64::from(raster.info.height - 1));
        prop_assert_eq!(lower_left, [10.5 + half, -3.0 + half]);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn bil_with_header_survives(raster in rasters(&SampleType::ALL, true), big in any::<bool>()) {
        let mut bytes = b"skip!".to_vec();
        bytes.extend(raster.bytes(big));
        let (folder, path) = in_folder("a.bil", &bytes);
        std::fs::write(folder.path().join("a.hdr"), bil_header(&raster, big)).unwrap();
        let read = read_file(&path, &defaults()).unwrap();
        let expected = RasterInfo {
            geotransform: [1000.5, 0.5, 0.0, -20.25, 0.0, -0.25],
            georeferenced: true,
            registration: Registration::Point,
            ..raster.info.clone()
        };
        prop_assert_eq!(&read.info, &expected);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn plain_tiff_of_either_byte_order_survives(
        raster in rasters(&SampleType::ALL, false),
        big in any::<bool>(),
        rows in 1usize..9,
        tile in prop::option::of(Just(16)),
    ) {
        let (_folder, path) = in_folder("a.tif", &plain_tiff(&raster, big, rows, tile));
        let read = read_file(&path, &defaults()).unwrap();
        prop_assert_eq!(&read.info, &raster.info);
        raster.assert_same_samples(&read.samples);
    }

    #[test]
    fn rows_of_a_callback_survive(raster in rasters(&SampleType::ALL, true)) {
        let given = Raster { samples: raster.stored().collect(), info: raster.info.clone() };
        let callback = move |first: u32, rows: &mut [f64]| given.copy_rows(first, rows);
        let mut source = RowSource::new(raster.info.clone(), Box::new(callback));
        let read = read_all(&mut source).unwrap();
        raster.assert_same_samples(&read);
    }
}

fn envi(kind: u32, order: u32, extra: &str) -> String {
    format!(
        "ENVI\ndescription = {{\n  two lines\n of text }}\nsamples = 3\nlines   = 2\nbands = 1\n\
         header offset = 2\ndata type = {kind}\ninterleave = bsq\nbyte order = {order}\n{extra}"
    )
}

#[test]
fn envi_types_and_byte_orders_are_told_apart() {
    let types = [
        (1, SampleType::U8),
        (2, SampleType::I16),
        (3, SampleType::I32),
        (4, SampleType::F32),
        (5, SampleType::F64),
        (12, SampleType::U16),
        (13, SampleType::U32),
    ];
    for (number, sample_type) in types {
        for big in [false, true] {
            let mut info = RasterInfo::new(3, 2, sample_type);
            info.nodata = Some(200.0);
            let raster = Raster {
                info,
                samples: vec![1.0, 2.0, f64::NAN, 100.0, 5.0, 127.0],
            };
            let mut bytes = vec![9, 9];
            bytes.extend(raster.bytes(big));
            let (_folder, path) = in_folder("a.dat", &bytes);
            let header = envi(number, u32::from(big), "data ignore value = 200\n");
            std::fs::write(path.with_extension("dat.hdr"), header).unwrap();
            let read = read_file(&path, &defaults()).unwrap();
            assert_eq!(read.info, raster.info);
            raster.assert_same_samples(&read.samples);
        }
    }
}

#[test]
fn envi_map_info_places_the_raster() {
    let info = |extra: &str| {
        let (_folder, path) = in_folder("a.img", &[0; 8]);
        std::fs::write(path.with_extension("hdr"), envi(1, 0, extra)).unwrap();
        open(&path, &defaults()).unwrap().info().clone()
    };
    let utm = info("map info = {UTM, 1.5, 2.0, 500, 9000, 10, 20, 18, South, WGS-84}\n");
    assert_eq!(utm.geotransform, [495.0, 10.0, 0.0, 9020.0, 0.0, -20.0]);
    assert_eq!((utm.crs.as_str(), utm.geographic), ("EPSG:32718", false));
    assert_eq!(utm.registration, Registration::Area);
    let degrees = info("map info = {Geographic Lat/Lon, 1, 1, -5, 50, 0.1, 0.1, WGS-84}\n");
    assert_eq!(
        (degrees.crs.as_str(), degrees.geographic),
        ("EPSG:4326", true)
    );
    let wkt = info(
        "map info = {Local, 1, 1, 0, 0, 1, 1}\n\
         coordinate system string = {GEOGCS[\"Own\", DATUM[\"D\"]]}\n",
    );
    assert_eq!(wkt.crs, "GEOGCS[\"Own\", DATUM[\"D\"]]");
    assert!(wkt.geographic);
}

#[test]
fn prj_beside_an_ascii_grid_is_its_reference_system() {
    let grid = "ncols 2\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n";
    for (wkt, geographic) in [("PROJCS[\"P\"]", false), ("GEOGCRS[\"G\"]", true)] {
        let (_folder, path) = in_folder("a.asc", grid.as_bytes());
        std::fs::write(path.with_extension("prj"), format!("{wkt}\n")).unwrap();
        let info = open(&path, &defaults()).unwrap().info().clone();
        assert_eq!((info.crs.as_str(), info.geographic), (wkt, geographic));
    }
}

#[test]
fn ascii_rows_may_be_wrapped() {
    let grid = "ncols 3\nnrows 2\ncellsize 1\n1 2\n3\n\n4\n5 6\n\n";
    let (_folder, path) = in_folder("a.asc", grid.as_bytes());
    let read = read_file(&path, &defaults()).unwrap();
    assert_eq!(read.samples, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    assert_eq!(read.info, RasterInfo::new(3, 2, SampleType::I32));
}

#[test]
fn nodata_is_compared_in_the_type_of_the_samples() {
    let read = |sample_type, stored: &[f64], nodata| {
        let info = RasterInfo::new(stored.len() as u32, 1, sample_type);
        let raster = Raster {
            info,
            samples: stored.to_vec(),
        };
        let (_folder, path) = in_folder("a", &raster.bytes(false));
        let raw = Some((stored.len() as u32, 1, sample_type));
        let options = SourceOptions {
            raw,
            nodata: Some(nodata),
            ..defaults()
        };
        read_file(&path, &options).unwrap().samples
    };
    let close = read(SampleType::F32, &[f64::from(-9999.9f32), 1.0], -9999.9);
    assert!(close[0].is_nan() && close[1] == 1.0);
    assert_eq!(read(SampleType::U16, &[65535.0, 0.0], -1.0), [65535.0, 0.0]);
    assert_eq!(read(SampleType::U8, &[0.0, 1.0], 0.5), [0.0, 1.0]);
    assert_eq!(
        read(SampleType::F32, &[f64::from(f32::MAX)], 1e300),
        [f64::from(f32::MAX)]
    );
    let nan = read(SampleType::F64, &[f64::NAN, 1.0], f64::NAN);
    assert!(nan[0].is_nan() && nan[1] == 1.0);
    let infinite = read(
        SampleType::F32,
        &[f64::NEG_INFINITY, 1.0],
        f64::NEG_INFINITY,
    );
    assert!(infinite[0].is_nan() && infinite[1] == 1.0);
}

#[test]
fn tile_with_another_name_is_not_georeferenced() {
    for name in ["heights.hgt", "N49W1x3.hgt", "N99W123.hgt", "N+9W123.hgt"] {
        let (_folder, path) = in_folder(name, &[0; 18]);
        let info = open(&path, &defaults()).unwrap().info().clone();
        assert!(
            !info.georeferenced && !info.geographic && info.crs.is_empty(),
            "{name}"
        );
    }
}

#[test]
fn raw_shape_is_read_exactly() {
    assert_eq!(parse_raw_shape("7x5xf32").unwrap(), (7, 5, SampleType::F32));
    for text in [
        "", "7x5", "7x5xf16", "0x5xu8", "7x5xu8x", "7x-5xu8", "7,5,u8",
    ] {
        assert!(
            parse_raw_shape(text)
                .unwrap_err()
                .to_string()
                .contains(&format!("`{text}`"))
        );
    }
}
