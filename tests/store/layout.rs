//! The bytes of `docs/format.md`, put together by hand.

use kimberlite::geo::{RasterInfo, Registration, SampleType};
use kimberlite::store::{DomainKind, EntropyKind, Header, Kind, TransformKind};

use crate::content::{BOTH, Content, Folder, open_error, patch_header};

/// The checksum by its definition, bit by bit.
fn checksum(bytes: &[u8]) -> [u8; 4] {
    let mut remainder = u32::MAX;
    for byte in bytes {
        remainder ^= u32::from(*byte);
        for _ in 0..8 {
            let carry = remainder & 1;
            remainder = remainder >> 1 ^ if carry == 1 { 0xEDB8_8320 } else { 0 };
        }
    }
    (!remainder).to_le_bytes()
}

/// Metadata as one Zstandard frame with one raw block: CRS `EPSG:4326`, unit `m`, pair `a` = FF 00.
fn metadata() -> Vec<u8> {
    let mut plain = Vec::new();
    for field in [&b"EPSG:4326"[..], b"m", b"a", &[0xFF, 0x00]] {
        plain.extend((field.len() as u32).to_le_bytes());
        plain.extend(field);
    }
    let mut section = vec![29, 0, 0, 0];
    section.extend([0x28, 0xB5, 0x2F, 0xFD, 0x20, 29, (29 << 3 | 1) as u8, 0, 0]);
    section.extend(plain);
    section
}

/// A repository of nine blocks of `rank` units of 4 bytes each, of which the last byte is padding.
fn golden(metadata: &[u8]) -> Vec<u8> {
    let (roots, tables) = (b"ROOT", b"TABLE");
    let blocks: Vec<u8> = (0..9u8).flat_map(padded).collect();
    assert_eq!(blocks.len(), 144);
    let mut index = Vec::new();
    index.extend(0u64.to_le_bytes());
    for rank in 0..9u16 {
        index.extend(rank.to_le_bytes());
    }
    for code in [10..19u8, 20..29, 30..39] {
        index.extend(code);
    }
    index.extend(checksum(&blocks[..112]));
    index.extend(checksum(&blocks[112..]));
    index.extend(checksum(&index.clone()));
    assert_eq!(index.len(), 65);

    let mut file = vec![0x89, 0x4B, 0x4D, 0x42, 0x0D, 0x0A, 0x1A, 0x0A];
    file.extend([1, 0, 1, 0, 0x30, 0x01, 0, 0]);
    // Colours, cube sphere, two-stage, rans; 128 cells, 46 levels; f32, point.
    file.extend([1, 1, 2, 1, 7, 46, 6, 1]);
    // Georeferenced, geographic, has nodata; blocks in units of 4 bytes.
    file.extend([0b0111, 0, 4, 0]);
    for number in [0x0102_0304u32, 0x0506_0708, 77] {
        file.extend(number.to_le_bytes());
    }
    file.extend((-9i32).to_le_bytes());
    file.extend(1_000_000i32.to_le_bytes());
    let floats = [0.125, 100.5, -1.5, 2.5, 0.5, 0.375, 0.25, 0.1, -3.0];
    for number in floats.into_iter().chain([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]) {
        file.extend(f64::to_le_bytes(number));
    }
    file.extend((-9999.0f64).to_le_bytes());
    let start = 304 + metadata.len() as u64;
    let end = start + 4 + 5 + 65 + 144;
    for number in [1 << 40, 12_345, 9, end, 304, metadata.len() as u64] {
        file.extend(u64::to_le_bytes(number));
    }
    for number in [start, 4, start + 4, 5, start + 9, 65, start + 74, 144] {
        file.extend(u64::to_le_bytes(number));
    }
    file.extend([checksum(metadata), checksum(roots), checksum(tables)].concat());
    file.extend(checksum(&file.clone()));
    assert_eq!(file.len(), 304);
    [&file, metadata, roots, tables, &index, &blocks].concat()
}

fn block(rank: u8) -> Vec<u8> {
    vec![rank + 1; (4 * usize::from(rank)).saturating_sub(1)]
}

fn padded(rank: u8) -> Vec<u8> {
    let mut block = block(rank);
    block.resize(4 * usize::from(rank), 0);
    block
}

/// What [`golden`] says.
fn golden_content() -> Content {
    let mut raster = RasterInfo::new(0x0102_0304, 0x0506_0708, SampleType::F32);
    raster.bands = 3;
    raster.registration = Registration::Point;
    (raster.georeferenced, raster.geographic) = (true, true);
    raster.nodata = Some(-9999.0);
    (raster.value_scale, raster.value_offset) = (0.1, -3.0);
    raster.geotransform = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    let header = Header {
        kind: Kind::Colours,
        domain: DomainKind::CubeSphere,
        transform: TransformKind::TwoStage,
        entropy: EntropyKind::Rans,
        cells_log2: 7,
        levels: 46,
        lossless: false,
        block_length_unit: 4,
        bound_units: 77,
        unit_min: -9,
        unit_max: 1_000_000,
        unit_scale: 0.125,
        unit_offset: 100.5,
        sample_min: -1.5,
        sample_max: 2.5,
        max_error_bound: 0.5,
        max_error: 0.375,
        rms_error: 0.25,
        samples: 1 << 40,
        void_samples: 12_345,
        block_count: 9,
        raster,
    };
    Content {
        header,
        roots: b"ROOT".to_vec(),
        tables: b"TABLE".to_vec(),
        blocks: (0..9).map(block).collect(),
        codes: (0..9)
            .map(|rank| [10 + rank, 20 + rank, 30 + rank])
            .collect(),
    }
}

