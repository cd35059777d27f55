//! Trained tables and prediction: one output, tables taken from elsewhere, what adapting saves, damage.

use crate::methods::{METHODS, Method, round_trip};
use crate::rasters::{Raster, decode, max_difference, message, some_error};
use crate::round_trip::rasters;
use kimberlite::Error;
use kimberlite::build::source::{SourceOptions, open};
use kimberlite::build::{BuildOptions, build};
use kimberlite::codec::Model;
use kimberlite::cut::{DiamondSource, Terrain, Window, read_window};
use kimberlite::geo::SampleType;
use kimberlite::store::{Access, EntropyKind, TransformKind};
use proptest::prelude::*;
use std::path::Path;

fn in_contexts() -> impl Iterator<Item = Method> {
    let all = METHODS.into_iter();
    all.filter(|method| method.entropy == EntropyKind::Rans)
}

fn tables_of(path: &Path) -> Model {
    let terrain = Terrain::open(path, Access::Map).unwrap();
    terrain.model().unwrap().clone()
}

/// Slopes and noise of whole numbers.
fn ground(width: u32, height: u32, roughness: u32) -> Raster {
    let samples = (0..width * height).map(|index| {
        let (c, r) = (index % width, index / width);
        let noise =
            (c.wrapping_mul(7919) ^ r.wrapping_mul(104_729)).wrapping_mul(2_654_435_761) >> 20;
        let hill = 900.0 * (f64::from(c) * 0.05).sin() * (f64::from(r) * 0.04).cos();
        (hill + f64::from(noise % roughness)).round()
    });
    Raster::new(width, height, SampleType::I16, samples.collect())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn one_two_and_three_threads_give_the_same_bytes(raster in rasters(), cells_log2 in 4u32..7) {
        let folder = tempfile::tempdir().unwrap();
        let error = some_error(&raster);
        for method in in_contexts() {
            let files = [1, 2, 3].map(|threads| {
                let path = folder.path().join(format!("{threads}.kmb"));
                let options = BuildOptions { threads, ..method.options(error, cells_log2) };
                build(&mut raster.source(), &options, &path, &mut |_, _| true).unwrap();
                std::fs::read(&path).unwrap()
            });
            prop_assert!(files[0] == files[1] && files[1] == files[2], "{:?}", method);
        }
    }

    #[test]
    fn a_rasters_own_tables_give_its_own_file(raster in rasters(), cells_log2 in 4u32..7) {
        let folder = tempfile::tempdir().unwrap();
        let [trained, given] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
        let error = some_error(&raster);
        for method in in_contexts() {
            let options = method.options(error, cells_log2);
            let first = round_trip(&raster, &trained, &options);
            let options = BuildOptions { tables: Some(tables_of(&trained)), ..options };
            let second = round_trip(&raster, &given, &options);
            prop_assert!(second.bytes <= first.bytes + first.bytes / 50, "{:?}", method);
            let [first, second] = [&trained, &given].map(|path| decode(path, Access::Map).unwrap());
            prop_assert_eq!(max_difference(&first, &second), 0.0);
        }
    }

    #[test]
    fn tables_of_other_ground_keep_every_promise(
        raster in rasters(),
        roughness in prop_oneof![Just(1u32), Just(3), Just(3000)],
        is_lossless in any::<bool>(),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let [known, path] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
        let (width, height) = (raster.info.width, raster.info.height);
        let other = ground(width, height, roughness);
        let is_lossless = is_lossless && raster.info.sample_type.is_integer();
        let error = if is_lossless { 0.0 } else { some_error(&raster) };
        for method in in_contexts() {
            other.build_with(&known, &method.options(0.0, 4)).unwrap();
            let tables = Some(tables_of(&known));
            round_trip(&raster, &path, &BuildOptions { tables, ..method.options(error, 4) });
        }
    }
}

