//! An image on the grid of a height raster: what texels are, and what is refused.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use kimberlite::build::source::{
    MOST_TEXELS, RasterSource, Resampled, RowSource, SourceOptions, open, texels_per_sample,
};
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use proptest::prelude::*;

use crate::few_cases;
use crate::rasters::{Raster, read_all};

/// A raster of samples `step` apart, the first of which lies at `first`.
fn grid(size: [u32; 2], first: [f64; 2], step: [f64; 2], registration: Registration) -> RasterInfo {
    let half = match registration {
        Registration::Area => 0.5,
        Registration::Point => 0.0,
    };
    let mut info = RasterInfo::new(size[0], size[1], SampleType::I16);
    info.registration = registration;
    info.georeferenced = true;
    let origin = [first[0] - half * step[0], first[1] - half * step[1]];
    info.geotransform = [origin[0], step[0], 0.0, origin[1], 0.0, step[1]];
    info
}

/// An image on a grid: colours, or a void, by column and row.
fn image_of(
    mut info: RasterInfo,
    sample_type: SampleType,
    pixel: impl Fn(u32, u32) -> Option<[f64; 3]>,
) -> Raster {
    info.bands = 3;
    info.sample_type = sample_type;
    let places = (0..info.height).flat_map(|row| (0..info.width).map(move |column| (column, row)));
    let samples = places
        .flat_map(|(column, row)| pixel(column, row).unwrap_or([f64::NAN; 3]))
        .collect();
    Raster { info, samples }
}

fn source(image: &Raster) -> Box<dyn RasterSource> {
    let (image, info) = (image.clone(), image.info.clone());
    let callback = move |first: u32, rows: &mut [f64]| image.copy_rows(first, rows);
    Box::new(RowSource::new(info, Box::new(callback)))
}

fn resample(image: &Raster, heights: &RasterInfo, texels: u32) -> kimberlite::Result<Raster> {
    let mut resampled = Resampled::new(Path::new("image"), source(image), heights, texels)?;
    let info = resampled.info().clone();
    let samples = read_all(&mut resampled)?;
    Ok(Raster { info, samples })
}

/// Column, row and colour of all texels.
fn texels_of(raster: &Raster) -> impl Iterator<Item = (u32, u32, [f64; 3])> {
    let width = raster.info.width;
    let (pixels, _) = raster.samples.as_chunks::<3>();
    (0u32..)
        .zip(pixels)
        .map(move |(index, &pixel)| (index % width, index / width, pixel))
}

fn registrations() -> impl Strategy<Value = Registration> {
    prop_oneof![Just(Registration::Area), Just(Registration::Point)]
}

