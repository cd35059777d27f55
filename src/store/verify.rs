//! The check of a whole repository: every page and every group, whatever was verified before.

use std::fmt;

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
}

impl Verification {
    /// Whether the repository is as it was written.
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
}

impl Store {
    /// Verifies every page of the index and every group of blocks again. Header, metadata, roots and
    /// tables were verified when the store was opened. What cannot be read counts as damaged.
    pub fn verify(&self) -> Verification {
        let mut damaged = Vec::new();
        let mut scratch = Vec::new();
        // Where the next page's blocks must begin; not known after a page that is damaged.
        let mut expected_base = Some(0);
        for number in 0..self.pages() {
            let ranks = self.page_ranks(number);
            let page_damage = |cause: String| Damage {
                part: DamagedPart::Page,
                first: ranks.start,
                last: ranks.end - 1,
                cause,
            };
            let page = match self.read_page(number, &mut scratch) {
                Ok(page) => page,
                Err(error) => {
                    damaged.push(page_damage(cause(error)));
                    expected_base = None;
                    continue;
                }
            };
            if !page.is_sound() {
                damaged.push(page_damage("checksum mismatch".to_owned()));
                expected_base = None;
                continue;
            }
            let records = (ranks.end - ranks.start) as usize;
            let unit = u64::from(self.header().block_length_unit);
            let end = page
                .base()
                .checked_add(page.length_units(0..records) * unit);
            let is_last = number + 1 == self.pages();
            let joins = expected_base.is_none_or(|base| base == page.base())
                && (!is_last || end == Some(self.blocks_length()));
            expected_base = end.filter(|_| joins);
            if joins {
                self.verify_groups(&page, ranks.start, &mut damaged);
            } else {
                damaged.push(page_damage(
                    "its blocks do not join their neighbours".to_owned(),
                ));
            }
        }
        Verification { damaged }
    }

    fn verify_groups(&self, page: &Page, first_rank: u64, damaged: &mut Vec<Damage>) {
        let mut scratch = Vec::new();
        for group in 0..page.groups() {
            let records = page.group_records(group);
            let (first, last) = (records.start as u64, records.end as u64 - 1);
            let cause = match self.read_blocks(page, first_rank, records, &mut scratch) {
                Ok(bytes) if crc32fast::hash(bytes) == page.group_checksum(group) => continue,
                Ok(_) => "checksum mismatch".to_owned(),
                Err(error) => cause(error),
            };
            damaged.push(Damage {
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
