//! Segments that are written later than they are finished.

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use spinney_base::io::{Sorter, directory_of};
use spinney_base::space::Code;
use spinney_base::{Error, Result};

/// Receives segments: file order, entry, and the segment's bytes.
pub(super) type SegmentVisitor<'t> = dyn FnMut(u64, &[u8], &[u8]) -> Result<()> + 't;

/// Segments that are written later, in file order. They are kept in memory, and in a temporary file
/// beyond the memory limit.
pub(super) struct DeferredSegments {
    /// The output, for messages.
    path: PathBuf,
    bytes: tempfile::SpooledTempFile,
    written: u64,
    /// Entries of the segment index, sorted by file order. Their offsets are relative to the bytes
    /// kept here.
    order: Sorter,
    entry_size: usize,
}

/// Returns a segment's sort key in file order: a node's segment follows those of all nodes below
/// it, and those above `shard_level` follow all others.
pub(super) fn file_order(code: Code, shard_level: u8) -> u64 {
    // The last code below a node. Of nodes with the same last code, the deepest is first.
    let last = code.last_bits() & !31 | u64::from(31 - code.level());
    last | u64::from(code.level() < shard_level) << 63
}

impl DeferredSegments {
    /// Keeps about `memory` bytes before a temporary file in the output's directory is used.
    pub(super) fn new(output: &Path, entry_size: usize, memory: u64) -> DeferredSegments {
        let (path, directory) = (output.to_path_buf(), directory_of(output));
        let bytes = tempfile::spooled_tempfile_in((memory / 2) as usize, directory);
        let order = Sorter::new(directory, memory / 2);
        DeferredSegments { path, bytes, written: 0, order, entry_size }
    }

    /// Returns the number of bytes kept.
    pub(super) fn len(&self) -> u64 {
        self.written
    }

    /// Adds a segment. The offset in its entry is the number of bytes kept before it.
    pub(super) fn push(&mut self, order: u64, parts: [&[u8]; 2], entry: &[u8]) -> Result<()> {
        for part in parts {
            self.bytes.write_all(part).map_err(Error::io(&self.path, "use a temporary file for"))?;
            self.written += part.len() as u64;
        }
        self.order.push(order, &[&order.to_le_bytes(), entry].concat())
    }

    /// Passes all segments to `each`, in file order.
    ///
    /// `locate` returns a segment's offset and length in the bytes kept, given its entry.
    pub(super) fn finish(
        self,
        locate: impl Fn(&[u8]) -> (u64, u64),
        each: &mut SegmentVisitor<'_>,
    ) -> Result<()> {
        let DeferredSegments { path, mut bytes, order, entry_size, .. } = self;
        let mut buffer = Vec::new();
        let mut position = None;
        order.finish(&mut |item| {
            let (order, entry) = item.split_at(8);
            debug_assert_eq!(entry.len(), entry_size);
            let (offset, length) = locate(entry);
            buffer.resize(length as usize, 0);
            // (The segments of a subtree are often consecutive here, too, and need no seek.)
            let read = match position == Some(offset) {
                true => Ok(offset),
                false => bytes.seek(SeekFrom::Start(offset)),
            };
            let read = read.and_then(|_| bytes.read_exact(&mut buffer));
            read.map_err(Error::io(&path, "use a temporary file for"))?;
            position = Some(offset + length);
            each(u64::from_le_bytes(order.try_into().expect("8 bytes")), entry, &buffer)
        })
    }
}
