//! A file that comes under its final name only when it is whole.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::{Error, Result};

/// Where a [`Writer`](super::Writer) puts its bytes. A sink that is dropped unpublished leaves nothing.
pub trait Sink: Send {
    /// Writes some of `bytes` at `offset`, from the first on, and returns how many.
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize>;

    /// Returns once all that was written is on the medium.
    fn sync(&mut self) -> io::Result<()>;

    /// Gives the file its final name, in place of a file that had it.
    fn publish(self: Box<Self>) -> io::Result<()>;
}

/// A temporary file `.NAME.*.part` in the folder of its final name.
pub struct FileSink {
    file: NamedTempFile,
    folder: PathBuf,
    path: PathBuf,
}

impl FileSink {
    /// Creates the temporary file.
    ///
    /// # Errors
    ///
    /// [`Error::Argument`] for a path without a file name, [`Error::Io`] where the folder does not exist
    /// or cannot be written to, or where the path is taken by something other than a file.
    pub fn create(path: &Path) -> Result<FileSink> {
        let Some(name) = path.file_name() else {
            let message = format!("{:?} cannot be written: it names no file", path);
            return Err(Error::Argument(message));
        };
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        let into_folder = |source| Error::io(&folder, "cannot write into the folder")(source);
        if !std::fs::metadata(&folder).map_err(into_folder)?.is_dir() {
            return Err(into_folder(io::ErrorKind::NotADirectory.into()));
        }
        if let Ok(taken) = std::fs::metadata(path)
            && !taken.is_file()
        {
            let source = io::Error::other("it exists and is not a regular file");
            return Err(Error::io(path, "cannot write")(source));
        }
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(name);
        prefix.push(".");
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".part");
        // As any new file's, less the user's mask: a repository is not a secret.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // Only the kind of error: its text would name the temporary file.
        let file = builder
            .tempfile_in(&folder)
            .map_err(|error| into_folder(error.kind().into()))?;
        Ok(FileSink {
            file,
            folder,
            path: path.to_path_buf(),
        })
    }
}

impl Sink for FileSink {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let file = self.file.as_file_mut();
        file.seek(SeekFrom::Start(offset))?;
        file.write(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.file.as_file().sync_all()
    }

    fn publish(self: Box<Self>) -> io::Result<()> {
        let FileSink { file, folder, path } = *self;
        let folder = if cfg!(unix) {
            Some(File::open(folder)?)
        } else {
            None
        };
        file.persist(path).map_err(|refused| refused.error)?;
        // From here on the file is whole under its name; an error says that the name may be lost
        // with the power.
        folder.map_or(Ok(()), |folder| folder.sync_all())
    }
}
