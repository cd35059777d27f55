//! Diamonds without a repository: what comes back, how long they can be, and what the standard model costs.

use std::path::Path;

use kimberlite::build::source::{InMemory, SourceOptions, open};
use kimberlite::build::{BuildOptions, build, longest_repository};
use kimberlite::codec::{
    BlockCodec, DiamondCodec, DiamondOptions, DiamondView, Fit, Matrix, Outline, ROUNDS,
    SymbolCoder, Trainer,
};
use kimberlite::cut::Terrain;
use kimberlite::geo::{RasterInfo, SampleType};
use kimberlite::lattice::Lattice;
use kimberlite::store::{Access, EntropyKind};
use kimberlite::tool::{open_packed, pack, unpack};
use kimberlite::transform::{Quantiser, Target, TransformKind};

/// Vertices and centres.
type Diamond = (Matrix, Matrix);

fn view((vertices, centres): &Diamond) -> DiamondView<'_> {
    DiamondView { vertices, centres }
}

/// The whole diamonds of some of a raster's finest levels, in a grain of `unit`, with vertices as a bound of `bound` leaves
/// them.
fn diamonds(name: &str, unit: f64, bound: i32, levels: u32) -> Vec<Diamond> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name);
    let mut source = open(&path, &SourceOptions::default()).unwrap();
    let (width, height) = (source.info().width, source.info().height);
    let mut samples = vec![0.0; width as usize * height as usize];
    source.read_rows(&mut samples).unwrap();
    let lattice = Lattice::new(width, height, 6).unwrap();
    let (cells, step) = (lattice.cells(), f64::from(2 * bound + 1));
    let at = |[column, row]: [i64; 2]| samples[row as usize * width as usize + column as usize];
    let mut found = Vec::new();
    for level in lattice.levels() - levels..lattice.levels() {
        for diamond in lattice.diamonds(level) {
            if !lattice.is_inside(diamond) {
                continue;
            }
            let place = lattice.placement(diamond);
            let side = cells + 1;
            let vertices: Vec<f64> = (0..side * side)
                .map(|index| at(place.vertex(index % side, index / side)))
                .collect();
            let centres: Vec<f64> = (0..cells * cells)
                .map(|index| at(place.centre(index % cells, index / cells)))
                .collect();
            if vertices
                .iter()
                .chain(&centres)
                .any(|sample| sample.is_nan())
            {
                continue;
            }
            let coarse = |sample: &f64| ((sample / unit / step).round() * step) as i32;
            let whole = |sample: &f64| (sample / unit).round() as i32;
            let matrix = |values: Box<[i32]>| Matrix {
                values,
                valid: None,
            };
            found.push((
                matrix(vertices.iter().map(coarse).collect()),
                matrix(centres.iter().map(whole).collect()),
            ));
        }
    }
    found
}

#[test]
#[ignore = "prints the constants of src/codec/standard.rs"]
fn standard_weights() {
    let whole = Outline {
        level: 0,
        codable: None,
        absent: None,
    };
    let files = [
        ("puget_sound_1025_decimetres.png", 1.0, [0, 10, 40]),
        ("srtm3_N49W123.tif", 1.0, [0, 1, 4]),
        ("srtm3_S33W071.tif", 1.0, [0, 1, 4]),
        ("rocky_mountain_np_dem.tif", 1.0, [0, 1, 4]),
        ("jacksboro_fault_srtm3.tif", 1.0, [0, 1, 4]),
        ("delft_dsm_0.5m_1.tif", 0.01, [0, 5, 25]),
    ];
    let mut sets = Vec::new();
    for (name, unit, bounds) in files {
        for bound in bounds {
            let found = diamonds(name, unit, bound, 2);
            let range = [-1 << 20, 1 << 20];
            let quantiser = Quantiser::new(bound, range[0], range[1]);
            let transform = TransformKind::Interpolating.transform(64, bound, range);
            let codec = BlockCodec::new(64, true, vec![transform])
                .with_symbols(vec![SymbolCoder::new(64, quantiser, true, true)]);
            eprintln!("{name} {bound}: {}", found.len());
            sets.push((codec, found));
        }
    }
    let mut trainers = [Trainer::new()];
    for round in 0..ROUNDS - 1 {
        let mut all = Fit::new();
        for (codec, found) in &sets {
            for (vertices, centres) in found.iter().take(60) {
                let mut fits = [Fit::new()];
                let target = Target {
                    vertices: &vertices.values,
                    centres: &centres.values,
                };
                codec.show(&trainers, &mut fits, vertices, &whole, target, None);
                all.merge(&fits[0]);
            }
        }
        trainers[0].learn(&all);
        let weights = trainers[0].weights();
        let prediction: Vec<i16> = weights.prediction.iter().flat_map(|pair| pair[0]).collect();
        eprintln!(
            "round {round}: {prediction:?} {:?}",
            weights.activity.as_flattened()
        );
    }
}

