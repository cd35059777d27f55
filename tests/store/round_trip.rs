//! What was written is read, by both readers, from any thread.

use kimberlite::Error;
use kimberlite::geo::{RasterInfo, Registration, SampleType};
use kimberlite::store::{DomainKind, EntropyKind, Header, Kind, Store, TransformKind, Writer};
use proptest::collection::{btree_map, vec};
use proptest::prelude::*;

use crate::content::{BOTH, Content, Folder, header};

fn any_raster() -> impl Strategy<Value = RasterInfo> {
    let numbers = (
        1..=u32::MAX,
        1..=u32::MAX,
        0u8..8,
        any::<[f64; 6]>(),
        any::<[bool; 3]>(),
    );
    let values = (any::<Option<f64>>(), any::<f64>(), any::<f64>());
    let texts = (
        ".{0,20}",
        ".{0,6}",
        btree_map(".{0,8}", vec(any::<u8>(), 0..40), 0..5),
    );
    (numbers, values, texts).prop_map(|(numbers, values, texts)| {
        let (width, height, sample_type, geotransform, flags) = numbers;
        let sample_type = SampleType::from_number(sample_type).unwrap();
        let mut raster = RasterInfo::new(width, height, sample_type);
        raster.geotransform = geotransform;
        [raster.georeferenced, raster.geographic] = [flags[0], flags[1]];
        raster.registration = if flags[2] {
            Registration::Area
        } else {
            Registration::Point
        };
        (raster.nodata, raster.value_scale, raster.value_offset) = values;
        (raster.crs, raster.units, raster.metadata) = texts;
        raster
    })
}

fn any_header() -> impl Strategy<Value = Header> {
    let kinds = (0u8..3, 0u8..2, 0u8..3, 0u8..2);
    let shape = (1u8..=7).prop_flat_map(|cells| (Just(cells), 0..=30 - cells));
    let units = (
        any::<(i32, i32)>(),
        f64::MIN_POSITIVE..1e300,
        -1e300..1e300,
        any::<u32>(),
    );
    let numbers = (any::<[f64; 5]>(), any::<(u64, u64)>(), any::<[bool; 2]>());
    (kinds, shape, units, numbers, any_raster()).prop_map(
        |(kinds, shape, units, numbers, mut raster)| {
            raster.bands = if kinds.0 == 1 { 3 } else { 1 };
            let (range, unit_scale, unit_offset, bound_units) = units;
            let (floats, samples, flags) = numbers;
            Header {
                kind: Kind::try_from(kinds.0).unwrap(),
                domain: DomainKind::try_from(kinds.1).unwrap(),
                transform: TransformKind::try_from(kinds.2).unwrap(),
                entropy: EntropyKind::try_from(kinds.3).unwrap(),
                cells_log2: shape.0,
                levels: 2 * shape.1,
                lossless: flags[0],
                block_length_unit: [1, 4, 8]
                    [usize::from(flags[1]) + usize::from(flags[0] && flags[1])],
                bound_units,
                unit_min: range.0.min(range.1),
                unit_max: range.0.max(range.1),
                unit_scale,
                unit_offset,
                sample_min: floats[0],
                sample_max: floats[1],
                max_error_bound: floats[2],
                max_error: floats[3],
                rms_error: floats[4],
                samples: samples.0.max(samples.1),
                void_samples: samples.0.min(samples.1),
                block_count: 0,
                raster,
            }
        },
    )
}

