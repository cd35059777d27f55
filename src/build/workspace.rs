//! Where a build keeps what it does not need at once: in memory, or in temporary files.

use crate::{Error, Result};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

/// Bytes gathered before they are written to a file.
const BUFFER_LENGTH: usize = 1 << 20;

/// Chooses where bytes are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Workspace {
    /// In memory.
    Memory,
    /// In files without a name in this folder, which the system forgets with the process.
    Folder(PathBuf),
}

/// Bytes that are appended, and then read at any place by any thread.
pub(super) enum Spill {
    Memory(Vec<u8>),
    File {
        file: File,
        folder: PathBuf,
        /// Bytes in the file.
        written: u64,
        /// The bytes after those.
        buffer: Vec<u8>,
    },
}

impl Spill {
    /// Nothing yet; room for `expected` bytes is set aside in memory.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] where the file cannot be made; [`Error::Argument`] where memory is short.
    pub(super) fn new(workspace: &Workspace, expected: u64) -> Result<Spill> {
        match workspace {
            Workspace::Memory => {
                let mut bytes = Vec::new();
                let reserved = usize::try_from(expected)
                    .ok()
                    .and_then(|expected| bytes.try_reserve_exact(expected).ok());
                reserved.ok_or_else(|| {
                    Error::Argument(format!("{expected} bytes for the build exceed the memory"))
                })?;
                Ok(Spill::Memory(bytes))
            }
            Workspace::Folder(folder) => Ok(Spill::File {
                file: tempfile::tempfile_in(folder)
                    .map_err(Error::io(folder, "cannot make a temporary file in"))?,
                folder: folder.clone(),
                written: 0,
                buffer: Vec::new(),
            }),
        }
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
            buffer,
        } = self
        {
            write_all_at(file, *written, buffer)
                .map_err(Error::io(folder, "cannot write a temporary file in"))?;
            *written += buffer.len() as u64;
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
pub(super) struct Records {
    spill: Spill,
    /// Where each ends.
    ends: Vec<u64>,
}

impl Records {
    pub(super) fn new(workspace: &Workspace) -> Result<Records> {
        Ok(Records {
            spill: Spill::new(workspace, 0)?,
            ends: Vec::new(),
        })
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.ends.len()
    }

    /// Bytes of all.
    pub(super) fn bytes(&self) -> u64 {
        self.spill.length()
    }

    pub(super) fn push(&mut self, bytes: &[u8]) -> Result<()> {
        self.spill.append(bytes)?;
        self.ends.push(self.spill.length());
        Ok(())
    }

    /// The record of a number below [`count`](Self::count), perhaps in `scratch`.
    pub(super) fn get<'a>(&'a self, number: usize, scratch: &'a mut Vec<u8>) -> Result<&'a [u8]> {
        let start = match number {
            0 => 0,
            _ => self.ends[number - 1],
        };
        let length = (self.ends[number] - start) as usize;
        self.spill.read(start, length, scratch)
    }
}

/// Whether a folder can hold temporary files; the working folder for a path without one.
pub(super) fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
        _ => PathBuf::from("."),
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

#[cfg(unix)]
fn write_all_at(file: &File, offset: u64, bytes: &[u8]) -> io::Result<()> {
    std::os::unix::fs::FileExt::write_all_at(file, bytes, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut offset: u64, mut buffer: &mut [u8]) -> io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, offset)? {
            0 => return Err(io::ErrorKind::UnexpectedEof.into()),
            count => {
                buffer = &mut buffer[count..];
                offset += count as u64;
            }
        }
    }
    Ok(())
}

#[cfg(windows)]
fn write_all_at(file: &File, mut offset: u64, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_write(file, bytes, offset)? {
            0 => return Err(io::ErrorKind::WriteZero.into()),
            count => {
                bytes = &bytes[count..];
                offset += count as u64;
            }
        }
    }
    Ok(())
}