proptest! {
    #![proptest_config(few_cases())]

    /// It fixes the place of every texel, whatever the spacings, offsets and registrations are.
    #[test]
    fn linear_ramp_is_reproduced_within_rounding(
        image_registration in registrations(),
        height_registration in registrations(),
        pixel in prop::array::uniform2(0.2..3.0f64),
        texels_log2 in 0u32..4,
        first in prop::array::uniform2(0.0..1.0f64),
        mirrored in any::<bool>(),
    ) {
        let heights = grid([7, 6], [10.0 + first[0], -10.0 - first[1]], [1.0, -1.0], height_registration);
        // The image reaches three of its pixels and three texels beyond the heights on all sides.
        let size = pixel.map(|pixel| (14.0 / pixel).ceil() as u32 + 8);
        let (left, right) = (6.0 - 3.0 * pixel[0], 6.0 + pixel[0] * f64::from(size[0] - 4));
        let top = -6.0 + 3.0 * pixel[1];
        let place = if mirrored {
            grid(size, [right, top], [-pixel[0], -pixel[1]], image_registration)
        } else {
            grid(size, [left, top], [pixel[0], -pixel[1]], image_registration)
        };
        let ramp = |[x, y]: [f64; 2]| {
            [30_000.0 + 1000.0 * x, 30_000.0 - 700.0 * y, 40_000.0 + 300.0 * (x + y)]
        };
        let image = image_of(place.clone(), SampleType::U16, |column, row| {
            Some(ramp(place.sample_to_crs(f64::from(column), f64::from(row))))
        });
        let texels_a_sample = 1 << texels_log2;
        let found = resample(&image, &heights, texels_a_sample).unwrap();
        prop_assert_eq!(found.info.width, 6 * texels_a_sample + 1);
        prop_assert_eq!(found.info.height, 5 * texels_a_sample + 1);
        prop_assert!(!found.info.alpha);
        for (column, row, colour) in texels_of(&found) {
            let in_heights = [column, row].map(|texel| f64::from(texel) / f64::from(texels_a_sample));
            let place = heights.sample_to_crs(in_heights[0], in_heights[1]);
            let said = found.info.sample_to_crs(f64::from(column), f64::from(row));
            for (number, expected) in colour.into_iter().zip(ramp(place)) {
                prop_assert!((number - expected).abs() <= 0.5 + 1e-6, "{number} for {expected}");
            }
            prop_assert!((0..2).all(|axis| (place[axis] - said[axis]).abs() < 1e-9));
        }
    }

    #[test]
    fn constant_stays_constant_beside_voids_and_edges(
        step in prop::array::uniform2(0.3..4.0f64),
        texels_log2 in 0u32..3,
        void in 2u32..9,
        first in prop::array::uniform2(-2.0..2.0f64),
    ) {
        let heights = grid([12, 9], first, [1.0, -1.0], Registration::Point);
        let place = grid([20, 20], [0.0, 0.0], [step[0], -step[1]], Registration::Area);
        let colour = [17.0, 200.0, 255.0];
        let image = image_of(place, SampleType::U8, |column, row| {
            ((column * 7 + row * 3) % void != 0).then_some(colour)
        });
        let found = resample(&image, &heights, 1 << texels_log2).unwrap();
        let is_whole = |pixel: [f64; 3]| pixel == colour || pixel.iter().all(|n| n.is_nan());
        prop_assert!(texels_of(&found).all(|(_, _, pixel)| is_whole(pixel)));
        let valid = texels_of(&found).filter(|(_, _, pixel)| pixel[0] == 17.0).count();
        prop_assert!(valid > 0);
    }

    #[test]
    fn bands_of_rows_do_not_change_texels(rows in 1usize..6) {
        let place = grid([30, 30], [0.0, 0.0], [0.7, -0.7], Registration::Area);
        let image = image_of(place, SampleType::U8, |column, row| {
            Some([column, row, column * row % 251].map(f64::from))
        });
        let heights = grid([10, 11], [1.0, -1.0], [1.5, -1.3], Registration::Area);
        let expected = resample(&image, &heights, 2).unwrap();
        let mut again = Resampled::new(Path::new("image"), source(&image), &heights, 2).unwrap();
        let mut samples = vec![0.0; expected.samples.len()];
        for band in samples.chunks_mut(rows * expected.info.row_length()) {
            again.read_rows(band).unwrap();
        }
        expected.assert_same_samples(&samples);
    }
}

fn noise(info: RasterInfo) -> Raster {
    image_of(info, SampleType::U8, |column, row| {
        let number = (row * 1000 + column).wrapping_mul(2_654_435_761);
        (number >> 28 != 0)
            .then_some([number >> 24, number >> 16, number >> 8].map(|n| f64::from(n as u8)))
    })
}

#[test]
fn image_that_already_lies_on_the_grid_stays_as_it_is() {
    for registration in [Registration::Area, Registration::Point] {
        // Neither the origin nor the step is exact in binary.
        let heights = grid(
            [40, 30],
            [-106.0566, 40.6197],
            [0.00275, -0.00211],
            registration,
        );
        let image = noise(heights.clone());
        let found = resample(&image, &heights, 1).unwrap();
        assert_eq!(found.info.geotransform, heights.geotransform);
        image.assert_same_samples(&found.samples);
        // With texels between the samples, those on the samples are the same still.
        let finer = resample(&image, &heights, 4).unwrap();
        let on_samples =
            texels_of(&finer).filter(|(column, row, _)| column % 4 == 0 && row % 4 == 0);
        image.assert_same_samples(
            &on_samples
                .flat_map(|(_, _, pixel)| pixel)
                .collect::<Vec<_>>(),
        );
    }
}

#[test]
fn registration_is_nothing_but_half_a_pixel() {
    let heights = |registration| grid([8, 8], [3.0, -3.0], [1.0, -1.0], registration);
    let image = |registration| noise(grid([40, 40], [0.0, 0.0], [0.4, -0.4], registration));
    let expected = resample(&image(Registration::Area), &heights(Registration::Area), 2).unwrap();
    for one in [Registration::Area, Registration::Point] {
        for two in [Registration::Area, Registration::Point] {
            let found = resample(&image(one), &heights(two), 2).unwrap();
            expected.assert_same_samples(&found.samples);
            assert_eq!(found.info.registration, two);
        }
    }
}

#[test]
fn texel_between_two_pixels_is_their_mean() {
    // Heights at the edges between pixels: half a pixel aside.
    let heights = grid([3, 1], [1.5, 0.0], [1.0, -1.0], Registration::Point);
    let place = grid([5, 1], [0.0, 0.0], [1.0, -1.0], Registration::Area);
    let image = image_of(place, SampleType::U8, |column, _| {
        Some([f64::from(column * column * 4); 3])
    });
    let found = resample(&image, &heights, 1).unwrap();
    let reds: Vec<f64> = texels_of(&found).map(|(_, _, pixel)| pixel[0]).collect();
    assert_eq!(reds, [10.0, 26.0, 50.0]);
}

