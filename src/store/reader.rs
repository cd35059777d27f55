//! The reader of a packed repository.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU16, Ordering};

use super::bytes::{self, Access, Bytes};
use super::header::{
    self, HEADER_LENGTH, Header, Layout, PREFIX_LENGTH, Prefix, READ_VERSION, Section,
    WRITE_VERSION,
};
use super::index::{self, BLOCKS_PER_GROUP, BLOCKS_PER_PAGE, GROUPS_PER_PAGE, Page, Record};
use super::memory::Memory;
use super::metadata;
use crate::{Error, Result};

/// The bit of a page in [`Store::verified`]; those below are its groups'.
const PAGE_BIT: u16 = 1 << GROUPS_PER_PAGE;

/// An open repository: header, roots and tables in memory, blocks by rank from the file.
///
/// Any number of threads may use one store at once, without waiting for each other.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    bytes: Box<dyn Bytes>,
    header: Header,
    write_version: u16,
    layout: Layout,
    roots: Vec<u8>,
    tables: Vec<u8>,
    /// An element a page: what was found sound since the file was opened. A bit only saves work: it
    /// publishes no data, and what it stands for is never trusted for bounds.
    verified: Vec<AtomicU16>,
}

impl Store {
    /// Opens the repository at `path`, and reads and verifies its header, metadata, roots and tables.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] where the file cannot be opened or read, [`Error::Argument`] for an empty path,
    /// [`Error::Input`] for a file that is no repository, [`Error::Version`] for one that a later
    /// version wrote in a way that this one cannot read, [`Error::Damaged`] otherwise.
    pub fn open(path: &Path, access: Access) -> Result<Store> {
        Store::read(path, bytes::open(path, access)?, Extent::Whole)
    }

    /// As [`open`](Store::open), also a file that was cut off behind its index, or that has bytes after its end:
    /// for a repair. It is read by positioned reads, so that a medium that fails is an error.
    pub fn open_damaged(path: &Path) -> Result<Store> {
        Store::read(
            path,
            bytes::open(path, Access::Positioned)?,
            Extent::ToIndex,
        )
    }

    /// As [`open`](Store::open), a repository that is only bytes; `name` stands for its path in errors.
    pub fn of_bytes(name: &Path, bytes: Vec<u8>) -> Result<Store> {
        Store::read(name, Box::new(Memory(bytes)), Extent::Whole)
    }

    fn read(path: &Path, bytes: Box<dyn Bytes>, extent: Extent) -> Result<Store> {
        let (mut header, layout, write_version) = read_header(path, bytes.as_ref(), extent)?;
        let [described, roots, tables] = read_sections(path, bytes.as_ref(), &layout)?;
        metadata::decode(&described, &mut header.raster)
            .map_err(|cause| Error::damaged(path, format!("metadata: {cause}")))?;
        let verified = unverified(path, header.block_count.div_ceil(BLOCKS_PER_PAGE))?;
        Ok(Store {
            path: path.to_path_buf(),
            bytes,
            header,
            write_version,
            layout,
            roots,
            tables,
            verified,
        })
    }

    /// Says whether another file may be made out of this one, which is not so if a later version wrote it.
    ///
    /// # Errors
    ///
    /// [`Error::Version`].
    pub fn check_writable(&self) -> Result<()> {
        let version = self.write_version;
        if version == WRITE_VERSION {
            return Ok(());
        }
        let message = format!("has write version {version}; this library writes {WRITE_VERSION}");
        Err(Error::Version {
            path: self.path.clone(),
            message,
        })
    }

    /// Whether the file ends where its header says.
    pub(super) fn ends_right(&self) -> bool {
        self.bytes.length() == self.layout.file_length
    }

    /// Where the sections lie.
    pub(super) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Metadata, roots and tables as they are stored, read and verified again.
    pub(super) fn sections(&self) -> Result<[Vec<u8>; 3]> {
        read_sections(&self.path, self.bytes.as_ref(), &self.layout)
    }

    /// What header and metadata say.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The path that the store was opened with.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The roots payload.
    pub fn roots(&self) -> &[u8] {
        &self.roots
    }

    /// The tables payload; may be empty.
    pub fn tables(&self) -> &[u8] {
        &self.tables
    }

    /// Bytes of the whole file.
    pub fn file_bytes(&self) -> u64 {
        self.layout.file_length
    }

    /// Whether the header says that blocks are missing since a repair.
    pub fn has_missing(&self) -> bool {
        self.layout.has_missing
    }

    /// Bytes of roots, tables and blocks; the rest of the file is overhead.
    pub fn payload_bytes(&self) -> u64 {
        self.layout.roots.length + self.layout.tables.length + self.layout.blocks.length
    }

    /// What the index says of the block of this rank. The index page is verified on first use.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a rank that does not exist, [`Error::Damaged`] naming the page,
    /// [`Error::Io`].
    pub fn record(&self, rank: u64) -> Result<Record> {
        let mut scratch = Vec::new();
        let (page, _, record) = self.locate(rank, &mut scratch)?;
        let units = page.length_units(record..record + 1);
        let [error_code, low_code, high_code] = page.codes(record);
        let length = units as u32 * u32::from(self.header.block_length_unit);
        Ok(Record {
            length,
            is_missing: page.is_missing(record),
            error_code,
            low_code,
            high_code,
        })
    }

