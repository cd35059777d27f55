//! A whole repository in memory: a file that is only bytes.

use std::io;
use std::sync::{Arc, Mutex, PoisonError};

use super::bytes::Bytes;
use super::sink::Sink;

/// Bytes that are read as a file is.
#[derive(Debug)]
pub(super) struct Memory(pub(super) Vec<u8>);

impl Bytes for Memory {
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

/// A sink of bytes in memory; its clones share what is published.
#[derive(Clone, Debug, Default)]
pub struct MemorySink {
    written: Vec<u8>,
    published: Arc<Mutex<Vec<u8>>>,
}

impl MemorySink {
    /// What a clone has published; nothing where none has. It is taken out.
    pub fn take(&self) -> Vec<u8> {
        let mut published = self
            .published
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut published)
    }
}

impl Sink for MemorySink {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let end = usize::try_from(offset)
            .ok()
            .and_then(|start| start.checked_add(bytes.len()))
            .ok_or(io::ErrorKind::OutOfMemory)?;
        if end > self.written.len() {
            let more = end - self.written.len();
            self.written
                .try_reserve(more)
                .map_err(|_| io::ErrorKind::OutOfMemory)?;
            self.written.resize(end, 0);
        }
        self.written[end - bytes.len()..end].copy_from_slice(bytes);
        Ok(bytes.len())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }

    fn publish(self: Box<Self>) -> io::Result<()> {
        *self
            .published
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = self.written;
        Ok(())
    }
}