#[test]
fn tables_of_another_shape_or_transform_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [known, path] = ["a.kmb", "b.kmb"].map(|name| folder.path().join(name));
    let [small, large] = [40, 200].map(|width| ground(width, 30, 9));
    let refused = |from: Method, of: &Raster, to: Method, expected: &str| {
        of.build_with(&known, &from.options(0.0, 4)).unwrap();
        let tables = Some(tables_of(&known));
        let options = BuildOptions {
            tables,
            ..to.options(0.0, 4)
        };
        let text = message(small.build_with(&path, &options));
        assert!(text.contains(expected), "{text}");
        assert!(!path.exists());
    };
    let methods: Vec<Method> = in_contexts().collect();
    let [adaptive, fixed, lifted, _, two_stage, _] = methods[..] else {
        panic!("six methods have tables")
    };
    for method in in_contexts() {
        refused(method, &large, method, "of 8 levels, and this raster has 4");
    }
    let pairs = [
        (adaptive, two_stage),
        (fixed, two_stage),
        (two_stage, adaptive),
        (two_stage, lifted),
    ];
    for (from, to) in pairs {
        refused(from, &small, to, "those of another transform");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Where the ground is smooth or the error large, trained weights would cost more than they save.
    #[test]
    fn trained_prediction_takes_no_more_bytes_than_the_fixed_rule(
        width in 100u32..500,
        roughness in prop_oneof![Just(1u32), Just(3), Just(60)],
        max_error in prop_oneof![Just(0.0), Just(1.0), Just(20.0), Just(300.0)],
    ) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        let raster = ground(width, 300, roughness);
        let [trained, fixed] = [true, false].map(|adaptive| {
            let adaptive = Some(adaptive);
            let options = BuildOptions { max_error, adaptive, ..BuildOptions::default() };
            round_trip(&raster, &path, &options).bytes
        });
        prop_assert!(trained <= fixed, "{} against {}", trained, fixed);
    }
}

/// Bytes of a file of `data/` by the fixed rule, and by trained prediction.
fn bytes_of(name: &str, transform: TransformKind, max_error: f64) -> [u64; 2] {
    let input = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("data")
        .join(name);
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.kmb");
    let bytes = [false, true].map(|adaptive| {
        let mut source = open(&input, &SourceOptions::default()).unwrap();
        let options = BuildOptions {
            transform,
            max_error,
            adaptive: Some(adaptive),
            ..BuildOptions::default()
        };
        let report = build(source.as_mut(), &options, &output, &mut |_, _| true).unwrap();
        assert!(report.max_error <= max_error);
        report.bytes
    });
    println!(
        "{name} at {max_error}: {} bytes by the fixed rule, {} by trained prediction",
        bytes[0], bytes[1]
    );
    bytes
}

#[test]
fn adapting_saves_in_a_city_and_costs_next_to_nothing_on_natural_ground() {
    let [fixed, adaptive] = bytes_of("delft_dsm_0.5m_1.tif", TransformKind::Interpolating, 0.1);
    assert!(100 * adaptive <= 92 * fixed, "{adaptive} against {fixed}");
    for (name, transform, max_error) in [
        (
            "puget_sound_1025_decimetres.png",
            TransformKind::Interpolating,
            10.0,
        ),
        ("srtm3_N49W123.tif", TransformKind::Interpolating, 2.0),
        ("srtm3_S33W071.tif", TransformKind::Interpolating, 2.0),
        ("srtm3_S33W071.tif", TransformKind::TwoStage, 0.0),
        (
            "jacksboro_fault_srtm3.tif",
            TransformKind::Interpolating,
            0.0,
        ),
    ] {
        let [fixed, adaptive] = bytes_of(name, transform, max_error);
        assert!(
            1000 * adaptive <= 1005 * fixed,
            "{name}: {adaptive} against {fixed}"
        );
    }
}

/// A file, and where its parts are.
struct File(Vec<u8>);

impl File {
    fn of(raster: &Raster, options: &BuildOptions) -> File {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        raster.build_with(&path, options).unwrap();
        File(std::fs::read(&path).unwrap())
    }

    fn u64_at(&self, offset: usize) -> usize {
        let bytes = self.0[offset..offset + 8].try_into().unwrap();
        u64::from_le_bytes(bytes) as usize
    }

    fn put_checksum(&mut self, of: std::ops::Range<usize>, at: usize) {
        let checksum = crc32fast::hash(&self.0[of]);
        self.0[at..at + 4].copy_from_slice(&checksum.to_le_bytes());
    }

    fn tables(&self) -> std::ops::Range<usize> {
        self.u64_at(240)..self.u64_at(240) + self.u64_at(248)
    }

    /// Makes the checksums of tables and header right again.
    fn seal_tables(&mut self) {
        self.put_checksum(self.tables(), 296);
        self.put_checksum(0..300, 300);
    }

    fn blocks(&self) -> std::ops::Range<usize> {
        self.u64_at(272)..self.u64_at(272) + self.u64_at(280)
    }

    /// Makes the checksums of all blocks and pages right again.
    fn seal_blocks(&mut self) {
        let (count, mut page) = (self.u64_at(192), self.u64_at(256));
        let mut block = self.u64_at(272);
        let unit = usize::from(self.0[26]);
        for first in (0..count).step_by(64) {
            let records = (count - first).min(64);
            for group in 0..records.div_ceil(8) {
                let start = block;
                for record in 8 * group..(8 * group + 8).min(records) {
                    let length = &self.0[page + 8 + 2 * record..][..2];
                    block += unit * usize::from(u16::from_le_bytes(length.try_into().unwrap()));
                }
                self.put_checksum(start..block, page + 8 + 5 * records + 4 * group);
            }
            let end = page + 8 + 5 * records + 4 * records.div_ceil(8);
            self.put_checksum(page..end, end);
            page = end + 4;
        }
    }