    /// The block of this rank, its padding included: the file's own bytes where it is mapped, else a copy
    /// in `scratch`, whose old content is lost. The group of up to 8 blocks around it is verified on
    /// first use.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a rank that does not exist, [`Error::Damaged`] naming the page or the
    /// blocks, [`Error::Missing`] for one that was lost in a repair, [`Error::Io`].
    pub fn block<'a>(&'a self, rank: u64, scratch: &'a mut Vec<u8>) -> Result<&'a [u8]> {
        let mut page_scratch = Vec::new();
        let (page, verified, record) = self.locate(rank, &mut page_scratch)?;
        if page.is_missing(record) {
            return Err(Error::Missing {
                path: self.path.clone(),
                message: format!("block {rank} was lost in a repair"),
            });
        }
        let group = record / BLOCKS_PER_GROUP as usize;
        let group_bit = 1 << group;
        if verified.load(Ordering::Relaxed) & group_bit != 0 {
            return self.read_blocks(&page, rank - record as u64, record..record + 1, scratch);
        }
        let records = page.group_records(group);
        let bytes = self.read_blocks(&page, rank - record as u64, records.clone(), scratch)?;
        if crc32fast::hash(bytes) != page.group_checksum(group) {
            let first = rank - record as u64 + records.start as u64;
            return Err(self.damaged_blocks(first, records.len(), "checksum mismatch"));
        }
        verified.fetch_or(group_bit, Ordering::Relaxed);
        let unit = usize::from(self.header.block_length_unit);
        let start = page.length_units(records.start..record) as usize * unit;
        let length = page.length_units(record..record + 1) as usize * unit;
        Ok(&bytes[start..start + length])
    }

    /// The verified page of a rank, its element of `verified`, and the rank's record in the page.
    #[inline]
    fn locate<'a>(
        &'a self,
        rank: u64,
        scratch: &'a mut Vec<u8>,
    ) -> Result<(Page<'a>, &'a AtomicU16, usize)> {
        let count = self.header.block_count;
        let number = rank / BLOCKS_PER_PAGE;
        let verified = usize::try_from(number)
            .ok()
            .and_then(|number| self.verified.get(number));
        let Some(verified) = verified.filter(|_| rank < count) else {
            let message = format!("there is no block {rank}, only {count} blocks");
            return Err(Error::Argument(format!(
                "{}: {message}",
                self.path.display()
            )));
        };
        let page = self.read_page(number, scratch)?;
        if verified.load(Ordering::Relaxed) & PAGE_BIT == 0 {
            if !page.is_sound() {
                let (first, last) = (number * BLOCKS_PER_PAGE, self.page_ranks(number).end - 1);
                let message =
                    format!("index page {number} (blocks {first} to {last}): checksum mismatch");
                return Err(Error::damaged(&self.path, message));
            }
            verified.fetch_or(PAGE_BIT, Ordering::Relaxed);
        }
        Ok((page, verified, (rank % BLOCKS_PER_PAGE) as usize))
    }

    /// Count of index pages.
    pub(super) fn pages(&self) -> u64 {
        self.verified.len() as u64
    }

    /// Bytes of the blocks section.
    pub(super) fn blocks_length(&self) -> u64 {
        self.layout.blocks.length
    }

    /// Ranks of the blocks of an existing page.
    pub(super) fn page_ranks(&self, page: u64) -> Range<u64> {
        index::page_ranks(page, self.header.block_count)
    }

    /// An existing page, not verified.
    pub(super) fn read_page<'a>(
        &'a self,
        number: u64,
        scratch: &'a mut Vec<u8>,
    ) -> Result<Page<'a>> {
        let ranks = self.page_ranks(number);
        let records = (ranks.end - ranks.start) as usize;
        let offset = self.layout.index.offset + index::page_offset(number);
        let length = index::page_length(records) as u64;
        let bytes = read(
            &self.path,
            self.bytes.as_ref(),
            "index",
            offset,
            length,
            scratch,
        )?;
        Ok(Page::new(bytes, records))
    }

    /// The bytes of consecutive blocks of a page whose first block has rank `first_rank`. Only their
    /// place is checked.
    pub(super) fn read_blocks<'a>(
        &'a self,
        page: &Page,
        first_rank: u64,
        records: Range<usize>,
        scratch: &'a mut Vec<u8>,
    ) -> Result<&'a [u8]> {
        let unit = u64::from(self.header.block_length_unit);
        let before = page.length_units(0..records.start) * unit;
        let length = page.length_units(records.clone()) * unit;
        let Section {
            offset,
            length: available,
        } = self.layout.blocks;
        let first = first_rank + records.start as u64;
        let start = page.base().checked_add(before).filter(|start| {
            start
                .checked_add(length)
                .is_some_and(|end| end <= available)
        });
        let Some(start) = start else {
            let cause = format!("the index puts them outside the section of {available} bytes");
            return Err(self.damaged_blocks(first, records.len(), &cause));
        };
        read(
            &self.path,
            self.bytes.as_ref(),
            "blocks",
            offset + start,
            length,
            scratch,
        )
    }

    fn damaged_blocks(&self, first: u64, count: usize, cause: &str) -> Error {
        let last = first + count as u64 - 1;
        Error::damaged(&self.path, format!("blocks {first} to {last}: {cause}"))
    }
}

