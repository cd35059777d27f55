//! What a repair leaves: sound blocks to the byte, nothing in place of the others, and no trust that was not earned.

use std::io;
use std::path::Path;

use kimberlite::store::{Kept, MemorySink, Repaired, Sink, Store};
use kimberlite::{Error, Result};
use proptest::prelude::*;

use crate::content::{Content, Folder, patch_header, u64_at};

/// The codes of a block whose codes were lost.
const LOST: [u8; 3] = [255, 0, 0];

/// Repairs bytes as a file that may be cut off.
fn repaired(bytes: &[u8]) -> Result<(Vec<u8>, Repaired)> {
    repaired_or_kept(bytes, false)
}

fn repaired_or_kept(bytes: &[u8], keep_sound: bool) -> Result<(Vec<u8>, Repaired)> {
    let folder = Folder::new();
    std::fs::write(folder.file(), bytes).unwrap();
    let store = Store::open_damaged(&folder.file())?;
    let sink = MemorySink::default();
    let into = Box::new(sink.clone());
    let recode = &mut |kept: Kept| Ok(kept.codes.unwrap_or(LOST));
    let done = store.repair(Path::new("out"), into, keep_sound, recode)?;
    Ok((sink.take(), done))
}

fn open(bytes: &[u8]) -> Store {
    Store::of_bytes(Path::new("bytes"), bytes.to_vec()).unwrap()
}

/// First bytes of the index, of the blocks, and the end.
fn sections(bytes: &[u8]) -> [usize; 3] {
    [
        u64_at(bytes, 256) as usize,
        u64_at(bytes, 272) as usize,
        bytes.len(),
    ]
}

/// Which blocks the checks of a whole file find unusable.
fn damaged_ranks(bytes: &[u8]) -> Vec<bool> {
    let store = open(bytes);
    let mut damaged = vec![false; store.header().block_count as usize];
    for damage in store.verify().damaged {
        damaged[damage.first as usize..=damage.last as usize].fill(true);
    }
    damaged
}

/// That a repaired file holds the content but for blocks that are missing; which those are.
fn missing_of(content: &Content, bytes: &[u8]) -> Vec<bool> {
    let store = open(bytes);
    let verification = store.verify();
    assert!(verification.is_sound(), "{:?}", verification.damaged);
    let mut scratch = Vec::new();
    let ranks = 0..content.blocks.len();
    let missing: Vec<bool> = ranks
        .map(|rank| match store.block(rank as u64, &mut scratch) {
            Ok(block) => {
                assert_eq!(block, content.padded(rank), "block {rank}");
                false
            }
            Err(Error::Missing { .. }) => true,
            Err(error) => panic!("{error}"),
        })
        .collect();
    let named = verification.missing.iter().flat_map(|ranks| ranks.clone());
    let expected = (0..).zip(&missing).filter(|&(_, &missing)| missing);
    assert!(named.eq(expected.map(|(rank, _)| rank)));
    assert_eq!(store.has_missing(), missing.contains(&true));
    missing
}