#[test]
fn finest_patterns_do_not_alias_when_they_are_too_fine_for_texels() {
    let place = grid([200, 200], [0.0, 0.0], [1.0, -1.0], Registration::Area);
    let board = image_of(place.clone(), SampleType::U8, |column, row| {
        Some([f64::from((column + row) % 2 * 255); 3])
    });
    let stripes = image_of(place, SampleType::U8, |column, _| {
        Some([f64::from(column % 2 * 255); 3])
    });
    // Largest distance from grey that is allowed: nothing at whole ratios, and what the triangle
    // lets through at others: at most an eighth along one axis, the square of that along two.
    for (step, on_board, on_stripes) in [
        (1.5, 2.0, 15.5),
        (2.0, 0.5, 0.5),
        (2.7, 1.2, 11.5),
        (3.0, 0.7, 6.0),
        (4.0, 0.5, 0.5),
        (7.3, 0.5, 1.0),
    ] {
        let count = (180.0 / step) as u32;
        let heights = grid(
            [count, count],
            [10.3, -10.1],
            [step, -step],
            Registration::Point,
        );
        for (image, allowed) in [(&board, on_board), (&stripes, on_stripes)] {
            let found = resample(image, &heights, 1).unwrap();
            let furthest = found
                .samples
                .iter()
                .map(|n| (n - 127.5).abs())
                .fold(0.0, f64::max);
            assert!(
                furthest <= allowed + 0.5,
                "step {step}: {furthest} from grey"
            );
        }
    }
}

#[test]
fn texels_outside_the_image_are_void() {
    let heights = grid([11, 11], [0.0, 0.0], [1.0, -1.0], Registration::Point);
    // Pixels at 3.0, 3.5, ... 6.0: areas from 2.75 to 6.25.
    for (registration, inside) in [
        (Registration::Area, 2.75..=6.25),
        (Registration::Point, 3.0..=6.0),
    ] {
        let place = grid([7, 7], [3.0, -3.0], [0.5, -0.5], registration);
        let image = image_of(place, SampleType::U8, |_, _| Some([9.0; 3]));
        let found = resample(&image, &heights, 8).unwrap();
        assert!(found.info.alpha);
        for (column, row, pixel) in texels_of(&found) {
            let is_inside = [column, row]
                .iter()
                .all(|&texel| inside.contains(&(f64::from(texel) / 8.0)));
            assert_eq!(pixel[0] == 9.0, is_inside, "{column}, {row}: {pixel:?}");
        }
    }
}

#[test]
fn texel_is_void_where_most_of_its_weight_is() {
    let heights = grid([3, 1], [0.0, 0.0], [1.0, -1.0], Registration::Point);
    let place = grid([3, 1], [0.0, 0.0], [1.0, -1.0], Registration::Area);
    let image = image_of(place, SampleType::U8, |column, _| {
        (column != 1).then_some([50.0; 3])
    });
    let found = resample(&image, &heights, 4).unwrap();
    let valid: Vec<bool> = texels_of(&found)
        .map(|(_, _, pixel)| pixel[0] == 50.0)
        .collect();
    assert_eq!(
        valid,
        [true, true, true, false, false, false, true, true, true]
    );
    assert!(!found.info.alpha, "nothing said that there are voids");
}

#[test]
fn texels_are_no_coarser_than_pixels() {
    let heights = grid([5, 5], [0.0, 0.0], [30.0, -30.0], Registration::Area);
    let texels = |x: f64, y: f64| {
        texels_per_sample(
            &grid([9, 9], [0.0, 0.0], [x, -y], Registration::Area),
            &heights,
        )
    };
    assert_eq!(
        [texels(30.0, 30.0), texels(90.0, 31.0), texels(29.9, 30.0)],
        [1, 1, 2]
    );
    assert_eq!(
        [
            texels(15.0, 15.0),
            texels(15.0, 7.0),
            texels(30.0 / 7.0, 15.0)
        ],
        [2, 8, 8]
    );
    assert_eq!(
        [texels(0.4, 30.0), texels(1.0 / 1024.0, 1.0)],
        [MOST_TEXELS; 2]
    );
    assert_eq!(texels(10.0 * 0.1 * 30.0 / 4.0, 30.0), 4);
}

#[test]
fn image_rows_are_read_only_as_they_are_needed() {
    let place = grid([50, 400], [0.0, 0.0], [1.0, -1.0], Registration::Area);
    let mut info = place.clone();
    (info.bands, info.sample_type) = (3, SampleType::U8);
    let asked = Arc::new(AtomicU32::new(0));
    let counted = Arc::clone(&asked);
    let callback = move |row: u32, samples: &mut [f64]| {
        counted.store(row + 1, Ordering::Relaxed);
        samples.fill(f64::from(row % 256));
        Ok(())
    };
    let image = Box::new(RowSource::new(info, Box::new(callback)));
    let heights = grid([4, 40], [10.0, -20.0], [5.0, -5.0], Registration::Point);
    let mut resampled = Resampled::new(Path::new("image"), image, &heights, 1).unwrap();
    let mut row = [0.0; 12];
    for index in 0..40 {
        resampled.read_rows(&mut row).unwrap();
        assert_eq!(asked.load(Ordering::Relaxed), 20 + 5 * index + 5);
    }
}