/// How much of a file must be there to open it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Extent {
    /// All, and nothing more.
    Whole,
    /// Everything up to the end of the index.
    ToIndex,
}

/// Reads metadata, roots and tables and verifies their checksums.
fn read_sections(path: &Path, bytes: &dyn Bytes, layout: &Layout) -> Result<[Vec<u8>; 3]> {
    let section = |name: &str, section: Section, checksum: u32| -> Result<Vec<u8>> {
        let mut scratch = Vec::new();
        let Section { offset, length } = section;
        let found = read(path, bytes, name, offset, length, &mut scratch)?;
        if crc32fast::hash(found) != checksum {
            return Err(Error::damaged(path, format!("{name}: checksum mismatch")));
        }
        Ok(found.to_vec())
    };
    let [metadata, roots, tables] = layout.checksums;
    Ok([
        section("metadata", layout.metadata, metadata)?,
        section("roots", layout.roots, roots)?,
        section("tables", layout.tables, tables)?,
    ])
}

/// Reads and checks the header of a file, whose write version comes last; the raster's metadata is still
/// empty.
fn read_header(path: &Path, bytes: &dyn Bytes, extent: Extent) -> Result<(Header, Layout, u16)> {
    let damaged = |cause: String| Error::damaged(path, format!("header: {cause}"));
    let file_length = bytes.length();
    let truncated = |expected: u64| {
        let message = format!("truncated: it has {file_length} bytes of at least {expected}");
        Error::damaged(path, message)
    };
    let mut scratch = Vec::new();
    let prefix_length = file_length.min(PREFIX_LENGTH as u64);
    let prefix = read(path, bytes, "header", 0, prefix_length, &mut scratch)?;
    let length = match header::read_prefix(prefix).map_err(damaged)? {
        Prefix::Foreign => return Err(Error::input(path, "not a Kimberlite repository")),
        Prefix::Short => return Err(truncated(HEADER_LENGTH as u64)),
        Prefix::Header(length) => length as u64,
    };
    if file_length < length {
        return Err(truncated(length));
    }
    let found = read(path, bytes, "header", 0, length, &mut scratch)?;
    let version = header::read_version(found).map_err(damaged)?;
    if version != READ_VERSION {
        let message = format!("has read version {version}; this library reads {READ_VERSION}");
        return Err(Error::Version {
            path: path.to_path_buf(),
            message,
        });
    }
    let write_version = header::write_version(found).map_err(damaged)?;
    let (header, layout) = header::decode(found).map_err(damaged)?;
    let expected = layout.file_length;
    let needed = match extent {
        Extent::Whole => expected,
        Extent::ToIndex => layout.index.offset + layout.index.length,
    };
    if file_length < needed {
        let message = format!("truncated: it has {file_length} bytes of {expected}");
        return Err(Error::damaged(path, message));
    }
    if file_length > expected && extent == Extent::Whole {
        let message = format!(
            "{} bytes after its end at {expected}",
            file_length - expected
        );
        return Err(Error::damaged(path, message));
    }
    Ok((header, layout, write_version))
}

/// One zero a page. The count is bounded by the file's length, since the index holds the pages.
fn unverified(path: &Path, pages: u64) -> Result<Vec<AtomicU16>> {
    let mut verified = Vec::new();
    let reserved = usize::try_from(pages).ok().and_then(|pages| {
        verified.try_reserve_exact(pages).ok()?;
        Some(pages)
    });
    let Some(pages) = reserved else {
        return Err(Error::io(path, "cannot open")(
            io::ErrorKind::OutOfMemory.into(),
        ));
    };
    verified.resize_with(pages, || AtomicU16::new(0));
    Ok(verified)
}

/// `length` bytes at `offset` of a file; `what` names the place in errors.
#[inline]
fn read<'a>(
    path: &Path,
    bytes: &'a dyn Bytes,
    what: &str,
    offset: u64,
    length: u64,
    scratch: &'a mut Vec<u8>,
) -> Result<&'a [u8]> {
    let length = usize::try_from(length).map_err(|_| {
        Error::damaged(
            path,
            format!("{what}: {length} bytes exceed the address space"),
        )
    })?;
    bytes
        .read(offset, length, scratch)
        .map_err(|source| match source.kind() {
            io::ErrorKind::UnexpectedEof => {
                let message = format!("{what}: the file ends before {length} bytes at {offset}");
                Error::damaged(path, message)
            }
            _ => Error::io(path, "cannot read")(source),
        })
}
