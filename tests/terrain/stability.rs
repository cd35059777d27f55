//! Surfaces that break codecs, by every transform and coder, whole builder and back.

use crate::methods::{METHODS, round_trip};
use crate::rasters::{Raster, message};
use kimberlite::codec::Units;
use kimberlite::geo::SampleType;
use proptest::prelude::*;

/// Width, height and log2 of the cells: tiny, thin, just over a power of two.
#[derive(Clone, Copy, Debug)]
struct Shape {
    width: u32,
    height: u32,
    cells_log2: u32,
}

fn shapes() -> impl Strategy<Value = Shape> {
    let sizes = prop_oneof![
        1 => Just((2u32, 2u32)),
        1 => Just((3, 17)),
        1 => Just((33, 2)),
        1 => Just((17, 17)),
        1 => Just((66, 65)),
        1 => Just((130, 3)),
        4 => (2u32..90, 2u32..90),
    ];
    let cells = prop_oneof![4 => Just(4u32), 2 => Just(5), 1 => Just(6), 1 => Just(7)];
    (sizes, cells).prop_map(|((width, height), cells_log2)| Shape {
        width,
        height,
        cells_log2,
    })
}

/// Types with the ends of a range that is to be filled: their own, or for floats one of whole numbers.
const INTEGERS: [(SampleType, f64, f64); 8] = [
    (SampleType::I16, -32768.0, 32767.0),
    (SampleType::I32, -2_147_483_648.0, 2_147_483_647.0),
    (SampleType::I32, -2_147_483_648.0, -1_400_000_000.0),
    (SampleType::I32, 1_400_000_000.0, 2_147_483_647.0),
    (SampleType::U32, 0.0, 4_294_967_295.0),
    (SampleType::U8, 0.0, 255.0),
    (SampleType::I16, -8191.0, 8192.0),
    (SampleType::I16, 100.0, 104.0),
];

fn types() -> impl Strategy<Value = (SampleType, f64, f64)> {
    prop::sample::select(&INTEGERS[..])
}

