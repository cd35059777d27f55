//! Diamonds without a repository: what comes back, how long they can be, and what the standard model costs.

use std::path::Path;

use kimberlite::build::source::{SourceOptions, open};
use kimberlite::codec::{
    BlockCodec, DiamondCodec, DiamondOptions, DiamondView, Fit, Matrix, Outline, ROUNDS,
    SymbolCoder, Trainer,
};
use kimberlite::lattice::Lattice;
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
            let codec = BlockCodec::new(64, true, transform)
                .with_symbols(SymbolCoder::new(64, quantiser, true, true));
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

#[test]
#[ignore = "measures"]
fn measure() {
    for (name, unit, bounds) in [
        ("puget_sound_1025_decimetres.png", 1.0, [0, 2, 10, 40, 80]),
        ("srtm3_N49W123.tif", 1.0, [0, 1, 2, 4, 8]),
        ("srtm3_S33W071.tif", 1.0, [0, 1, 2, 4, 8]),
        ("rocky_mountain_np_dem.tif", 1.0, [0, 1, 2, 4, 8]),
        ("delft_dsm_0.5m_1.tif", 0.01, [0, 1, 5, 10, 25]),
    ] {
        for bound in bounds {
            let found = diamonds(name, unit, bound, 2);
            let range = [-1 << 20, 1 << 20];
            let gamma = bits(&codec(bound, range, false), &found);
            let mut coder = codec(bound, range, true);
            let standard = bits(&coder, &found);
            let views: Vec<DiamondView> = found.iter().map(view).collect();
            coder.train(&views).unwrap();
            let model =
                8.0 * coder.model_bytes().unwrap().len() as f64 / (found.len() * 4096) as f64;
            let trained = bits(&coder, &found);
            eprintln!(
                "{name} {bound}: {} gamma {gamma:.3} standard {standard:.3} trained {trained:.3} + {model:.3}, ratio {:.3}",
                found.len(),
                standard / trained
            );
        }
    }
}
