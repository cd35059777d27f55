//! The writer of a packed repository.

use std::io;
use std::path::{Path, PathBuf};

use super::header::{HEADER_LENGTH, Header, Layout, SECTION_LIMIT, Section};
use super::index::{self, BLOCKS_PER_GROUP, BLOCKS_PER_PAGE};
use super::metadata;
use super::sink::{FileSink, Sink};
use crate::geo::RasterInfo;
use crate::{Error, Result};

/// Bytes gathered before they are written.
const BUFFER_LENGTH: usize = 1 << 20;

/// Writes a repository block by block, in the order of ranks, under a temporary name; only
/// [`finish`](Writer::finish) gives it its own. A writer that is dropped leaves nothing.
///
/// All but codes and measured numbers is known before the first block, so that every byte goes to its
/// final place at once. Memory: a buffer of 1 MiB, and 2.5 bytes a block for the index.
pub struct Writer {
    out: Output,
    layout: Layout,
    /// Whose metadata stands in the file.
    raster: RasterInfo,
    block_count: u64,
    block_length_unit: u8,
    /// Length of each block so far, in units.
    lengths: Vec<u16>,
    /// Checksum of each complete group.
    group_checksums: Vec<u32>,
    /// Checksum of the group that is being written.
    group: crc32fast::Hasher,
}

impl Writer {
    /// Begins a repository at `path`. Of `header`, the metadata (`crs`, `units` and `metadata` of the
    /// raster), the count of blocks and their length unit are final; the rest may still change until
    /// [`finish`](Writer::finish).
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for numbers or sizes that the format does not allow; [`Error::Io`], also
    /// where the folder of `path` does not exist or the medium is full.
    pub fn create(path: &Path, header: &Header, roots: &[u8], tables: &[u8]) -> Result<Writer> {
        if path.as_os_str().is_empty() {
            return Err(Error::Argument(
                "the path of the repository is empty".to_owned(),
            ));
        }
        Writer::with_sink(
            path,
            Box::new(FileSink::create(path)?),
            header,
            roots,
            tables,
        )
    }

    /// As [`create`](Writer::create), into a sink; `path` only names it in errors.
    pub fn with_sink(
        path: &Path,
        sink: Box<dyn Sink>,
        header: &Header,
        roots: &[u8],
        tables: &[u8],
    ) -> Result<Writer> {
        header.check().map_err(Error::Argument)?;
        let metadata = metadata::encode(&header.raster).map_err(Error::Argument)?;
        let index_length = index::section_length(header.block_count)
            .ok_or_else(|| Error::Argument(format!("{} blocks", header.block_count)))?;
        let mut end = HEADER_LENGTH as u64;
        let mut section = |length: u64| {
            let offset = end;
            end = end.saturating_add(length);
            Section { offset, length }
        };
        let layout = Layout {
            metadata: section(metadata.len() as u64),
            roots: section(roots.len() as u64),
            tables: section(tables.len() as u64),
            index: section(index_length),
            blocks: section(0),
            checksums: [&metadata, roots, tables].map(crc32fast::hash),
            file_length: 0,
            has_missing: false,
        };
        let mut out = Output::new(path, sink);
        out.seek(layout.metadata.offset)?;
        for (name, bytes) in [
            ("metadata", &metadata[..]),
            ("roots", roots),
            ("tables", tables),
        ] {
            if bytes.len() as u64 > SECTION_LIMIT {
                let message = format!("{name} of {} bytes exceed {SECTION_LIMIT}", bytes.len());
                return Err(Error::Argument(message));
            }
            out.put(bytes)?;
        }
        out.seek(layout.blocks.offset)?;
        Ok(Writer {
            out,
            layout,
            raster: header.raster.clone(),
            block_count: header.block_count,
            block_length_unit: header.block_length_unit,
            lengths: Vec::new(),
            group_checksums: Vec::new(),
            group: crc32fast::Hasher::new(),
        })
    }

    /// Appends the block of the next rank, padded to the length unit.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a block of more than 65534 units or beyond the count; [`Error::Io`].
    /// After an error the writer can only be dropped.
    pub fn push(&mut self, block: &[u8]) -> Result<()> {
        let rank = self.lengths.len() as u64;
        if rank == self.block_count {
            return Err(Error::Argument(format!("more than {rank} blocks")));
        }
        let unit = usize::from(self.block_length_unit);
        let length = u16::try_from(block.len().div_ceil(unit)).ok();
        let Some(length) = length.filter(|length| *length <= index::LONGEST_UNITS) else {
            let message = format!("block {rank} has {} bytes, too many", block.len());
            return Err(Error::Argument(message));
        };
        let padding = &[0; 8][..usize::from(length) * unit - block.len()];
        for bytes in [block, padding] {
            self.group.update(bytes);
            self.out.put(bytes)?;
        }
        self.layout.blocks.length += u64::from(length) * unit as u64;
        self.lengths.push(length);
        if (rank + 1).is_multiple_of(BLOCKS_PER_GROUP) || rank + 1 == self.block_count {
            self.group_checksums
                .push(std::mem::take(&mut self.group).finalize());
        }
        Ok(())
    }