/// A number from 0 to 1 for each sample, the same for the same seed.
fn noise(seed: u64, column: u32, row: u32) -> f64 {
    let mut hash = seed ^ u64::from(column) << 32 ^ u64::from(row);
    for shift in [30, 27, 31] {
        hash = (hash ^ (hash >> shift)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// A raster of `share`, from 0 to 1 by column and row, of the range from `low` to `high`.
fn raster(
    shape: Shape,
    (sample_type, low, high): (SampleType, f64, f64),
    share: impl Fn(u32, u32) -> f64,
) -> Raster {
    let samples = (0..shape.width * shape.height).map(|index| {
        let share = share(index % shape.width, index / shape.width);
        if share.is_nan() {
            return f64::NAN;
        }
        (low + share.clamp(0.0, 1.0) * (high - low)).round()
    });
    Raster::new(shape.width, shape.height, sample_type, samples.collect())
}

/// Builds by every method, lossless and at one error of three: 1, a part of the range, and beyond the range.
fn check(raster: &Raster, cells_log2: u32, turn: usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    let valid = raster.samples.iter().filter(|sample| !sample.is_nan());
    let [low, high] = valid.fold([f64::MAX, f64::MIN], |[low, high], &sample| {
        [low.min(sample), high.max(sample)]
    });
    let range = (high - low).max(0.0);
    let lossy = [1.0, (range / 50.0).floor().max(3.0), 2.0 * range + 1.0][turn % 3];
    for method in METHODS {
        for error in [0.0, lossy] {
            round_trip(raster, &path, &method.options(error, cells_log2));
        }
    }
}

/// By how much a point is on the right of a line through a place of the raster, at an angle.
fn beyond(shape: Shape, angle: f64, place: [f64; 2], column: u32, row: u32) -> f64 {
    let x = f64::from(column) - place[0] * f64::from(shape.width);
    let y = f64::from(row) - place[1] * f64::from(shape.height);
    x * angle.cos() + y * angle.sin()
}

fn places() -> impl Strategy<Value = [f64; 2]> {
    [0.1..0.9, 0.1..0.9]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn white_noise_comes_back(shape in shapes(), turn in 0usize..3, of in types(), seed in any::<u64>()) {
        check(&raster(shape, of, |c, r| noise(seed, c, r)), shape.cells_log2, turn);
    }

    #[test]
    fn a_constant_comes_back(shape in shapes(), turn in 0usize..3, of in types(), share in 0.0f64..=1.0) {
        check(&raster(shape, of, |_, _| share), shape.cells_log2, turn);
    }

    #[test]
    fn one_spike_comes_back(shape in shapes(), turn in 0usize..3, of in types(), place in places(), up in any::<bool>()) {
        let spike = [
            (place[0] * f64::from(shape.width)) as u32,
            (place[1] * f64::from(shape.height)) as u32,
        ];
        let share = |c, r| f64::from(u8::from(([c, r] == spike) == up));
        check(&raster(shape, of, share), shape.cells_log2, turn);
    }

    #[test]
    fn alternating_extremes_overflow_nothing(
        shape in shapes(),
        turn in 0usize..3,
        of in types(),
        period in 1u32..4,
        across in 0u32..3,
    ) {
        let share = |c: u32, r: u32| f64::from([c, r, c + r][across as usize] / period % 2);
        check(&raster(shape, of, share), shape.cells_log2, turn);
    }

    #[test]
    fn roofs_with_edges_at_45_degrees_come_back(
        shape in shapes(),
        turn in 0usize..3,
        of in types(),
        place in places(),
        pitch in 0.001f64..0.2,
    ) {
        let (eighth, quarter) = (std::f64::consts::FRAC_PI_4, std::f64::consts::FRAC_PI_2);
        let share = |c, r| {
            let [one, other] = [eighth, eighth + quarter].map(|a| beyond(shape, a, place, c, r).abs());
            if one.max(other) > 14.0 { 0.1 } else { 0.9 - pitch * one }
        };
        check(&raster(shape, of, share), shape.cells_log2, turn);
    }

    #[test]
    fn a_checkerboard_over_hills_comes_back(
        shape in shapes(),
        turn in 0usize..3,
        of in types(),
        height in 0.0f64..0.5,
        seed in any::<u64>(),
    ) {
        let share = |c: u32, r: u32| {
            let hill = (f64::from(c) * 0.1).sin() * (f64::from(r) * 0.13).cos();
            0.25 + 0.2 * hill + height * f64::from((c + r) % 2) + 0.01 * noise(seed, c, r)
        };
        check(&raster(shape, of, share), shape.cells_log2, turn);
    }

    #[test]
    fn heights_that_are_few_or_far_between_come_back(
        shape in shapes(),
        turn in 0usize..3,
        seed in any::<u64>(),
        gap in prop_oneof![Just(7i32), Just(2), Just(1000), 3..40i32],
        levels in 2u32..200,
        void_share in prop_oneof![Just(0.0), Just(0.2)],
    ) {
        let samples = (0..shape.width * shape.height).map(|index| {
            let (c, r) = (index % shape.width, index / shape.width);
            let hill = (f64::from(c) * 0.07).sin() * (f64::from(r) * 0.05).cos();
            let share = 0.5 + 0.4 * hill + 0.1 * noise(seed, c, r);
            let is_void = noise(seed ^ 5, c, r) < void_share;
            if is_void { f64::NAN } else { (share * f64::from(levels)).floor() * f64::from(gap) - 50.0 }
        });
        let raster = Raster::new(shape.width, shape.height, SampleType::I32, samples.collect());
        check(&raster, shape.cells_log2, turn);
    }

    #[test]
    fn floats_that_jump_keep_their_error(
        shape in shapes(),
        seed in any::<u64>(),
        magnitude in -3i32..9,
        share in 1e-5f64..3.0,
        kind in 0u32..4,
    ) {
        let scale = 10f64.powi(magnitude);
        let samples = (0..shape.width * shape.height).map(|index| {
            let (c, r) = (index % shape.width, index / shape.width);
            let noise = noise(seed, c, r);
            let height = match kind {
                0 => noise,
                1 => f64::from((c + r) % 2),
                2 => f64::from(u8::from(3 * c > 2 * r)) + 0.01 * noise,
                _ => 0.7,
            };
            if noise < 0.05 { f64::NAN } else { f64::from((scale * height) as f32) }
        });
        let raster = Raster::new(shape.width, shape.height, SampleType::F32, samples.collect());
        let folder = tempfile::tempdir().unwrap();
        for method in METHODS {
            round_trip(
                &raster,
                &folder.path().join("a.kmb"),
                &method.options(share * scale, shape.cells_log2),
            );
        }
    }
    #[test]
    fn floats_of_no_unit_are_told_the_least_error_that_works(
        shape in shapes(),
        seed in any::<u64>(),
        single in any::<bool>(),
        magnitude in -30i32..30,
        shift in prop_oneof![Just(0.0), Just(1.0), Just(-1000.0)],
        nodata in prop_oneof![Just(None), Just(Some(0.0))],
    ) {
        let (sample_type, scale) = (
            if single { SampleType::F32 } else { SampleType::F64 },
            10f64.powi(magnitude),
        );
        let samples = (0..shape.width * shape.height).map(|index| {
            let height = scale * (noise(seed, index, 0) - 0.5 + shift);
            if single { f64::from(height as f32) } else { height }
        });
        let mut raster = Raster::new(shape.width, shape.height, sample_type, samples.collect());
        raster.info.nodata = nodata;
        let divides = |&unit: &f64| {
            let samples = raster.samples.iter();
            samples.copied().all(|sample| Units::is_multiple(sample_type, sample, unit))
        };
        prop_assume!(!Units::whole_units().any(|unit| divides(&unit)));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        for method in METHODS {
            let text = message(raster.build_with(&path, &method.options(0.0, shape.cells_log2)));
            let (what, least) = text.rsplit_once(" above ").unwrap();
            prop_assert!(what.contains("multiples of one unit"), "{}", text);
            let enough = least.parse::<f64>().unwrap().next_up();
            let options = method.options(enough, shape.cells_log2);
            if options.rms_error.is_none() {
                round_trip(&raster, &path, &options);
            }
        }
    }
}

proptest! {
    // Each of them goes through all directions, or all patterns.
    #![proptest_config(ProptestConfig::with_cases(2))]

    #[test]
    fn a_cliff_in_any_direction_comes_back(
        of in types(),
        turned in prop_oneof![Just(0.0), 0.0..1.0],
        place in places(),
        slope in 0.0f64..0.01,
    ) {
        let shape = Shape { width: 38, height: 41, cells_log2: 4 };
        for turn in 0..16 {
            let angle = (turn as f64 + turned) * std::f64::consts::TAU / 16.0;
            let share = |c, r| {
                let beyond = beyond(shape, angle, place, c, r);
                let side = if beyond > 0.0 { 0.8 } else { 0.2 };
                side + slope * beyond.clamp(-15.0, 15.0)
            };
            check(&raster(shape, of, share), shape.cells_log2, turn);
        }
    }

    #[test]
    fn voids_of_every_pattern_on_rough_ground_are_exact(
        shape in shapes(),
        turn in 0usize..3,
        of in types(),
        place in places(),
        seed in any::<u64>(),
    ) {
        let shape = Shape {
            width: shape.width.min(50),
            height: shape.height.min(50),
            ..shape
        };
        let at = [
            (place[0] * f64::from(shape.width)) as u32,
            (place[1] * f64::from(shape.height)) as u32,
        ];
        let centre = 1 << shape.cells_log2.min(5) >> 1;
        let is_void = |pattern: u32, c: u32, r: u32| match pattern {
            0 => [c, r] == at,
            1 => [c, r] != at,
            2 => (c + r).is_multiple_of(2),
            3 => !(c + r).is_multiple_of(2),
            4 => true,
            5 => c == centre || r == centre,
            6 => c == r || c + r == 2 * centre,
            _ => noise(seed ^ 3, c, r) < 0.3,
        };
        for pattern in 0..8 {
            let share = |c, r| match is_void(pattern, c, r) {
                true => f64::NAN,
                false => noise(seed, c / 3, r / 2),
            };
            check(&raster(shape, of, share), shape.cells_log2, turn);
        }
    }
}

#[test]
fn heights_next_to_the_ends_of_32_bits_keep_their_error() {
    let shape = Shape {
        width: 40,
        height: 37,
        cells_log2: 4,
    };
    for of in INTEGERS.into_iter().filter(|of| of.0 == SampleType::I32) {
        for turn in 0..3 {
            let raster = raster(shape, of, |c, r| noise(7, c, r));
            check(&raster, shape.cells_log2, turn);
        }
    }
}
