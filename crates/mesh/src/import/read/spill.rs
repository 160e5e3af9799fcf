//! Byte buffer that is kept in memory up to a limit, and in an unnamed temporary file beyond.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use spinney_base::io::{Mapped, ReadBackend};
use spinney_base::{Error, Result};

/// Bytes written to disk at once.
const CHUNK: usize = 1 << 20;

/// Collects [`SpilledBytes`].
pub(super) struct SpillBuffer {
    /// Bytes that are not on disk yet.
    bytes: Vec<u8>,
    /// Maximum number of bytes to keep in memory.
    limit: usize,
    file: Option<File>,
    /// Path of the model's file, for messages.
    path: PathBuf,
}

impl SpillBuffer {
    /// Empty buffer that takes about `memory` bytes, or at least one MiB.
    pub(super) fn new(path: &Path, memory: u64) -> SpillBuffer {
        let limit = usize::try_from(memory).unwrap_or(usize::MAX).max(CHUNK);
        SpillBuffer { bytes: Vec::new(), limit, file: None, path: path.to_path_buf() }
    }

    /// Appends a few bytes.
    #[inline]
    pub(super) fn push(&mut self, bytes: &[u8]) -> Result<()> {
        if self.bytes.capacity() - self.bytes.len() < bytes.len() {
            self.make_space(bytes.len()).map_err(Error::io(&self.path, TEMPORARY))?;
        }
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    /// Doubles the capacity until the limit is reached, then spills to the file.
    fn make_space(&mut self, needed: usize) -> io::Result<()> {
        let held = self.bytes.len();
        if self.file.is_none() && held + needed < self.limit {
            self.bytes.reserve_exact(held.max(4096).min(self.limit - held));
            return Ok(());
        }
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        file.write_all(&self.bytes)?;
        self.bytes.clear();
        if self.bytes.capacity() > 2 * CHUNK {
            self.bytes = Vec::with_capacity(CHUNK);
        }
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<SpilledBytes> {
        let Some(mut file) = self.file.take() else { return Ok(SpilledBytes::Memory(self.bytes)) };
        file.write_all(&self.bytes).map_err(Error::io(&self.path, TEMPORARY))?;
        // The file is unnamed, so no other process can change it.
        Ok(SpilledBytes::Disk(Mapped::of(&file, &self.path)?))
    }
}

/// Action that errors name.
const TEMPORARY: &str = "use a temporary file for vertices and faces";

/// Bytes in memory, or in a mapped temporary file.
pub(super) enum SpilledBytes {
    Memory(Vec<u8>),
    Disk(Mapped),
}

impl SpilledBytes {
    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            SpilledBytes::Memory(bytes) => bytes,
            SpilledBytes::Disk(map) => map.bytes().unwrap_or_default(),
        }
    }
}
