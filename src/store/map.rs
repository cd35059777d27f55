//! Bytes of a memory map: the one file of this room with `unsafe` code.

use std::fs::File;
use std::io;

use memmap2::Mmap;

use super::bytes::Bytes;

/// A read-only map of a whole file.
#[derive(Debug)]
pub(super) struct Map(Mmap);

impl Map {
    pub(super) fn new(file: &File) -> io::Result<Map> {
        // SAFETY: the map is private to this type and never written through. That nobody else
        // truncates or writes to the file while it is mapped is the contract of `Access::Map`,
        // which repositories keep by never being changed in place.
        let map = unsafe { Mmap::map(file) }?;
        Ok(Map(map))
    }
}

impl Bytes for Map {
    fn length(&self) -> u64 {
        self.0.len() as u64
    }

    fn read<'a>(
        &'a self,
        offset: u64,
        length: usize,
        _scratch: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]> {
        usize::try_from(offset)
            .ok()
            .and_then(|start| self.0.get(start..start.checked_add(length)?))
            .ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
    }
}
