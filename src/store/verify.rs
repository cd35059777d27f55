//! The check of a whole repository: every page and every group, whatever was verified before.

use std::fmt;

use std::ops::RangeInclusive;

use super::index::Page;
use super::reader::Store;
use crate::Error;

/// Which part of a file a checksum covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DamagedPart {
    /// A page of the index: where its blocks lie is not known.
    Page,
    /// A group of blocks.
    Group,
}

/// Something that is not as it was written. Displays as one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// What is damaged.
    pub part: DamagedPart,
    /// Rank of its first block.
    pub first: u64,
    /// Rank of its last block.
    pub last: u64,
    /// How it shows.
    pub cause: String,
}

impl fmt::Display for Damage {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let part = match self.part {
            DamagedPart::Page => "index page of ",
            DamagedPart::Group => "",
        };
        write!(
            formatter,
            "{part}blocks {} to {}: {}",
            self.first, self.last, self.cause
        )
    }
}

/// What [`Store::verify`] found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Verification {
    /// All damage, by rank; no block belongs to more than one.
    pub damaged: Vec<Damage>,
    /// Ranks of the blocks that are missing since a repair, neighbours together. Nothing is wrong with the
    /// file because of them.
    pub missing: Vec<RangeInclusive<u64>>,
}

impl Verification {
    /// Whether the repository is as it was written, or repaired.
    pub fn is_sound(&self) -> bool {
        self.damaged.is_empty()
    }

    /// Count of blocks that cannot be used.
    pub fn damaged_blocks(&self) -> u64 {
        self.damaged
            .iter()
            .map(|damage| damage.last - damage.first + 1)
            .sum()
    }

    /// Count of blocks that are missing.
    pub fn missing_blocks(&self) -> u64 {
        let counts = self
            .missing
            .iter()
            .map(|ranks| ranks.end() - ranks.start() + 1);
        counts.sum()
    }

    fn add_missing(&mut self, rank: u64) {
        match self.missing.last_mut() {
            Some(last) if last.end() + 1 == rank => *last = *last.start()..=rank,
            _ => self.missing.push(rank..=rank),
        }
    }
}

/// Goes through the pages in order, and judges each.
#[derive(Clone, Copy)]
pub(super) struct PageWalk {
    /// Where the next page's blocks must begin; not known after a page that is damaged.
    expected_base: Option<u64>,
}

impl PageWalk {
    pub(super) fn new() -> PageWalk {
        PageWalk {
            expected_base: Some(0),
        }
    }

    /// A page cannot be read.
    pub(super) fn lose_place(&mut self) {
        self.expected_base = None;
    }

    /// Whether the page of this number is as it was written, by its own checksum and by where its blocks lie;
    /// else the cause.
    pub(super) fn judge(
        &mut self,
        store: &Store,
        number: u64,
        page: &Page,
    ) -> Result<(), &'static str> {
        let expected_base = self.expected_base.take();
        if !page.is_sound() {
            return Err("checksum mismatch");
        }
        let ranks = store.page_ranks(number);
        let records = (ranks.end - ranks.start) as usize;
        let unit = u64::from(store.header().block_length_unit);
        let end = page
            .base()
            .checked_add(page.length_units(0..records) * unit);
        let is_last = number + 1 == store.pages();
        let joins = expected_base.is_none_or(|base| base == page.base())
            && (!is_last || end == Some(store.blocks_length()));
        if !joins {
            return Err("its blocks do not join their neighbours");
        }
        self.expected_base = end;
        Ok(())
    }
}

impl Store {
    /// Verifies every page of the index and every group of blocks again. Header, metadata, roots and
    /// tables were verified when the store was opened. What cannot be read counts as damaged.
    pub fn verify(&self) -> Verification {
        let mut found = Verification::default();
        let mut scratch = Vec::new();
        let mut walk = PageWalk::new();
        for number in 0..self.pages() {
            let ranks = self.page_ranks(number);
            let judged = match self.read_page(number, &mut scratch) {
                Ok(page) => match walk.judge(self, number, &page) {
                    Ok(()) => Ok(page),
                    Err(cause) => Err(cause.to_owned()),
                },
                Err(error) => {
                    walk.lose_place();
                    Err(cause(error))
                }
            };
            match judged {
                Ok(page) => self.verify_groups(&page, ranks.start, &mut found),
                Err(cause) => found.damaged.push(Damage {
                    part: DamagedPart::Page,
                    first: ranks.start,
                    last: ranks.end - 1,
                    cause,
                }),
            }
        }
        found
    }

    fn verify_groups(&self, page: &Page, first_rank: u64, found: &mut Verification) {
        let mut scratch = Vec::new();
        for group in 0..page.groups() {
            let records = page.group_records(group);
            let (first, last) = (records.start as u64, records.end as u64 - 1);
            let cause = match self.read_blocks(page, first_rank, records.clone(), &mut scratch) {
                Ok(bytes) if crc32fast::hash(bytes) == page.group_checksum(group) => {
                    for record in records.filter(|&record| page.is_missing(record)) {
                        found.add_missing(first_rank + record as u64);
                    }
                    continue;
                }
                Ok(_) => "checksum mismatch".to_owned(),
                Err(error) => cause(error),
            };
            found.damaged.push(Damage {
                part: DamagedPart::Group,
                first: first_rank + first,
                last: first_rank + last,
                cause,
            });
        }
    }
}

/// Why a page or a group cannot be read, without the place, which the damage names.
fn cause(error: Error) -> String {
    match error {
        Error::Io { source, .. } => format!("cannot be read: {source}"),
        _ => "lies outside its section or the file".to_owned(),
    }
}
