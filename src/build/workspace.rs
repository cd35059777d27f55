//! Where a build keeps what it does not need at once: in memory, or in temporary files.

use super::working_store::{self, WorkingStore};
use crate::positioned::{read_exact_at, write_all_at};
use crate::{Error, Result};
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes gathered before they are written to a file.
const BUFFER_LENGTH: usize = 1 << 20;
/// Bytes of a [`Spill`]'s seal: its length, and its checksum.
const SEAL_LENGTH: usize = 12;

/// Chooses where bytes are kept.
#[derive(Clone)]
pub(super) enum Workspace {
    /// In memory.
    Memory,
    /// In files without a name in this folder, which the system forgets with the process.
    Folder(PathBuf),
    /// In files of a working store, under names that begin so.
    Store(Arc<WorkingStore>, &'static str),
}

impl Workspace {
    /// The same place, under other names.
    pub(super) fn part(&self, part: &'static str) -> Workspace {
        match self {
            Workspace::Store(store, _) => Workspace::Store(store.clone(), part),
            other => other.clone(),
        }
    }

    /// What [`save`](Self::save) kept before the process was killed.
    pub(super) fn load(&self, key: &str) -> Result<Option<Vec<u8>>> {
        match self {
            Workspace::Store(store, part) => store.get(&format!("{part}/{key}")),
            _ => Ok(None),
        }
    }

    /// Keeps entries for a build that goes on after this one was killed: all of them or none.
    pub(super) fn save(&self, entries: Vec<(String, Vec<u8>)>) -> Result<()> {
        let Workspace::Store(store, part) = self else {
            return Ok(());
        };
        let entries = entries.into_iter();
        let entries: Vec<_> = entries
            .map(|(key, value)| (format!("{part}/{key}"), value))
            .collect();
        store.put(&entries)
    }

    /// Something of the working store is not as it was written.
    pub(super) fn damaged(&self, what: &str) -> Error {
        let folder = match self {
            Workspace::Memory => Path::new(""),
            Workspace::Folder(folder) => folder,
            Workspace::Store(store, _) => &store.folder,
        };
        let message = format!("{what}: not as it was written: remove it by kmb clean");
        Error::damaged(folder, message)
    }

    /// Removes the working store.
    pub(super) fn remove(self) -> Result<()> {
        let Workspace::Store(store, _) = self else {
            return Ok(());
        };
        let folder = store.folder.clone();
        drop(store);
        working_store::remove(&folder)
    }

    /// Whether what is saved is kept.
    pub(super) fn is_kept(&self) -> bool {
        matches!(self, Workspace::Store(..))
    }
}

/// Bytes that are appended, and then read at any place by any thread.
pub(super) enum Spill {
    Memory(Vec<u8>),
    File {
        file: File,
        folder: PathBuf,
        /// Bytes in the file.
        written: u64,
        /// Of those.
        checksum: crc32fast::Hasher,
        /// The bytes after those.
        buffer: Vec<u8>,
    },
}

impl Spill {
    /// Nothing yet; room for `expected` bytes is set aside in memory. In a working store the file has this name.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] where the file cannot be made; [`Error::Argument`] where memory is short.
    pub(super) fn new(workspace: &Workspace, name: &str, expected: u64) -> Result<Spill> {
        let (file, folder) = match workspace {
            Workspace::Memory => {
                let mut bytes = Vec::new();
                let reserved = usize::try_from(expected)
                    .ok()
                    .and_then(|expected| bytes.try_reserve_exact(expected).ok());
                reserved.ok_or_else(|| {
                    Error::Argument(format!("{expected} bytes for the build exceed the memory"))
                })?;
                return Ok(Spill::Memory(bytes));
            }
            Workspace::Folder(folder) => (tempfile::tempfile_in(folder), folder),
            Workspace::Store(store, part) => {
                let path = store.folder.join(format!("{part}-{name}"));
                let mut options = OpenOptions::new();
                options.read(true).write(true).create(true).truncate(true);
                (options.open(path), &store.folder)
            }
        };
        Ok(Spill::File {
            file: file.map_err(Error::io(folder, "cannot make a temporary file in"))?,
            folder: folder.clone(),
            written: 0,
            checksum: crc32fast::Hasher::new(),
            buffer: Vec::new(),
        })
    }

    /// Writes all to the file; what says that it is there.
    pub(super) fn seal(&mut self) -> Result<Vec<u8>> {
        self.flush()?;
        Ok(match self {
            Spill::Memory(_) => Vec::new(),
            Spill::File {
                written, checksum, ..
            } => {
                let checksum = checksum.clone().finalize();
                [&written.to_ne_bytes()[..], &checksum.to_ne_bytes()].concat()
            }
        })
    }

    /// What was sealed before the process was killed. Whatever came after it is dropped.
    ///
    /// # Errors
    ///
    /// [`Error::Damaged`] where the file does not hold that any more; [`Error::Io`].
    pub(super) fn restore(workspace: &Workspace, name: &str, seal: &[u8]) -> Result<Spill> {
        let Workspace::Store(store, part) = workspace else {
            return Spill::new(workspace, name, 0);
        };
        let (length, checksum) = seal.split_at(8.min(seal.len()));
        let length = length.try_into().map_or(0, u64::from_ne_bytes);
        let folder = store.folder.clone();
        let path = folder.join(format!("{part}-{name}"));
        let cannot_read = |error: io::Error| match error.kind() {
            io::ErrorKind::NotFound | io::ErrorKind::UnexpectedEof => {
                workspace.damaged(&format!("{part}-{name}"))
            }
            _ => Error::io(&folder, "cannot read a file in")(error),
        };
        let file = OpenOptions::new().read(true).write(true).open(path);
        let file = file.map_err(cannot_read)?;
        let (mut found, mut offset) = (crc32fast::Hasher::new(), 0);
        let mut buffer = Vec::new();
        while offset < length {
            buffer.resize((length - offset).min(BUFFER_LENGTH as u64) as usize, 0);
            read_exact_at(&file, offset, &mut buffer).map_err(cannot_read)?;
            found.update(&buffer);
            offset += buffer.len() as u64;
        }
        if found.clone().finalize().to_ne_bytes() != checksum {
            return Err(workspace.damaged(&format!("{part}-{name}")));
        }
        file.set_len(length)
            .map_err(Error::io(&folder, "cannot shorten a file in"))?;
        Ok(Spill::File {
            file,
            folder,
            written: length,
            checksum: found,
            buffer: Vec::new(),
        })
    }