fn codec(bound: i32, range: [i32; 2], in_contexts: bool) -> DiamondCodec {
    let options = DiamondOptions {
        cells_log2: 6,
        bound,
        range,
        in_contexts,
    };
    DiamondCodec::new(options).unwrap()
}

/// Bits a centre of some diamonds, which come back within the bound.
fn bits(codec: &DiamondCodec, found: &[Diamond]) -> f64 {
    let mut bytes = 0;
    for diamond in found {
        let block = codec.encode(view(diamond)).unwrap();
        assert!(block.len() <= codec.longest());
        let decoded = codec.decode(&diamond.0, &block).unwrap();
        assert_eq!(decoded.valid, diamond.1.valid);
        let bound = codec.options().bound as u32;
        for (index, (own, back)) in diamond.1.values.iter().zip(&decoded.values).enumerate() {
            assert!(!diamond.1.is_valid(index) || own.abs_diff(*back) <= bound);
        }
        bytes += block.len();
    }
    8.0 * bytes as f64 / (found.len() * 4096) as f64
}

/// Numbers that look random, the same everywhere.
fn noise(seed: u64) -> impl FnMut() -> i32 {
    let mut state = seed | 1;
    move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as i32
    }
}

/// A matrix of noise of so many bits, every eighth entry void where there are voids.
fn noisy(seed: u64, count: usize, bits: u32, has_voids: bool) -> Matrix {
    let mut next = noise(seed);
    let values = (0..count).map(|_| next() >> (32 - bits)).collect();
    let valid = (0..count).map(|_| u8::from(!has_voids || next() & 7 != 0));
    Matrix::new(values, valid.collect())
}

fn noisy_diamond(seed: u64, cells: usize, bits: u32, has_voids: bool) -> Diamond {
    let corners = (cells + 1) * (cells + 1);
    (
        noisy(seed, corners, bits, has_voids),
        noisy(seed ^ 99, cells * cells, bits, has_voids),
    )
}

#[test]
fn the_standard_model_costs_little_more_than_a_trained_one() {
    let found = diamonds("puget_sound_1025_decimetres.png", 1.0, 10, 2);
    let mut coder = codec(10, [0, 65535], true);
    let standard = bits(&coder, &found);
    let views: Vec<DiamondView> = found.iter().map(view).collect();
    coder.train(&views).unwrap();
    let trained = bits(&coder, &found);
    let gamma = bits(&codec(10, [0, 65535], false), &found);
    eprintln!("standard {standard:.3}, trained {trained:.3}, gamma {gamma:.3}");
    assert!(standard < 1.05 * trained && standard < 0.8 * gamma);
}

#[test]
fn a_trained_model_is_the_same_after_its_bytes() {
    let found: Vec<Diamond> = (0..4)
        .map(|seed| noisy_diamond(seed, 64, 6, false))
        .collect();
    let mut coder = codec(1, [-64, 63], true);
    let mut other = codec(1, [-64, 63], true);
    assert!(coder.model_bytes().is_none());
    let views: Vec<DiamondView> = found.iter().map(view).collect();
    coder.train(&views).unwrap();
    other.set_model(&coder.model_bytes().unwrap()).unwrap();
    for diamond in &found {
        let block = coder.encode(view(diamond)).unwrap();
        assert_eq!(other.encode(view(diamond)).unwrap(), block);
        assert_eq!(
            other.decode(&diamond.0, &block).unwrap(),
            coder.decode(&diamond.0, &block).unwrap()
        );
    }
}

#[test]
fn noise_of_any_size_comes_back_within_bound_and_length() {
    for (cells_log2, bits, bound) in [
        (4, 32, 0),
        (6, 32, 0),
        (7, 32, 1000),
        (5, 12, 3),
        (6, 1, 0),
        (4, 20, i32::MAX / 2),
    ] {
        for (in_contexts, has_voids) in [(true, true), (true, false), (false, true), (false, false)]
        {
            let range = [i32::MIN >> (32 - bits), i32::MAX >> (32 - bits)];
            let options = DiamondOptions {
                cells_log2,
                bound,
                range,
                in_contexts,
            };
            let coder = DiamondCodec::new(options).unwrap();
            let diamond = noisy_diamond(7, 1 << cells_log2, bits, has_voids);
            self::bits(&coder, &[diamond]);
        }
    }
}