#[test]
fn a_version_1_file_is_read_otherwise_than_the_format_says() {
    assert_eq!(checksum(b"123456789"), 0xCBF4_3926u32.to_le_bytes());
    let mut content = golden_content();
    let folder = Folder::new();
    for access in BOTH {
        content.assert_held_by(&folder.open(&golden(&[]), access).unwrap());
    }
    content.header.raster.crs = "EPSG:4326".to_owned();
    content.header.raster.units = "m".to_owned();
    content
        .header
        .raster
        .metadata
        .insert("a".to_owned(), vec![0xFF, 0x00]);
    for access in BOTH {
        content.assert_held_by(&folder.open(&golden(&metadata()), access).unwrap());
    }
}

#[test]
fn the_writer_departs_from_the_format() {
    assert_eq!(golden_content().bytes(), golden(&[]));
}

#[test]
fn metadata_that_contradicts_itself_is_believed() {
    let refused = |change: &dyn Fn(&mut Vec<u8>), expected: &str| {
        let mut section = metadata();
        change(&mut section);
        assert_eq!(
            open_error(&golden(&section)),
            format!("damaged: metadata: {expected}")
        );
    };
    refused(&|section| section.truncate(3), "ends inside a field");
    refused(
        &|section| section[3] = 0xF0,
        "decompresses to 4026531869 bytes, more than 16777216",
    );
    refused(
        &|section| section[0] = 30,
        "decompresses to 29 bytes instead of 30",
    );
    refused(
        &|section| section[13] = 200,
        "ends inside a field of 200 bytes",
    );
    refused(&|section| section[17] = 0xFF, {
        "text is not UTF-8: invalid utf-8 sequence of 1 bytes from index 0"
    });
    let broken: [fn(&mut Vec<u8>); 2] = [|section| section[0] = 28, |section| section.truncate(20)];
    for change in broken {
        let mut section = metadata();
        change(&mut section);
        let error = open_error(&golden(&section));
        assert!(
            error.starts_with("damaged: metadata: cannot be decompressed: "),
            "{error}"
        );
    }
    // Two pairs: `b` before `a`.
    let plain = [&[0; 8][..], b"\x01\0\0\0b\0\0\0\0", b"\x01\0\0\0a\0\0\0\0"].concat();
    let frame = zstd::bulk::compress(&plain, 1).unwrap();
    let section = [&[26, 0, 0, 0][..], &frame].concat();
    let error = open_error(&golden(&section));
    assert_eq!(error, "damaged: metadata: key \"a\" is out of order");
}

#[test]
fn a_later_read_version_is_read_as_this_one() {
    let mut file = golden(&[]);
    patch_header(&mut file, 8, &[2, 0]);
    assert_eq!(
        open_error(&file),
        "has read version 2; this library reads 1"
    );
}

#[test]
fn a_later_write_version_cannot_be_read() {
    let mut file = golden(&[]);
    patch_header(&mut file, 10, &[9, 0]);
    let content = golden_content();
    for access in BOTH {
        content.assert_held_by(&Folder::new().open(&file, access).unwrap());
    }
}

#[test]
fn a_longer_header_or_a_section_of_a_later_version_cannot_be_read() {
    let added = b"later fields";
    let mut file = golden(&[]);
    let after_header = file.split_off(304);
    file.truncate(300);
    file[10] = 2;
    file[12..16].copy_from_slice(&(304 + 12u32).to_le_bytes());
    // The file's end and every section move by the new fields and a new section after the tables.
    for field in [200, 208, 224, 240, 256, 272] {
        let mut offset = u64::from_le_bytes(file[field..field + 8].try_into().unwrap());
        offset += if [208, 224, 240].contains(&field) {
            12
        } else {
            17
        };
        file[field..field + 8].copy_from_slice(&offset.to_le_bytes());
    }
    file.extend(added);
    file.extend(checksum(&file.clone()));
    file.extend(&after_header[..9]);
    file.extend(b"LATER");
    file.extend(&after_header[9..]);
    for access in BOTH {
        golden_content().assert_held_by(&Folder::new().open(&file, access).unwrap());
    }
}

#[test]
fn a_number_that_the_format_does_not_know_is_believed() {
    let cases: [(usize, &[u8], &str); 12] = [
        (16, &[3], "unknown kind 3"),
        (17, &[2], "unknown domain 2"),
        (18, &[3], "unknown transform 3"),
        (19, &[2], "unknown entropy coder 2"),
        (20, &[0], "impossible: 2^0 cells a side"),
        (20, &[255], "impossible: 2^255 cells a side"),
        (21, &[255], "impossible: 255 levels of 2^7 cells"),
        (22, &[8], "unknown sample type 8"),
        (23, &[2], "unknown registration 2"),
        (26, &[0], "impossible: block length unit 0"),
        (28, &[0; 4], "impossible: 0 x 84281096 samples"),
        (48, &[0; 8], "impossible: unit scale 0, offset 100.5"),
    ];
    for (offset, field, expected) in cases {
        let mut file = golden(&[]);
        patch_header(&mut file, offset, field);
        assert_eq!(open_error(&file), format!("damaged: header: {expected}"));
    }
}
