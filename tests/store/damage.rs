//! Damaged files: an error that names the place, or the right bytes; never anything else.

use std::fs::OpenOptions;
use std::path::Path;

use kimberlite::Error;
use kimberlite::store::{Access, Damage, DamagedPart, HEADER_LENGTH, Store};

use crate::content::{BOTH, Content, Folder, open_error, patch_header, u64_at};

/// Offsets of the index and of the blocks section of a file.
fn index_and_blocks(bytes: &[u8]) -> (usize, usize) {
    (u64_at(bytes, 256) as usize, u64_at(bytes, 272) as usize)
}

/// Makes the checksum of the page at `start`, of `length` bytes, right again.
fn seal_page(bytes: &mut [u8], start: usize, length: usize) {
    let checksum = crc32fast::hash(&bytes[start..start + length - 4]);
    bytes[start + length - 4..start + length].copy_from_slice(&checksum.to_le_bytes());
}

#[test]
fn a_flipped_bit_goes_unnoticed() {
    let content = Content::small(12);
    let good = content.bytes();
    for access in BOTH {
        let folder = Folder::new();
        for bit in 0..good.len() * 8 {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            if let Ok(store) = folder.open(&bytes, access) {
                assert!(!store.verify().is_sound(), "bit {bit}");
                content.assert_right_or_damaged(&store);
            }
        }
    }
}

#[test]
fn a_flipped_bit_is_reported_elsewhere() {
    let good = Content::small(70).bytes();
    let flipped = |offset: usize| {
        let mut bytes = good.clone();
        bytes[offset] ^= 16;
        open_error(&bytes)
    };
    assert_eq!(flipped(3), "not a Kimberlite repository");
    for offset in [8, 10, 12, 16, 100, HEADER_LENGTH - 1] {
        let error = flipped(offset);
        assert!(
            error == "damaged: header: checksum mismatch"
                || error == "damaged: header: it claims a length of 288 bytes",
            "{error}"
        );
    }
    for (section, field) in [("metadata", 208), ("roots", 224), ("tables", 240)] {
        let error = flipped(u64_at(&good, field) as usize);
        assert_eq!(error, format!("damaged: {section}: checksum mismatch"));
    }
}

#[test]
fn damage_of_a_page_or_a_group_spreads_or_is_not_named() {
    let content = Content::small(150);
    let good = content.bytes();
    let (index, blocks) = index_and_blocks(&good);
    let group = |rank: usize| {
        (0..rank)
            .map(|rank| content.padded(rank).len())
            .sum::<usize>()
    };
    let mut bytes = good.clone();
    // A record of the page of blocks 64 to 127, and block 18.
    bytes[index + 364 + 200] ^= 1;
    bytes[blocks + group(18)] ^= 0x80;
    for access in BOTH {
        let folder = Folder::new();
        let store = folder.open(&bytes, access).unwrap();
        let name = folder.file().display().to_string();
        let mut scratch = Vec::new();
        for rank in 0..150 {
            let expected = match rank {
                16..=23 => Some("blocks 16 to 23: checksum mismatch"),
                64..=127 => Some("index page 1 (blocks 64 to 127): checksum mismatch"),
                _ => None,
            };
            let found = store.block(rank, &mut scratch).map(<[u8]>::to_vec);
            match (found, expected) {
                (Ok(block), None) => assert_eq!(block, content.padded(rank as usize)),
                (Err(error), Some(expected)) => {
                    assert_eq!(error.to_string(), format!("{name}: damaged: {expected}"));
                }
                (found, expected) => panic!("block {rank}: {found:?} instead of {expected:?}"),
            }
            assert_eq!(store.record(rank).is_ok(), !(64..=127).contains(&rank));
        }
        let mismatch = |part, first, last| {
            let cause = "checksum mismatch".to_owned();
            Damage {
                part,
                first,
                last,
                cause,
            }
        };
        let verification = store.verify();
        let expected = [
            mismatch(DamagedPart::Group, 16, 23),
            mismatch(DamagedPart::Page, 64, 127),
        ];
        assert_eq!(verification.damaged, expected);
        assert_eq!(verification.damaged_blocks(), 72);
        let lines = verification
            .damaged
            .iter()
            .map(Damage::to_string)
            .collect::<Vec<_>>();
        assert_eq!(lines[0], "blocks 16 to 23: checksum mismatch");
        assert_eq!(
            lines[1],
            "index page of blocks 64 to 127: checksum mismatch"
        );
    }
}

#[test]
fn a_truncated_file_opens() {
    let good = Content::small(12).bytes();
    let whole = good.len();
    for length in 0..whole {
        let expected = match length {
            0..=303 => format!("damaged: truncated: it has {length} bytes of at least 304"),
            _ => format!("damaged: truncated: it has {length} bytes of {whole}"),
        };
        assert_eq!(open_error(&good[..length]), expected);
    }
}

#[test]
fn a_file_with_bytes_after_its_end_opens() {
    let mut bytes = Content::small(3).bytes();
    let whole = bytes.len();
    bytes.extend([0; 5]);
    assert_eq!(
        open_error(&bytes),
        format!("damaged: 5 bytes after its end at {whole}")
    );
}