#[test]
fn voids_everywhere_and_nowhere_need_no_bytes() {
    let coder = codec(0, [0, 100], true);
    let flat =
        |count: usize, valid: u8| Matrix::new(vec![50; count].into(), vec![valid; count].into());
    for valid in [0, 1] {
        let diamond = (flat(65 * 65, valid), flat(64 * 64, valid));
        assert!(coder.encode(view(&diamond)).unwrap().is_empty());
        assert_eq!(coder.decode(&diamond.0, &[]).unwrap(), diamond.1);
    }
    let island = (flat(65 * 65, 0), flat(64 * 64, 1));
    let block = coder.encode(view(&island)).unwrap();
    assert_eq!(coder.decode(&island.0, &block).unwrap(), island.1);
}

#[test]
fn damaged_diamonds_give_errors_or_heights_within_the_range() {
    for in_contexts in [true, false] {
        let coder = codec(2, [-500, 500], in_contexts);
        let diamond = noisy_diamond(3, 64, 9, true);
        let block = coder.encode(view(&diamond)).unwrap();
        let mut next = noise(17);
        for round in 0..300 {
            let mut damaged = block.clone();
            damaged.truncate(next() as u32 as usize % (block.len() + 1));
            for _ in 0..round % 4 {
                if let Some(last) = damaged.len().checked_sub(1) {
                    let place = next() as u32 as usize % (last + 1);
                    damaged[place] = next() as u8;
                }
            }
            if let Ok(decoded) = coder.decode(&diamond.0, &damaged) {
                assert!(
                    decoded
                        .values
                        .iter()
                        .all(|height| (-500..=500).contains(height))
                );
            }
        }
    }
}

#[test]
fn heights_outside_the_range_and_other_sizes_are_refused() {
    let coder = codec(0, [-10, 10], true);
    let (vertices, centres) = noisy_diamond(1, 64, 4, false);
    let mut wild = centres.clone();
    wild.values[77] = 11;
    assert!(
        coder
            .encode(DiamondView {
                vertices: &vertices,
                centres: &wild
            })
            .is_err()
    );
    wild.valid = Some((0..64 * 64).map(|index| u8::from(index != 77)).collect());
    assert!(
        coder
            .encode(DiamondView {
                vertices: &vertices,
                centres: &wild
            })
            .is_ok()
    );
    assert!(
        coder
            .encode(DiamondView {
                vertices: &centres,
                centres: &centres
            })
            .is_err()
    );
    assert!(coder.decode(&centres, &[]).is_err());
}

#[test]
fn no_raster_needs_more_bytes_than_its_bound() {
    for (width, height, cells_log2) in [(2, 2, 4), (130, 67, 4), (300, 200, 6)] {
        for transform in [
            TransformKind::Interpolating,
            TransformKind::Lifted,
            TransformKind::TwoStage,
        ] {
            for entropy in [EntropyKind::Rans, EntropyKind::Gamma] {
                let options = BuildOptions {
                    transform,
                    entropy,
                    cells_log2,
                    threads: 1,
                    ..BuildOptions::default()
                };
                let mut next = noise(u64::from(width));
                let count = (width * height) as usize;
                let samples: Vec<i32> = (0..count)
                    .map(|_| if next() & 3 == 0 { 12345 } else { next() })
                    .collect();
                let mut info = RasterInfo::new(width, height, SampleType::I32);
                info.nodata = Some(12345.0);
                let (bytes, report) = pack(info, &samples, &options).unwrap();
                let bound = longest_repository(width, height, &options).unwrap();
                assert!(bytes.len() as u64 <= bound && report.max_error == 0.0);
                let mut back = vec![0; count];
                unpack(&open_packed(&bytes).unwrap(), &mut back).unwrap();
                assert_eq!(back, samples);
            }
        }
    }
}

#[test]
fn packed_bytes_in_a_file_are_a_repository() {
    let samples: Vec<f32> = (0..90 * 70)
        .map(|index| (index % 90) as f32 * 0.5)
        .collect();
    let info = RasterInfo::new(90, 70, SampleType::F32);
    let options = BuildOptions {
        max_error: 0.1,
        cells_log2: 4,
        ..BuildOptions::default()
    };
    let (bytes, _) = pack(info.clone(), &samples, &options).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (written, built) = (folder.path().join("a.kmb"), folder.path().join("b.kmb"));
    std::fs::write(&written, &bytes).unwrap();
    let opened = Terrain::open(&written, Access::Map).unwrap();
    let mut back = vec![0f32; samples.len()];
    unpack(&opened, &mut back).unwrap();
    assert!(
        samples
            .iter()
            .zip(&back)
            .all(|(own, back)| (own - back).abs() <= 0.1)
    );
    let mut source = InMemory::new(info, &samples).unwrap();
    build(&mut source, &options, &built, &mut |_, _| true).unwrap();
    assert_eq!(std::fs::read(&built).unwrap(), bytes);
}