fn contents() -> impl Strategy<Value = Content> {
    (0u64..400, prop_oneof![Just(1), Just(4)]).prop_map(|(count, unit)| {
        let mut content = Content::small(count);
        content.header.block_length_unit = unit;
        content
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn a_sound_file_is_changed_by_a_repair(content in contents()) {
        let good = content.bytes();
        let (bytes, done) = repaired(&good).unwrap();
        prop_assert_eq!((done.damaged_blocks, done.lost_blocks, done.missing_blocks), (0, 0, 0));
        prop_assert_eq!(done.bytes, good.len() as u64);
        prop_assert!(bytes == good);
    }

    #[test]
    fn a_repair_loses_what_is_sound_or_keeps_what_is_not(
        content in contents(),
        hits in prop::collection::vec((any::<prop::sample::Index>(), 1u8.., 1usize..40), 1..8),
        in_blocks in any::<bool>(),
    ) {
        let good = content.bytes();
        let [index, blocks, end] = sections(&good);
        let first = if in_blocks { blocks } else { index };
        prop_assume!(first < end);
        let mut bytes = good.clone();
        for (place, change, length) in hits {
            let start = first + place.index(end - first);
            for byte in &mut bytes[start..end.min(start + length)] {
                *byte ^= change;
            }
        }
        let damaged = damaged_ranks(&bytes);
        let (once, done) = repaired(&bytes).unwrap();
        let missing = missing_of(&content, &once);
        for (damaged, missing) in damaged.iter().zip(&missing) {
            prop_assert!(*damaged || !missing);
        }
        let count = |of: &[bool]| of.iter().filter(|is| **is).count() as u64;
        prop_assert_eq!(done.damaged_blocks, count(&damaged));
        prop_assert_eq!([done.lost_blocks, done.missing_blocks], [count(&missing); 2]);
        let store = open(&once);
        for (rank, codes) in content.codes.iter().enumerate() {
            let record = store.record(rank as u64).unwrap();
            let found = [record.error_code, record.low_code, record.high_code];
            prop_assert!(found == *codes || found == LOST && damaged[rank] && missing[rank]);
            prop_assert_eq!(record.is_missing, missing[rank]);
            prop_assert!(!missing[rank] || record.length == 0);
        }
        let (twice, again) = repaired(&once).unwrap();
        prop_assert!(twice == once);
        prop_assert_eq!((again.damaged_blocks, again.missing_blocks), (0, done.missing_blocks));
    }

    #[test]
    fn what_lies_before_the_cut_of_a_truncated_file_is_lost(
        content in contents(),
        cut in any::<prop::sample::Index>(),
    ) {
        let good = content.bytes();
        let [_, blocks, end] = sections(&good);
        let length = blocks + cut.index(end - blocks + 1);
        let (bytes, _) = repaired(&good[..length]).unwrap();
        let missing = missing_of(&content, &bytes);
        let mut place = blocks;
        for group in 0..missing.len().div_ceil(8) {
            let ranks = 8 * group..missing.len().min(8 * group + 8);
            place += ranks.clone().map(|rank| content.padded(rank).len()).sum::<usize>();
            let lost = place > length;
            prop_assert!(missing[ranks].iter().all(|missing| *missing == lost));
        }
    }
}

#[test]
fn one_wrong_bit_of_an_index_page_costs_a_block() {
    let content = Content::small(70);
    let good = content.bytes();
    let [index, blocks, _] = sections(&good);
    for bit in (8 * index..8 * blocks).step_by(7) {
        let mut bytes = good.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let (bytes, done) = repaired(&bytes).unwrap();
        assert!(bytes == good, "bit {bit}");
        let page = if bit < 8 * (index + 364) { 64 } else { 6 };
        assert_eq!((done.damaged_blocks, done.lost_blocks), (page, 0));
    }
}

#[test]
fn a_page_in_the_place_of_another_is_believed() {
    let content = Content::small(192);
    let good = content.bytes();
    let [index, ..] = sections(&good);
    let mut bytes = good.clone();
    bytes.copy_within(index..index + 364, index + 364);
    let (bytes, done) = repaired(&bytes).unwrap();
    let missing = missing_of(&content, &bytes);
    assert!((64..128).all(|rank| missing[rank]));
    assert_eq!(done.lost_blocks, 64);
}

#[test]
fn bytes_after_the_end_are_copied_or_kept() {
    let good = Content::small(20).bytes();
    let mut bytes = good.clone();
    bytes.extend([7; 99]);
    for keep_sound in [false, true] {
        assert!(repaired_or_kept(&bytes, keep_sound).unwrap().0 == good);
    }
    assert!(repaired_or_kept(&good, true).unwrap().0.is_empty());
}

#[test]
fn an_erased_page_is_taken_for_empty_blocks() {
    for count in [1, 8, 30, 64, 100] {
        let content = Content::small(count);
        let good = content.bytes();
        let [index, blocks, _] = sections(&good);
        for fill in [0, 0xFF] {
            let mut bytes = good.clone();
            bytes[index..blocks].fill(fill);
            let (bytes, _) = repaired(&bytes).unwrap();
            assert!(missing_of(&content, &bytes).iter().all(|missing| *missing));
        }
    }
}

#[test]
fn a_file_of_a_later_version_is_edited() {
    let mut bytes = Content::small(20).bytes();
    patch_header(&mut bytes, 10, &2u16.to_le_bytes());
    let error = repaired(&bytes).unwrap_err();
    assert!(matches!(error, Error::Version { .. }), "{error}");
    assert!(error.to_string().contains("write version 2"), "{error}");
}

#[test]
fn what_opening_needs_is_said_to_be_repaired() {
    let good = Content::small(20).bytes();
    for (part, at) in [
        ("header", 100),
        ("metadata", u64_at(&good, 208) as usize),
        ("roots", u64_at(&good, 224) as usize),
        ("tables", u64_at(&good, 240) as usize),
    ] {
        let mut bytes = good.clone();
        bytes[at] ^= 1;
        let error = repaired(&bytes).unwrap_err().to_string();
        assert!(error.contains(&format!("damaged: {part}: ")), "{error}");
    }
    let [_, blocks, _] = sections(&good);
    let error = repaired(&good[..blocks - 1]).unwrap_err().to_string();
    assert!(error.contains("truncated"), "{error}");
}

/// A sink whose Nth call fails.
struct Failing {
    calls: usize,
    sink: MemorySink,
}

impl Failing {
    fn call(&mut self) -> io::Result<()> {
        self.calls = self
            .calls
            .checked_sub(1)
            .ok_or(io::ErrorKind::StorageFull)?;
        Ok(())
    }
}

impl Sink for Failing {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        self.call()?;
        self.sink.write_at(offset, bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.call()
    }

    fn publish(mut self: Box<Self>) -> io::Result<()> {
        self.call()?;
        Box::new(self.sink).publish()
    }
}

#[test]
fn a_failure_at_the_nth_call_of_a_repair_leaves_a_file() {
    let mut bytes = Content::small(200).bytes();
    *bytes.last_mut().unwrap() ^= 1;
    let expected = repaired(&bytes).unwrap().0;
    let store = open(&bytes);
    for calls in 0.. {
        let sink = MemorySink::default();
        let failing = Box::new(Failing {
            calls,
            sink: sink.clone(),
        });
        let recode = &mut |kept: Kept| Ok(kept.codes.unwrap_or(LOST));
        let done = store.repair(Path::new("out"), failing, false, recode);
        match done {
            Err(error) => {
                assert!(matches!(error, Error::Io { .. }), "{error}");
                assert!(sink.take().is_empty());
            }
            Ok(_) => {
                assert!(calls > 3 && sink.take() == expected);
                return;
            }
        }
    }
}

#[test]
fn a_repair_that_is_stopped_leaves_a_file() {
    let folder = Folder::new();
    let mut bytes = Content::small(200).bytes();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(folder.file(), &bytes).unwrap();
    let store = Store::open_damaged(&folder.file()).unwrap();
    let sink = kimberlite::store::FileSink::create(&folder.file()).unwrap();
    let recode = &mut |kept: Kept| match kept.rank {
        150 => Err(Error::Cancelled),
        _ => Ok(LOST),
    };
    let stopped = store.repair(&folder.file(), Box::new(sink), true, recode);
    assert!(matches!(stopped, Err(Error::Cancelled)));
    assert_eq!(folder.names(), ["terrain.kmb"]);
    assert!(std::fs::read(folder.file()).unwrap() == bytes);
}