#[test]
fn something_else_than_a_repository_is_opened() {
    assert_eq!(open_error(b"ncols 4"), "not a Kimberlite repository");
    assert_eq!(open_error(&[0; 4096]), "not a Kimberlite repository");
    let folder = Folder::new();
    let missing = folder.path().join("none.kmb");
    for access in BOTH {
        let message = |path: &Path| Store::open(path, access).unwrap_err().to_string();
        let prefix = format!("{}: cannot open: ", missing.display());
        assert!(message(&missing).starts_with(&prefix));
        assert!(matches!(
            Store::open(&missing, access),
            Err(Error::Io { .. })
        ));
        let prefix = format!("{}: cannot open: is a directory", folder.path().display());
        assert_eq!(message(folder.path()), prefix);
        assert_eq!(
            message(Path::new("")),
            "the path of the repository is empty"
        );
        #[cfg(unix)]
        assert_eq!(
            message(Path::new("/dev/null")),
            "/dev/null: cannot open: not a regular file"
        );
    }
}

#[test]
fn a_header_that_asks_for_impossible_lengths_is_served() {
    let good = Content::small(70).bytes();
    // Count of blocks, then offset and length of every section.
    let fields = std::iter::once(192).chain((208..288).step_by(8));
    for field in fields {
        for number in [1u64 << 60, u64::MAX, u64::MAX - 300, 1 << 32] {
            let mut bytes = good.clone();
            patch_header(&mut bytes, field, &number.to_le_bytes());
            let error = open_error(&bytes);
            let place = ["header", "metadata", "roots", "tables"]
                .iter()
                .any(|place| error.starts_with(&format!("damaged: {place}: ")));
            assert!(place, "field {field} = {number}: {error}");
        }
    }
    for number in [1u64 << 60, u64::MAX, 0] {
        let mut bytes = good.clone();
        patch_header(&mut bytes, 200, &number.to_le_bytes());
        assert!(open_error(&bytes).starts_with("damaged: "));
    }
    for number in [0, 19, 65537, u32::MAX] {
        let mut bytes = good.clone();
        patch_header(&mut bytes, 12, &number.to_le_bytes());
        let expected = format!("damaged: header: it claims a length of {number} bytes");
        assert_eq!(open_error(&bytes), expected);
    }
}

#[test]
fn an_index_that_points_outside_the_blocks_is_followed() {
    let content = Content::small(8);
    let good = content.bytes();
    let (index, blocks) = index_and_blocks(&good);
    let page_length = blocks - index;
    let available = good.len() - blocks;
    let folder = Folder::new();
    for base in [available as u64, 1 << 60, u64::MAX, u64::MAX - 40] {
        let mut bytes = good.clone();
        bytes[index..index + 8].copy_from_slice(&base.to_le_bytes());
        seal_page(&mut bytes, index, page_length);
        for access in BOTH {
            let store = folder.open(&bytes, access).unwrap();
            let error = store.block(3, &mut Vec::new()).unwrap_err().to_string();
            let place = format!(
                "blocks 0 to 7: the index puts them outside the section of {available} bytes"
            );
            assert!(error.ends_with(&place), "{error}");
            assert!(!store.verify().is_sound());
        }
    }
    for rank in 0..8 {
        let mut bytes = good.clone();
        bytes[index + 8 + 2 * rank..][..2].copy_from_slice(&[0xFE, 0xFF]);
        seal_page(&mut bytes, index, page_length);
        for access in BOTH {
            let store = folder.open(&bytes, access).unwrap();
            assert!(matches!(
                store.block(7, &mut Vec::new()),
                Err(Error::Damaged { .. })
            ));
            assert_eq!(store.record(rank as u64).unwrap().length, 65534);
            assert_eq!(store.verify().damaged_blocks(), 8);
        }
    }
}

#[test]
fn pages_that_overlap_pass_verification() {
    let good = Content::small(192).bytes();
    let (index, _) = index_and_blocks(&good);
    let mut bytes = good.clone();
    let second = index + 364;
    bytes.copy_within(index..second, second);
    for access in BOTH {
        let damaged = Folder::new().open(&bytes, access).unwrap().verify().damaged;
        assert_eq!(damaged.len(), 1);
        assert_eq!((damaged[0].first, damaged[0].last), (64, 127));
        assert_eq!(damaged[0].cause, "its blocks do not join their neighbours");
    }
}

#[test]
fn verification_trusts_what_was_sound_before() {
    let folder = Folder::new();
    let content = Content::small(70);
    let mut bytes = content.bytes();
    let store = folder.open(&bytes, Access::Positioned).unwrap();
    content.assert_held_by(&store);
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(folder.file(), &bytes).unwrap();
    let damaged = store.verify().damaged;
    assert_eq!((damaged[0].first, damaged[0].last), (64, 69));
}

#[test]
fn a_file_truncated_under_a_positioned_reader_gives_bytes() {
    let folder = Folder::new();
    let bytes = Content::small(70).bytes();
    let store = folder.open(&bytes, Access::Positioned).unwrap();
    OpenOptions::new()
        .write(true)
        .open(folder.file())
        .unwrap()
        .set_len(400)
        .unwrap();
    let error = store.block(69, &mut Vec::new()).unwrap_err().to_string();
    assert!(
        error.contains("damaged: index: the file ends before"),
        "{error}"
    );
    let verification = store.verify();
    assert_eq!(verification.damaged_blocks(), 70);
    assert_eq!(
        verification.damaged[0].cause,
        "lies outside its section or the file"
    );
}
