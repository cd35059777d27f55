//! Bytes by positioned reads, which share one file among threads without a lock.

use std::fs::File;
use std::io;

use super::bytes::Bytes;
use crate::positioned::read_exact_at;

/// An open file and its length.
#[derive(Debug)]
pub(super) struct Positioned {
    file: File,
    length: u64,
}

impl Positioned {
    pub(super) fn new(file: File) -> io::Result<Positioned> {
        let length = file.metadata()?.len();
        Ok(Positioned { file, length })
    }
}

impl Bytes for Positioned {
    fn length(&self) -> u64 {
        self.length
    }

    fn read<'a>(
        &'a self,
        offset: u64,
        length: usize,
        scratch: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]> {
        let inside = offset
            .checked_add(length as u64)
            .is_some_and(|end| end <= self.length);
        if !inside {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        scratch.resize(length, 0);
        read_exact_at(&self.file, offset, scratch)?;
        Ok(scratch)
    }
}