    /// Returns once all blocks so far are on the medium.
    ///
    /// # Errors
    ///
    /// [`Error::Io`]. After an error the writer can only be dropped.
    pub fn sync(&mut self) -> Result<()> {
        self.out.sync()
    }

    /// Writes index and header, syncs, and gives the file its name. `codes` are the error, low and high
    /// code of each block, by rank. Returns the file's length in bytes.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] where blocks or codes are missing or `header` contradicts that of
    /// [`create`](Writer::create); [`Error::Io`]. After an error no file has the name, except where
    /// the file is whole and only the folder could not be synced.
    pub fn finish(mut self, header: &Header, codes: &[[u8; 3]]) -> Result<u64> {
        header.check().map_err(Error::Argument)?;
        let same = header.block_count == self.block_count
            && header.block_length_unit == self.block_length_unit
            && header.raster.crs == self.raster.crs
            && header.raster.units == self.raster.units
            && header.raster.metadata == self.raster.metadata;
        if !same {
            let message = "metadata or count of blocks changed while the repository was written";
            return Err(Error::Argument(message.to_owned()));
        }
        let (blocks, codes_count) = (self.lengths.len() as u64, codes.len() as u64);
        if blocks != self.block_count || codes_count != self.block_count {
            let count = self.block_count;
            let message = format!("{blocks} blocks and {codes_count} codes instead of {count}");
            return Err(Error::Argument(message));
        }
        self.layout.file_length = self.layout.blocks.offset + self.layout.blocks.length;
        self.put_index(codes)?;
        self.out.seek(0)?;
        self.out.put(&header.encode(&self.layout))?;
        self.out.publish()?;
        Ok(self.layout.file_length)
    }

    fn put_index(&mut self, codes: &[[u8; 3]]) -> Result<()> {
        self.out.seek(self.layout.index.offset)?;
        let records = BLOCKS_PER_PAGE as usize;
        let groups = self
            .group_checksums
            .chunks(records / BLOCKS_PER_GROUP as usize);
        let mut base = 0;
        let mut page = Vec::new();
        for ((lengths, codes), groups) in self
            .lengths
            .chunks(records)
            .zip(codes.chunks(records))
            .zip(groups)
        {
            page.clear();
            index::put_page(&mut page, base, lengths, codes, groups);
            self.out.put(&page)?;
            let units: u64 = lengths.iter().map(|length| u64::from(*length)).sum();
            base += units * u64::from(self.block_length_unit);
        }
        Ok(())
    }
}

/// Bytes of a file without metadata, with sections of these lengths and this count of blocks.
pub fn file_length(roots: u64, tables: u64, block_count: u64, blocks: u64) -> u64 {
    let index = index::section_length(block_count).unwrap_or(u64::MAX);
    [roots, tables, index, blocks]
        .into_iter()
        .fold(HEADER_LENGTH as u64, u64::saturating_add)
}

/// A sink with a buffer before it.
pub(super) struct Output {
    path: PathBuf,
    sink: Box<dyn Sink>,
    /// Where the buffer's first byte belongs.
    offset: u64,
    buffer: Vec<u8>,
    /// Whether a write failed, after which nobody knows what belongs where.
    failed: bool,
}

impl Output {
    pub(super) fn new(path: &Path, sink: Box<dyn Sink>) -> Output {
        Output {
            path: path.to_path_buf(),
            sink,
            offset: 0,
            buffer: Vec::new(),
            failed: false,
        }
    }

    pub(super) fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.buffer.extend(bytes);
        if self.buffer.len() < BUFFER_LENGTH {
            Ok(())
        } else {
            self.flush()
        }
    }

    fn flush(&mut self) -> Result<()> {
        if self.failed {
            let message = format!("{}: an earlier write failed", self.path.display());
            return Err(Error::Argument(message));
        }
        self.failed = true;
        let mut rest = &self.buffer[..];
        while !rest.is_empty() {
            match self.sink.write_at(self.offset, rest) {
                Ok(0) => {
                    return Err(Error::io(&self.path, "cannot write")(
                        io::ErrorKind::WriteZero.into(),
                    ));
                }
                Ok(count) => {
                    rest = &rest[count..];
                    self.offset += count as u64;
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(Error::io(&self.path, "cannot write")(error)),
            }
        }
        self.failed = false;
        self.buffer.clear();
        Ok(())
    }

    /// Writes what is gathered; the next bytes belong at `offset`.
    pub(super) fn seek(&mut self, offset: u64) -> Result<()> {
        self.flush()?;
        self.offset = offset;
        Ok(())
    }

    pub(super) fn sync(&mut self) -> Result<()> {
        self.flush()?;
        let synced = self.sink.sync();
        synced.map_err(Error::io(&self.path, "cannot sync"))
    }

    pub(super) fn publish(mut self) -> Result<()> {
        self.sync()?;
        let published = self.sink.publish();
        published.map_err(Error::io(
            &self.path,
            "cannot give the finished file its name",
        ))
    }
}
