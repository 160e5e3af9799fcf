//! Writer of shard summaries.

use serde::Serialize;

use super::summary::{BLOCKS, Entry, Identity, MAX_BLOCK, SECTION, SHARD, StoredRange};
use super::{Shard, ShardRange};
use crate::{BlockWriter, Content, FileHeader, Metadata, TreeFormat};
use spinney_base::io::{FileAccess, Sorter};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};

/// Bytes of the list of blocks in memory before it spills to a temporary file. An entry takes 28
/// bytes and describes 64 KiB.
const MEMORY: u64 = 1 << 20;

/// A shard summary being written. The file appears when it is finished.
pub struct SummaryWriter<T> {
    out: BlockWriter,
    access: FileAccess,
    blocks: Sorter,
    identity: Identity<T>,
    /// The layer that was started last, and its bytes that are not in a block yet.
    range: Option<ShardRange>,
    pending: Vec<u8>,
}

impl<T: Serialize> SummaryWriter<T> {
    /// Starts the summary of a shard.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn new(shard: &Shard) -> Result<SummaryWriter<T>> {
        let header = FileHeader {
            format: TreeFormat::Goblin,
            content: Content::Shard,
            dimension: Dimension::Quad,
            depth: 0,
            layers: 0,
        };
        let out = BlockWriter::new(shard.access.append_only(&shard.summary_path())?, header, "shards")?;
        let blocks = Sorter::new(shard.temporary(), MEMORY);
        let identity = Identity { job: shard.job, number: shard.number, ranges: Vec::new() };
        let access = shard.access.clone();
        Ok(SummaryWriter { out, access, blocks, identity, range: None, pending: Vec::new() })
    }

    /// How the files of the shard are written.
    pub fn access(&self) -> &FileAccess {
        &self.access
    }

    /// Starts the next layer. Layers must be ascending.
    pub fn begin(&mut self, range: ShardRange) {
        self.range = Some(range);
    }

    /// Appends bytes to the layer that was started last.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn write(&mut self, mut bytes: &[u8]) -> Result<()> {
        while self.pending.len() + bytes.len() >= MAX_BLOCK {
            let (now, later) = bytes.split_at(MAX_BLOCK - self.pending.len());
            self.pending.extend_from_slice(now);
            self.flush()?;
            bytes = later;
        }
        self.pending.extend_from_slice(bytes);
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        let key = u64::from(self.range.expect("a layer was started").layer);
        let block = self.out.block(key, &self.pending, self.pending.len() as u32)?;
        self.pending.clear();
        self.blocks.push(key, &Entry { block, bounds: [[]; 2] }.to_bytes())
    }

    /// Ends the layer that was started last.
    ///
    /// # Errors
    /// If its last bytes cannot be written.
    pub fn end(&mut self, run_bytes: u64, totals: T) -> Result<()> {
        if !self.pending.is_empty() {
            self.flush()?;
        }
        let ShardRange { layer, run } = self.range.take().expect("a layer was started");
        self.identity.ranges.push(StoredRange { layer, run: run.ends(), run_bytes, totals });
        Ok(())
    }

    /// Writes the list and the sections, and publishes the file.
    ///
    /// # Errors
    /// If it cannot be written, or the entries of the layers take more than 16 MiB.
    pub fn finish(self) -> Result<()> {
        let SummaryWriter { out, blocks, identity, .. } = self;
        let section = SECTION.encode(&identity).ok_or_else(|| {
            let found = format!("a shard of {} layers", identity.ranges.len());
            Error::unsupported(out.path(), found, "plan the job with more shards")
        })?;
        out.finish(vec![(BLOCKS, blocks)], (SHARD, section), &Metadata::default())
    }
}
