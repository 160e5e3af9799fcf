//! Simulated disk failures, for tests.

use std::fs::File;
use std::io;
use std::sync::Arc;

use super::platform::write_all_at;

/// Simulated disk failures. Consulted before each write and each sync of an output.
pub trait Faults: Send + Sync {
    /// Returns how many bytes of a write of `length` bytes reach the file; at least one.
    ///
    /// # Errors
    /// If none do.
    fn write(&self, length: usize) -> io::Result<usize>;

    /// Returns the result of a sync.
    ///
    /// # Errors
    /// If the sync fails.
    fn sync(&self) -> io::Result<()>;
}

/// Simulated failures of an output; usually none.
#[derive(Clone, Default)]
pub(super) struct MayFail(pub(super) Option<Arc<dyn Faults>>);

impl MayFail {
    /// Returns the bytes of a write that reach the file.
    pub(super) fn arriving<'b>(&self, bytes: &'b [u8]) -> io::Result<&'b [u8]> {
        match &self.0 {
            Some(faults) if !bytes.is_empty() => Ok(&bytes[..faults.write(bytes.len())?.min(bytes.len())]),
            _ => Ok(bytes),
        }
    }

    /// Writes bytes at an offset of a file.
    pub(super) fn write_all_at(&self, file: &File, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
        while !bytes.is_empty() {
            let arriving = self.arriving(bytes)?;
            write_all_at(file, arriving, offset)?;
            bytes = &bytes[arriving.len()..];
            offset += arriving.len() as u64;
        }
        Ok(())
    }

    pub(super) fn sync(&self) -> io::Result<()> {
        self.0.as_ref().map_or(Ok(()), |faults| faults.sync())
    }
}
