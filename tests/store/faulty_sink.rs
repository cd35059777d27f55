//! A real file on a medium that fails as told.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use kimberlite::store::{FileSink, Sink};

/// What goes wrong with a call.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// It fails, and so does every call after it.
    Error,
    /// It alone fails.
    OneError,
    /// A write puts down half of its bytes and fails, and every call after it fails.
    TornError,
    /// A write is reported as done, and its bytes are lost.
    Lost,
    /// A write is reported as done, and its second half is lost, as is every write after it.
    Torn,
}

/// A file whose calls (writes, sync, publish) go wrong as told.
pub struct FaultySink {
    inner: Box<FileSink>,
    /// Calls so far.
    pub calls: Arc<AtomicUsize>,
    /// Number of the call that has the fault, from 1.
    pub fault_at: usize,
    pub fault: Fault,
    /// Most bytes of a write.
    pub step: usize,
    /// Bytes until the disk is full.
    pub space: usize,
    /// Every call of a write that is a multiple of this is interrupted.
    pub interrupt_every: usize,
}

impl FaultySink {
    /// One without faults.
    pub fn new(path: &Path) -> FaultySink {
        FaultySink {
            inner: Box::new(FileSink::create(path).unwrap()),
            calls: Arc::default(),
            fault_at: usize::MAX,
            fault: Fault::Error,
            step: usize::MAX,
            space: usize::MAX,
            interrupt_every: usize::MAX,
        }
    }

    /// The number of this call, or the failure that it meets.
    fn call(&self) -> io::Result<usize> {
        let call = self.calls.fetch_add(1, Ordering::Relaxed) + 1;
        let fails = match self.fault {
            Fault::Error => call >= self.fault_at,
            Fault::OneError => call == self.fault_at,
            Fault::TornError => call > self.fault_at,
            Fault::Lost | Fault::Torn => false,
        };
        if fails {
            return Err(io::Error::other("injected"));
        }
        Ok(call)
    }

    /// The failure of a call that did half of its work.
    fn torn(&self, call: usize) -> io::Result<()> {
        match self.fault {
            Fault::TornError if call == self.fault_at => Err(io::Error::other("injected")),
            _ => Ok(()),
        }
    }

    /// How many of so many bytes of a write reach the file.
    fn kept(&self, call: usize, length: usize) -> usize {
        match self.fault {
            Fault::Lost if call == self.fault_at => 0,
            Fault::Torn if call > self.fault_at => 0,
            Fault::Torn | Fault::TornError if call == self.fault_at => length / 2,
            _ => length,
        }
    }
}

impl Sink for FaultySink {
    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> io::Result<usize> {
        let call = self.call()?;
        if call.is_multiple_of(self.interrupt_every) {
            return Err(io::ErrorKind::Interrupted.into());
        }
        if self.space == 0 {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let length = bytes.len().min(self.step).min(self.space);
        self.space -= length;
        let kept = self.kept(call, length);
        let mut written = 0;
        while written < kept {
            written += self
                .inner
                .write_at(offset + written as u64, &bytes[written..kept])?;
        }
        self.torn(call)?;
        Ok(length)
    }

    fn sync(&mut self) -> io::Result<()> {
        let call = self.call()?;
        self.torn(call)?;
        self.inner.sync()
    }

    fn publish(self: Box<Self>) -> io::Result<()> {
        let call = self.call()?;
        self.torn(call)?;
        self.inner.publish()
    }
}
