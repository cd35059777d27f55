//! The one error type: every value names the place and the cause in one line.

use std::path::{Path, PathBuf};

/// What can go wrong in any room.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused an operation on a file.
    #[error("{}: {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was attempted, as a verb phrase ("cannot open").
        action: &'static str,
        /// The system's answer.
        source: std::io::Error,
    },
    /// An input raster cannot be used.
    #[error("{}: {message}", path.display())]
    Input {
        /// The raster's file, or `(rows)` for a callback.
        path: PathBuf,
        /// The cause, with the position inside the file where there is one.
        message: String,
    },
    /// A repository's bytes are not what the format says.
    #[error("{}: damaged: {message}", path.display())]
    Damaged {
        /// The repository.
        path: PathBuf,
        /// What is wrong, and where.
        message: String,
    },
    /// A block is missing since a repair: what it refined stays coarse.
    #[error("{}: missing: {message}", path.display())]
    Missing {
        /// The repository.
        path: PathBuf,
        /// Which block.
        message: String,
    },
    /// A repository was written by a version that this one cannot read.
    #[error("{}: {message}", path.display())]
    Version {
        /// The repository.
        path: PathBuf,
        /// Which version it asks for.
        message: String,
    },
    /// An argument is outside what a function accepts.
    #[error("{0}")]
    Argument(String),
    /// The caller's progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// The result of everything that can fail.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Io`] about `path`; made to be used with `map_err`.
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Error {
        move |source| Error::Io {
            path: path.to_path_buf(),
            action,
            source,
        }
    }

    /// An [`Error::Input`] about `path`.
    pub fn input(path: &Path, message: impl Into<String>) -> Error {
        Error::Input {
            path: path.to_path_buf(),
            message: message.into(),
        }
    }

    /// An [`Error::Damaged`] about `path`.
    pub fn damaged(path: &Path, message: impl Into<String>) -> Error {
        Error::Damaged {
            path: path.to_path_buf(),
            message: message.into(),
        }
    }
}
