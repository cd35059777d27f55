//! A copy of a repository that holds what is sound, and marks the rest as missing.
//!
//! No checksum is made anew over bytes of the old file: those of blocks are copied with the blocks that they
//! were just compared with, and a page that is written holds only what a page with a right checksum said.

use std::path::Path;

use super::header::{HEADER_LENGTH, Layout, Section};
use super::index::{self, BLOCKS_PER_GROUP, MISSING, Page};
use super::reader::Store;
use super::sink::Sink;
use super::verify::PageWalk;
use super::writer::Output;
use crate::Result;

/// What a repair has of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kept {
    /// Its rank.
    pub rank: u64,
    /// Its error, low and high code; `None` where its page of the index is damaged.
    pub codes: Option<[u8; 3]>,
    /// Its bytes are lost, now or since an earlier repair.
    pub is_missing: bool,
}

/// What [`Store::repair`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repaired {
    /// Blocks that were damaged, or whose page of the index was.
    pub damaged_blocks: u64,
    /// Those of them that are now missing. The others lay in a page of which a single bit was wrong.
    pub lost_blocks: u64,
    /// All blocks that are missing, those of earlier repairs too.
    pub missing_blocks: u64,
    /// Bytes of the repaired file.
    pub bytes: u64,
}

impl Store {
    /// Writes a copy of the repository into a sink, without what is damaged; `path` only names the sink in
    /// errors. `recode` is told of every block in the order of ranks, and answers with its error, low and high
    /// code in the copy. A repository without damage is copied byte for byte; where `keep_sound` is set, it
    /// is left alone, and nothing is published.
    ///
    /// # Errors
    ///
    /// [`Error::Version`] for a file that a later version wrote; [`Error::Io`] of writing; those of `recode`.
    /// The sink is then dropped unpublished.
    pub fn repair(
        &self,
        path: &Path,
        sink: Box<dyn Sink>,
        keep_sound: bool,
        recode: &mut dyn FnMut(Kept) -> Result<[u8; 3]>,
    ) -> Result<Repaired> {
        self.check_writable()?;
        let sections = self.sections()?;
        let mut layout = copied_layout(self.layout());
        let mut out = Output::new(path, sink);
        out.seek(layout.metadata.offset)?;
        for section in &sections {
            out.put(section)?;
        }
        out.seek(layout.blocks.offset)?;
        let mut copy = Copy {
            store: self,
            out,
            index: Vec::new(),
            base: 0,
            repaired: Repaired::default(),
            recode,
        };
        copy.run()?;
        let Copy {
            mut out,
            index,
            base,
            mut repaired,
            ..
        } = copy;
        layout.blocks.length = base;
        layout.file_length = layout.blocks.offset + base;
        layout.has_missing = repaired.missing_blocks > 0;
        repaired.bytes = layout.file_length;
        if keep_sound && repaired.damaged_blocks == 0 && self.ends_right() {
            return Ok(repaired);
        }
        out.seek(layout.index.offset)?;
        out.put(&index)?;
        out.seek(0)?;
        out.put(&self.header().encode(&layout))?;
        out.publish()?;
        Ok(repaired)
    }
}

/// The layout of a copy whose blocks are not known yet: sections follow each other.
fn copied_layout(old: &Layout) -> Layout {
    let mut offset = HEADER_LENGTH as u64;
    let mut section = |length: u64| {
        let placed = Section { offset, length };
        offset += length;
        placed
    };
    Layout {
        metadata: section(old.metadata.length),
        roots: section(old.roots.length),
        tables: section(old.tables.length),
        index: section(old.index.length),
        blocks: section(0),
        checksums: old.checksums,
        file_length: 0,
        has_missing: false,
    }
}

/// A copy in the making.
struct Copy<'a> {
    store: &'a Store,
    out: Output,
    /// The pages so far.
    index: Vec<u8>,
    /// Bytes of blocks so far.
    base: u64,
    repaired: Repaired,
    recode: &'a mut dyn FnMut(Kept) -> Result<[u8; 3]>,
}

impl Copy<'_> {
    fn run(&mut self) -> Result<()> {
        let mut walk = PageWalk::new();
        let mut scratch = Vec::new();
        for number in 0..self.store.pages() {
            let ranks = self.store.page_ranks(number);
            let records = (ranks.end - ranks.start) as usize;
            let Ok(page) = self.store.read_page(number, &mut scratch) else {
                walk.lose_place();
                self.put_page(None, ranks.start, records)?;
                continue;
            };
            let mut corrected_walk = walk;
            if walk.judge(self.store, number, &page).is_ok() {
                self.put_page(Some(&page), ranks.start, records)?;
                continue;
            }
            let turned = page.with_one_bit_turned();
            let corrected = turned.as_deref().map(|bytes| Page::new(bytes, records));
            let corrected =
                corrected.filter(|page| corrected_walk.judge(self.store, number, page).is_ok());
            let lost = self.put_page(corrected.as_ref(), ranks.start, records)?;
            if corrected.is_some() {
                walk = corrected_walk;
                self.repaired.damaged_blocks += records as u64 - lost;
            }
        }
        Ok(())
    }

    /// Copies the blocks of a page whose records can be trusted, or marks all as missing. Returns how many were
    /// lost.
    fn put_page(&mut self, page: Option<&Page>, first_rank: u64, records: usize) -> Result<u64> {
        let base = self.base;
        let mut lost = 0;
        let (mut lengths, mut checksums) = (Vec::new(), Vec::new());
        for group in 0..records.div_ceil(BLOCKS_PER_GROUP as usize) {
            let checksum = match page {
                Some(page) => self.copy_group(page, first_rank, group, &mut lengths)?,
                None => None,
            };
            let end = records.min((group + 1) * BLOCKS_PER_GROUP as usize);
            if checksum.is_none() {
                lost += (end - lengths.len()) as u64;
                lengths.resize(end, MISSING);
            }
            checksums.push(checksum.unwrap_or(crc32fast::hash(&[])));
        }
        self.repaired.lost_blocks += lost;
        self.repaired.damaged_blocks += lost;
        let mut codes = Vec::with_capacity(records);
        for (record, &length) in lengths.iter().enumerate() {
            let is_missing = length == MISSING;
            self.repaired.missing_blocks += u64::from(is_missing);
            codes.push((self.recode)(Kept {
                rank: first_rank + record as u64,
                codes: page.map(|page| page.codes(record)),
                is_missing,
            })?);
        }
        index::put_page(&mut self.index, base, &lengths, &codes, &checksums);
        Ok(lost)
    }

    /// Copies the blocks of a group and appends their lengths; its checksum, or `None` where it is damaged.
    fn copy_group(
        &mut self,
        page: &Page,
        first_rank: u64,
        group: usize,
        lengths: &mut Vec<u16>,
    ) -> Result<Option<u32>> {
        let records = page.group_records(group);
        let checksum = page.group_checksum(group);
        let mut scratch = Vec::new();
        let read = self
            .store
            .read_blocks(page, first_rank, records.clone(), &mut scratch);
        let Some(bytes) = read.ok().filter(|bytes| crc32fast::hash(bytes) == checksum) else {
            return Ok(None);
        };
        self.out.put(bytes)?;
        self.base += bytes.len() as u64;
        lengths.extend(page.lengths(records));
        Ok(Some(checksum))
    }
}
