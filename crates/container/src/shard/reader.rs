//! Sequential reader of one layer's bytes in a shard summary.

use std::path::Path;

use super::summary::{BLOCKS, Entry, MAX_BLOCK};
use crate::{BlockFile, List};
use spinney_base::{Error, Result};

/// The summary bytes of one layer, in order. One block of them is in memory.
pub struct SummaryBytes {
    file: BlockFile,
    blocks: List,
    /// Key of the layer's blocks, and the index of the next one.
    key: u64,
    next: usize,
    block: Vec<u8>,
    /// Number of bytes of the block that were consumed.
    taken: usize,
}

impl SummaryBytes {
    pub(super) fn new(file: BlockFile, layer: u32) -> Result<SummaryBytes> {
        let blocks = file.list(BLOCKS, "list of blocks", Entry::BYTES)?;
        file.check_blocks(&[("block", &blocks, MAX_BLOCK)], file.end(BLOCKS))?;
        let key = u64::from(layer);
        let next = blocks.find(file.backend(), 0, key);
        Ok(SummaryBytes { file, blocks, key, next, block: Vec::new(), taken: 0 })
    }

    /// The entry of the next block, unless it belongs to another layer.
    fn entry(&self) -> Option<Entry> {
        let entry = self.blocks.get(self.file.backend(), self.next).map(Entry::from_bytes);
        entry.filter(|entry| entry.block.key == self.key)
    }

    /// Returns whether all bytes were consumed.
    pub fn is_over(&self) -> bool {
        self.taken == self.block.len() && self.entry().is_none()
    }

    /// Consumes the next `length` bytes.
    ///
    /// # Errors
    /// If there are fewer, or a block is corrupt or cannot be read.
    pub fn take(&mut self, length: u64) -> Result<Vec<u8>> {
        // Do not reserve capacity: the length may be untrusted.
        let mut bytes = Vec::new();
        while (bytes.len() as u64) < length {
            if self.taken == self.block.len() {
                let Some(entry) = self.entry() else {
                    return Err(self.corrupt(format!("{} bytes", bytes.len()), format!("{length} bytes")));
                };
                let place = format!("block {}", self.next);
                if entry.block.length != entry.block.count {
                    let found = format!("{} bytes", entry.block.length);
                    return Err(self.file.corrupt(place, found, format!("{} bytes", entry.block.count)));
                }
                self.block = self.file.block(&place, &entry.block)?.to_vec();
                (self.next, self.taken) = (self.next + 1, 0);
            }
            let rest = &self.block[self.taken..];
            let count =
                usize::try_from(length - bytes.len() as u64).map_or(rest.len(), |left| left.min(rest.len()));
            bytes.extend_from_slice(&rest[..count]);
            self.taken += count;
        }
        Ok(bytes)
    }

    /// Consumes the next `N` bytes.
    ///
    /// # Errors
    /// Those of [`SummaryBytes::take`].
    pub fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        Ok(self.take(N as u64)?.try_into().expect("as many bytes"))
    }

    /// Creates the error for invalid contents.
    pub fn corrupt(&self, found: impl Into<String>, expected: impl Into<String>) -> Error {
        self.file.corrupt("shard summary", found, expected)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        self.file.path()
    }
}