fn any_content() -> impl Strategy<Value = Content> {
    let bytes = |most: usize| vec(any::<u8>(), 0..most);
    let blocks = vec((bytes(60), any::<[u8; 3]>()), 0..200);
    (any_header(), bytes(300), bytes(300), blocks).prop_map(|(header, roots, tables, blocks)| {
        let (blocks, codes): (Vec<_>, Vec<_>) = blocks.into_iter().unzip();
        let header = Header {
            block_count: blocks.len() as u64,
            ..header
        };
        Content {
            header,
            roots,
            tables,
            blocks,
            codes,
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    #[test]
    fn a_reader_gives_back_something_else_than_was_written(content in any_content()) {
        let folder = Folder::new();
        let length = content.write(&folder.file()).unwrap();
        prop_assert_eq!(std::fs::metadata(folder.file()).unwrap().len(), length);
        prop_assert_eq!(folder.names(), ["terrain.kmb"]);
        for access in BOTH {
            let store = Store::open(&folder.file(), access).unwrap();
            content.assert_held_by(&store);
            prop_assert_eq!(store.file_bytes(), length);
            let blocks: usize = (0..content.blocks.len()).map(|rank| content.padded(rank).len()).sum();
            let payload = content.roots.len() + content.tables.len() + blocks;
            prop_assert_eq!(store.payload_bytes(), payload as u64);
        }
    }
}

#[test]
fn header_and_codes_known_only_at_the_end_are_lost() {
    let folder = Folder::new();
    let mut content = Content::small(70);
    let mut writer = Writer::create(
        &folder.file(),
        &content.header,
        &content.roots,
        &content.tables,
    )
    .unwrap();
    for block in &content.blocks {
        writer.push(block).unwrap();
    }
    content.header.max_error = 9.75;
    content.header.void_samples = 8;
    content.header.raster.nodata = Some(f64::NAN);
    writer.finish(&content.header, &content.codes).unwrap();
    for access in BOTH {
        content.assert_held_by(&Store::open(&folder.file(), access).unwrap());
    }
}

#[test]
fn the_largest_block_does_not_fit_or_a_larger_one_is_cut() {
    for unit in [1, 4, 8] {
        let folder = Folder::new();
        let mut content = Content::small(2);
        content.header.block_length_unit = unit;
        let longest = 65534 * usize::from(unit);
        content.blocks[1] = vec![0xa5; longest];
        content.write(&folder.file()).unwrap();
        for access in BOTH {
            content.assert_held_by(&Store::open(&folder.file(), access).unwrap());
        }
        content.blocks[1] = vec![0xa5; longest + 1];
        let error = content.write(&folder.file()).unwrap_err();
        assert_eq!(
            error.to_string(),
            format!("block 1 has {} bytes, too many", longest + 1)
        );
    }
}

#[test]
fn a_file_larger_than_the_buffer_comes_back_changed() {
    let folder = Folder::new();
    let mut content = Content::small(300);
    for (rank, block) in content.blocks.iter_mut().enumerate() {
        *block = (0..11_000).map(|index| (index * rank / 7) as u8).collect();
    }
    content.write(&folder.file()).unwrap();
    for access in BOTH {
        content.assert_held_by(&Store::open(&folder.file(), access).unwrap());
    }
}

#[test]
fn threads_disagree_about_a_block() {
    let folder = Folder::new();
    let content = Content::small(500);
    content.write(&folder.file()).unwrap();
    for access in BOTH {
        let store = Store::open(&folder.file(), access).unwrap();
        std::thread::scope(|scope| {
            for stride in [1, 3, 7, 11, 499, 497, 251, 13] {
                let (store, content) = (&store, &content);
                scope.spawn(move || {
                    let mut scratch = Vec::new();
                    for step in 0..500 {
                        let rank = step * stride % 500;
                        let block = store.block(rank as u64, &mut scratch).unwrap();
                        assert_eq!(block, content.padded(rank));
                        let record = store.record(rank as u64).unwrap();
                        assert_eq!(record.error_code, content.codes[rank][0]);
                    }
                });
            }
        });
    }
}

#[test]
fn same_content_gives_other_bytes() {
    assert_eq!(Content::small(130).bytes(), Content::small(130).bytes());
}

#[test]
fn overhead_exceeds_three_percent_at_half_a_bit_a_sample() {
    let folder = Folder::new();
    let mut content = Content::small(4096);
    content.blocks.fill(vec![0x77; 4096 / 16]);
    let length = content.write(&folder.file()).unwrap();
    let store = Store::open(&folder.file(), BOTH[0]).unwrap();
    let overhead = length - store.payload_bytes();
    assert!(overhead * 100 <= length * 3, "{overhead} bytes of {length}");
}

#[test]
fn an_open_store_sees_the_file_that_replaced_its_own() {
    for access in BOTH {
        let folder = Folder::new();
        let old = Content::small(200);
        old.write(&folder.file()).unwrap();
        let store = Store::open(&folder.file(), access).unwrap();
        let mut new = Content::small(30);
        new.roots = b"other".to_vec();
        new.write(&folder.file()).unwrap();
        old.assert_held_by(&store);
        new.assert_held_by(&Store::open(&folder.file(), access).unwrap());
    }
}

#[test]
fn numbers_that_no_file_can_hold_are_written() {
    let folder = Folder::new();
    let refused = |change: fn(&mut Header), expected: &str| {
        let mut header = header(3);
        change(&mut header);
        let error = Writer::create(&folder.file(), &header, &[], &[])
            .err()
            .unwrap();
        assert!(matches!(error, Error::Argument(_)));
        assert!(error.to_string().contains(expected), "{error}");
        assert!(folder.names().is_empty());
    };
    refused(|header| header.cells_log2 = 0, "2^0 cells a side");
    refused(|header| header.cells_log2 = 8, "2^8 cells a side");
    refused(|header| header.levels = 3, "3 levels");
    refused(|header| header.levels = 50, "50 levels");
    refused(|header| header.block_length_unit = 2, "block length unit 2");
    refused(|header| header.raster.height = 0, "257 x 0 samples");
    refused(|header| header.unit_max = -6, "units from -5 to -6");
    refused(|header| header.unit_scale = f64::NAN, "unit scale NaN");
    refused(|header| header.unit_offset = f64::INFINITY, "offset inf");
    refused(|header| header.void_samples = 1 << 40, "voids");
    refused(|header| header.block_count = u64::MAX, "blocks");
    refused(
        |header| {
            drop(
                header
                    .raster
                    .metadata
                    .insert(String::new(), vec![0; 16 << 20]),
            )
        },
        "metadata has more than 16777216 bytes",
    );
    let roots = vec![0; (16 << 20) + 1];
    let error = Writer::create(&folder.file(), &header(3), &roots, &[])
        .err()
        .unwrap();
    assert_eq!(error.to_string(), "roots of 16777217 bytes exceed 16777216");
}