    /// Opens the file and decodes all of it; whether both went well. Panics on other errors than damage.
    fn is_read(&self) -> bool {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.kmb");
        std::fs::write(&path, &self.0).unwrap();
        let read = || {
            let terrain = Terrain::open(&path, Access::Map)?;
            let info = terrain.raster_info();
            let (width, height) = (info.width, info.height);
            let window = Window {
                column: 0,
                row: 0,
                width,
                height,
            };
            let mut samples = vec![0.0; (width * height) as usize];
            read_window(&terrain, terrain.lattice().levels(), window, &mut samples)
        };
        match read() {
            Ok(_) => true,
            Err(Error::Damaged { .. }) => false,
            Err(error) => panic!("{error}"),
        }
    }
}

fn file_of(method: Method, listed: bool) -> File {
    let mut raster = ground(150, 90, 9);
    for sample in raster.samples.iter_mut().step_by(13) {
        *sample = f64::NAN;
    }
    if listed {
        // Few heights, seven units apart.
        let sparse = |sample: &mut f64| *sample = 7.0 * (*sample / 20.0).floor();
        raster.samples.iter_mut().for_each(sparse);
    }
    File::of(&raster, &method.options(0.0, 4))
}

fn damages() -> impl Strategy<Value = Vec<(prop::sample::Index, u8)>> {
    prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..6)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_bytes_are_a_model_or_none(
        bytes in prop::collection::vec(any::<u8>(), 0..2000),
        zeros in 0usize..4,
        levels in 0u32..61,
        matrices in 0usize..3,
    ) {
        let bytes = [vec![0; zeros], bytes].concat();
        if let Some(model) = Model::from_bytes(&bytes, levels, matrices, 1) {
            prop_assert_eq!(model.levels(), levels);
            let again = Model::from_bytes(&model.to_bytes(), levels, matrices, 1);
            prop_assert!(again.is_some());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn a_damaged_tables_section_under_right_checksums_does_no_harm(
        damages in damages(),
        replaced in prop::option::weighted(0.3, any::<u64>()),
        cut in prop::option::weighted(0.3, any::<prop::sample::Index>()),
        method in prop::sample::select(in_contexts().collect::<Vec<_>>()),
        listed in any::<bool>(),
    ) {
        let mut file = file_of(method, listed);
        let tables = file.tables();
        if let Some(seed) = replaced {
            let mut state = seed | 1;
            for byte in &mut file.0[tables.clone()] {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                *byte = (state >> 56) as u8;
            }
        }
        for (place, change) in damages {
            file.0[tables.start + place.index(tables.len())] ^= change;
        }
        if let Some(cut) = cut {
            let length = cut.index(tables.len()) as u64;
            file.0[248..256].copy_from_slice(&length.to_le_bytes());
        }
        file.seal_tables();
        file.is_read();
    }

    #[test]
    fn damaged_blocks_under_right_checksums_do_no_harm(
        damages in damages(),
        zeroed in prop::option::weighted(0.2, any::<prop::sample::Index>()),
        method in prop::sample::select(&METHODS[..]),
        listed in any::<bool>(),
    ) {
        let mut file = file_of(method, listed);
        let blocks = file.blocks();
        for (place, change) in damages {
            file.0[blocks.start + place.index(blocks.len())] ^= change;
        }
        if let Some(from) = zeroed {
            let from = blocks.start + from.index(blocks.len());
            file.0[from..blocks.end].fill(0);
        }
        file.seal_blocks();
        file.is_read();
    }
}

#[test]
fn few_heights_far_between_are_listed_by_trained_prediction() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.kmb");
    for (method, listed) in in_contexts().flat_map(|method| [(method, false), (method, true)]) {
        std::fs::write(&path, file_of(method, listed).0).unwrap();
        let has_list = tables_of(&path).listed.is_some();
        let may_have = method.adaptive && method.transform == TransformKind::Interpolating;
        assert_eq!(has_list, listed && may_have, "{method:?}");
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn a_sound_file_with_its_checksums_put_anew_is_the_same_file() {
    for method in METHODS {
        let mut file = file_of(method, true);
        let before = file.0.clone();
        file.seal_tables();
        file.seal_blocks();
        assert!(file.0 == before && file.is_read());
    }
}