    /// Bytes so far.
    pub(super) fn length(&self) -> u64 {
        match self {
            Spill::Memory(bytes) => bytes.len() as u64,
            Spill::File {
                written, buffer, ..
            } => written + buffer.len() as u64,
        }
    }

    pub(super) fn append(&mut self, bytes: &[u8]) -> Result<()> {
        match self {
            Spill::Memory(all) => all.extend_from_slice(bytes),
            Spill::File { buffer, .. } => {
                buffer.extend_from_slice(bytes);
                if buffer.len() >= BUFFER_LENGTH {
                    return self.flush();
                }
            }
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        if let Spill::File {
            file,
            folder,
            written,
            checksum,
            buffer,
        } = self
        {
            write_all_at(file, *written, buffer)
                .map_err(Error::io(folder, "cannot write a temporary file in"))?;
            *written += buffer.len() as u64;
            checksum.update(buffer);
            buffer.clear();
        }
        Ok(())
    }

    /// `length` bytes at `offset`, which were appended: those in memory, or a copy in `scratch`.
    pub(super) fn read<'a>(
        &'a self,
        offset: u64,
        length: usize,
        scratch: &'a mut Vec<u8>,
    ) -> Result<&'a [u8]> {
        match self {
            Spill::Memory(bytes) => Ok(&bytes[offset as usize..][..length]),
            Spill::File {
                file,
                folder,
                written,
                buffer,
                ..
            } => {
                scratch.resize(length, 0);
                let in_file = written.saturating_sub(offset).min(length as u64) as usize;
                let (from_file, rest) = scratch.split_at_mut(in_file);
                read_exact_at(file, offset, from_file)
                    .map_err(Error::io(folder, "cannot read a temporary file in"))?;
                if !rest.is_empty() {
                    let start = (offset + in_file as u64 - written) as usize;
                    rest.copy_from_slice(&buffer[start..start + rest.len()]);
                }
                Ok(scratch)
            }
        }
    }
}

/// Records of bytes by number, appended one after the other.
pub(super) enum Records {
    Memory {
        records: Vec<Vec<u8>>,
        /// Of all.
        bytes: u64,
    },
    Spilled {
        spill: Spill,
        /// Where each ends.
        ends: Vec<u64>,
    },
}

impl Records {
    pub(super) fn new(workspace: &Workspace, name: &str) -> Result<Records> {
        if matches!(workspace, Workspace::Memory) {
            return Ok(Records::Memory {
                records: Vec::new(),
                bytes: 0,
            });
        }
        Ok(Records::Spilled {
            spill: Spill::new(workspace, name, 0)?,
            ends: Vec::new(),
        })
    }

    /// As [`Spill::seal`].
    pub(super) fn seal(&mut self) -> Result<Vec<u8>> {
        match self {
            Records::Memory { .. } => Ok(Vec::new()),
            Records::Spilled { spill, ends } => {
                let ends: &[u8] = bytemuck::cast_slice(ends);
                Ok([&spill.seal()?, ends].concat())
            }
        }
    }

    /// As [`Spill::restore`].
    pub(super) fn restore(workspace: &Workspace, name: &str, seal: &[u8]) -> Result<Records> {
        let (spill, ends) = seal.split_at(SEAL_LENGTH.min(seal.len()));
        Ok(Records::Spilled {
            spill: Spill::restore(workspace, name, spill)?,
            ends: bytemuck::pod_collect_to_vec(&ends[..ends.len() / 8 * 8]),
        })
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        match self {
            Records::Memory { records, .. } => records.len(),
            Records::Spilled { ends, .. } => ends.len(),
        }
    }

    /// Bytes of all.
    pub(super) fn bytes(&self) -> u64 {
        match self {
            Records::Memory { bytes, .. } => *bytes,
            Records::Spilled { spill, .. } => spill.length(),
        }
    }

    pub(super) fn push(&mut self, record: Vec<u8>) -> Result<()> {
        match self {
            Records::Memory { records, bytes } => {
                *bytes += record.len() as u64;
                records.push(record);
            }
            Records::Spilled { spill, ends } => {
                spill.append(&record)?;
                ends.push(spill.length());
            }
        }
        Ok(())
    }

    /// The record of a number below [`count`](Self::count), perhaps in `scratch`.
    pub(super) fn get<'a>(&'a self, number: usize, scratch: &'a mut Vec<u8>) -> Result<&'a [u8]> {
        match self {
            Records::Memory { records, .. } => Ok(&records[number]),
            Records::Spilled { spill, ends } => {
                let start = match number {
                    0 => 0,
                    _ => ends[number - 1],
                };
                let length = (ends[number] - start) as usize;
                spill.read(start, length, scratch)
            }
        }
    }
}

/// The folder of a path; the working folder for one without.
pub(super) fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
        _ => PathBuf::from("."),
    }
}
