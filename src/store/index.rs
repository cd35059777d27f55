//! The index: its pages of records, and where things lie in them.

use std::ops::Range;

/// Records in a full page.
pub const BLOCKS_PER_PAGE: u64 = 64;
/// Consecutive blocks that share a checksum.
pub const BLOCKS_PER_GROUP: u64 = 8;

/// Groups in a full page.
pub(super) const GROUPS_PER_PAGE: usize = (BLOCKS_PER_PAGE / BLOCKS_PER_GROUP) as usize;
const GROUP: usize = BLOCKS_PER_GROUP as usize;
const BASE_LENGTH: usize = 8;
const CHECKSUM_LENGTH: usize = 4;

/// What the index says of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record {
    /// Bytes of the block, its padding included.
    pub length: u32,
    /// The stored error; its meaning is the codec's, as that of the other codes.
    pub error_code: u8,
    /// The lower end of the range of heights.
    pub low_code: u8,
    /// The upper end of the range of heights.
    pub high_code: u8,
}

/// Bytes of a page of `records`.
pub(super) const fn page_length(records: usize) -> usize {
    BASE_LENGTH + 5 * records + CHECKSUM_LENGTH * records.div_ceil(GROUP) + CHECKSUM_LENGTH
}

/// Bytes of an index of `count` blocks, or `None` where they exceed 64 bits.
pub(super) fn section_length(count: u64) -> Option<u64> {
    let full =
        (count / BLOCKS_PER_PAGE).checked_mul(page_length(BLOCKS_PER_PAGE as usize) as u64)?;
    match (count % BLOCKS_PER_PAGE) as usize {
        0 => Some(full),
        rest => full.checked_add(page_length(rest) as u64),
    }
}

/// Offset of a page within the index.
pub(super) fn page_offset(page: u64) -> u64 {
    page * page_length(BLOCKS_PER_PAGE as usize) as u64
}

/// Ranks of the blocks of a page in an index of `count` blocks.
pub(super) fn page_ranks(page: u64, count: u64) -> Range<u64> {
    let first = page * BLOCKS_PER_PAGE;
    first..count.min(first + BLOCKS_PER_PAGE)
}

/// The bytes of one page, as many as its records need.
#[derive(Clone, Copy)]
pub(super) struct Page<'a> {
    bytes: &'a [u8],
    records: usize,
}

impl<'a> Page<'a> {
    /// `bytes` has [`page_length`]`(records)` bytes.
    pub(super) fn new(bytes: &'a [u8], records: usize) -> Page<'a> {
        debug_assert_eq!(bytes.len(), page_length(records));
        Page { bytes, records }
    }

    /// Whether the page's checksum is right.
    pub(super) fn is_sound(&self) -> bool {
        let end = self.bytes.len() - CHECKSUM_LENGTH;
        crc32fast::hash(&self.bytes[..end]) == self.u32(end)
    }

    /// Offset of the page's first block within the blocks section.
    pub(super) fn base(&self) -> u64 {
        u64::from(self.u32(0)) | u64::from(self.u32(4)) << 32
    }

    /// Units of length of the blocks of a range of records.
    #[inline]
    pub(super) fn length_units(&self, records: Range<usize>) -> u64 {
        let lengths = &self.bytes[BASE_LENGTH + 2 * records.start..BASE_LENGTH + 2 * records.end];
        let lengths = lengths.as_chunks::<2>().0;
        // A page has 64 records at most: 32 bits hold the sum, in vectors of twice as many as 64 bits.
        let units: u32 = lengths
            .iter()
            .map(|length| u32::from(u16::from_le_bytes(*length)))
            .sum();
        u64::from(units)
    }

    /// Error, low and high code of a record.
    pub(super) fn codes(&self, record: usize) -> [u8; 3] {
        let first = BASE_LENGTH + 2 * self.records + record;
        [0, 1, 2].map(|array| self.bytes[first + array * self.records])
    }

    /// Count of groups.
    pub(super) fn groups(&self) -> usize {
        self.records.div_ceil(GROUP)
    }

    /// Records of a group.
    pub(super) fn group_records(&self, group: usize) -> Range<usize> {
        group * GROUP..self.records.min((group + 1) * GROUP)
    }

    /// Checksum of a group's blocks.
    pub(super) fn group_checksum(&self, group: usize) -> u32 {
        self.u32(BASE_LENGTH + 5 * self.records + CHECKSUM_LENGTH * group)
    }

    fn u32(&self, offset: usize) -> u32 {
        let bytes = &self.bytes[offset..offset + 4];
        bytes
            .iter()
            .rev()
            .fold(0, |number, byte| number << 8 | u32::from(*byte))
    }
}

/// Appends a page. The slices hold a value a record; `groups` one checksum a group.
pub(super) fn put_page(
    out: &mut Vec<u8>,
    base: u64,
    lengths: &[u16],
    codes: &[[u8; 3]],
    groups: &[u32],
) {
    let start = out.len();
    out.extend(base.to_le_bytes());
    out.extend(lengths.iter().flat_map(|length| length.to_le_bytes()));
    for array in 0..3 {
        out.extend(codes.iter().map(|codes| codes[array]));
    }
    out.extend(groups.iter().flat_map(|checksum| checksum.to_le_bytes()));
    let checksum = crc32fast::hash(&out[start..]);
    out.extend(checksum.to_le_bytes());
}
