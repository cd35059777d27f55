//! A file that is read by ranges of bytes.

use std::fs::File;
use std::io;
use std::path::Path;

use super::map::Map;
use super::positioned::Positioned;
use crate::{Error, Result};

/// How a repository's bytes are read. Both ways give the same answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// By a memory map, without copies. The file must not be truncated or written to while it is open:
    /// the system ends a process that reads a mapped page beyond the file's end. Replacing the
    /// file by a rename is safe; a store that is open goes on with the old one.
    Map,
    /// By positioned reads into buffers; a file truncated meanwhile gives an error.
    Positioned,
}

/// A file that many threads read by ranges.
pub(super) trait Bytes: std::fmt::Debug + Send + Sync {
    /// Bytes of the file when it was opened.
    fn length(&self) -> u64;

    /// `length` bytes at `offset`: the file's own, or a copy in `scratch`. A range that the file does not
    /// contain gives [`io::ErrorKind::UnexpectedEof`], before anything is allocated.
    fn read<'a>(
        &'a self,
        offset: u64,
        length: usize,
        scratch: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]>;
}

/// Opens a regular file.
pub(super) fn open(path: &Path, access: Access) -> Result<Box<dyn Bytes>> {
    if path.as_os_str().is_empty() {
        return Err(Error::Argument(
            "the path of the repository is empty".to_owned(),
        ));
    }
    // Before the open, which would wait for the other end of a pipe.
    let metadata = std::fs::metadata(path).map_err(Error::io(path, "cannot open"))?;
    if metadata.is_dir() {
        let source = io::Error::from(io::ErrorKind::IsADirectory);
        return Err(Error::io(path, "cannot open")(source));
    }
    if !metadata.is_file() {
        let source = io::Error::other("not a regular file");
        return Err(Error::io(path, "cannot open")(source));
    }
    let file = File::open(path).map_err(Error::io(path, "cannot open"))?;
    Ok(match access {
        Access::Map => Box::new(Map::new(&file).map_err(Error::io(path, "cannot map"))?),
        Access::Positioned => {
            Box::new(Positioned::new(file).map_err(Error::io(path, "cannot open"))?)
        }
    })
}