#[test]
fn what_cannot_be_put_on_the_grid_is_refused() {
    let heights = grid([5, 5], [0.0, 0.0], [1.0, -1.0], Registration::Area);
    let said = |change: &dyn Fn(&mut RasterInfo, &mut RasterInfo), texels: u32| {
        let mut image = noise(grid([9, 9], [0.0, 0.0], [0.5, -0.5], Registration::Area));
        let mut heights = heights.clone();
        change(&mut image.info, &mut heights);
        resample(&image, &heights, texels).unwrap_err().to_string()
    };
    let nothing = |_: &mut RasterInfo, _: &mut RasterInfo| {};
    for texels in [0, 3, 128] {
        assert!(said(&nothing, texels).contains("a power of two up to 64"));
    }
    assert!(said(&|_, heights| heights.width = 1 << 30, 64).contains("too many"));
    assert!(said(&|image, _| image.bands = 1, 1).contains("image: 1 band; colours have three"));
    assert!(said(&|image, _| image.georeferenced = false, 1).contains("give its bounds"));
    assert!(said(&|image, _| image.geotransform[2] = 0.1, 1).contains("image: it is rotated"));
    assert!(
        said(&|_, heights| heights.geotransform[4] = 0.1, 1).contains("the heights are rotated")
    );
    let upside_down = |image: &mut RasterInfo, _: &mut RasterInfo| {
        (image.geotransform[3], image.geotransform[5]) = (-4.0, 0.5);
    };
    assert!(said(&upside_down, 1).contains("rows run from south to north"));
    let elsewhere = |image: &mut RasterInfo, _: &mut RasterInfo| image.geotransform[0] = 100.0;
    assert!(said(&elsewhere, 1).contains("does not cover any height sample"));
    let systems = |image: &mut RasterInfo, heights: &mut RasterInfo| {
        image.crs = "EPSG:4326".into();
        heights.crs = "EPSG:32613".into();
    };
    assert!(said(&systems, 1).contains("is EPSG:4326 and not EPSG:32613, that of the heights"));
}

#[test]
fn real_image_covers_the_heights_of_its_place() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
    let dem = data.join("rocky_mountain_np_dem.tif");
    let heights = open(&dem, &SourceOptions::default())
        .unwrap()
        .info()
        .clone();
    let options = SourceOptions {
        colour: true,
        bounds: Some([-106.0566, 40.0602, -105.3291, 40.6197]),
        ..SourceOptions::default()
    };
    let path = data.join("rocky_mountain_np_landsat_rgb.png");
    let mut source = open(&path, &options).unwrap();
    let (info, pixels) = (source.info().clone(), read_all(source.as_mut()).unwrap());
    let image = Raster {
        info,
        samples: pixels,
    };
    let texels = texels_per_sample(&image.info, &heights);
    assert_eq!(texels, 2);
    let found = resample(&image, &heights, texels).unwrap();
    assert_eq!(
        (found.info.width, found.info.height),
        (151 * 2 + 1, 186 * 2 + 1)
    );
    assert_eq!(
        (found.info.crs.as_str(), found.info.geographic),
        ("EPSG:4326", true)
    );
    assert!(!found.info.alpha && found.samples.iter().all(|number| !number.is_nan()));
    let corner = |column, row| found.info.sample_to_crs(column, row);
    let ([west, north], [east, south]) = (
        corner(0.0, 0.0),
        corner(
            f64::from(found.info.width) - 1.0,
            f64::from(found.info.height) - 1.0,
        ),
    );
    let in_place = texels_of(&image).filter(|&(column, row, _)| {
        let [x, y] = image.info.sample_to_crs(f64::from(column), f64::from(row));
        (west..=east).contains(&x) && (south..=north).contains(&y)
    });
    let mean = |pixels: &mut dyn Iterator<Item = [f64; 3]>| {
        let (sum, count) = pixels.fold((0.0, 0), |(sum, count), pixel| {
            (sum + pixel.iter().sum::<f64>() / 3.0, count + 1)
        });
        sum / f64::from(count)
    };
    let expected = mean(&mut in_place.map(|(_, _, pixel)| pixel));
    let found = mean(&mut texels_of(&found).map(|(_, _, pixel)| pixel));
    assert!((expected - found).abs() < 0.5, "{expected} {found}");
}
