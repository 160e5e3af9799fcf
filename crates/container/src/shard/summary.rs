//! Finds and opens shard summaries.
//!
//! Other processes write them, possibly much earlier and on other machines: all contents are
//! untrusted.

use std::io;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::{Shard, ShardRange, SummaryBytes};
use crate::{BlockEntry, BlockFile, Content, OpenOptions, VersionedSection};
use spinney_base::io::FileAccess;
use spinney_base::space::CodeRange;
use spinney_base::{Error, Result, parallel};

/// Tags of the section that identifies the shard, and of the list of blocks.
pub(super) const SHARD: [u8; 4] = *b"SHRD";
pub(super) const BLOCKS: [u8; 4] = *b"SBLK";
/// Maximum bytes of a block.
pub(super) const MAX_BLOCK: usize = 1 << 16;
/// The identity section. Its version covers everything in the file.
pub(super) const SECTION: VersionedSection<{ 16 << 20 }> = VersionedSection { name: "shard", version: 2 };
/// Cache size in bytes of an open summary.
const CACHE: u64 = 1 << 20;

/// Entry of the list of blocks.
pub(super) type Entry = BlockEntry<0>;

/// Contents of the identity section.
#[derive(Serialize, Deserialize)]
pub(super) struct Identity<T> {
    pub(super) job: u128,
    pub(super) number: u32,
    pub(super) ranges: Vec<StoredRange<T>>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct StoredRange<T> {
    pub(super) layer: u32,
    pub(super) run: [u64; 2],
    pub(super) run_bytes: u64,
    pub(super) totals: T,
}

/// Summary of a shard's run of one layer, with totals that depend on the type of tree.
#[derive(Clone, Debug)]
pub struct RangeSummary<T> {
    /// The layer and the nodes.
    pub range: ShardRange,
    /// Bytes of its run file.
    pub run_bytes: u64,
    /// Its totals, unchecked.
    pub totals: T,
}

/// Summary of a shard: an entry per layer, and for each a byte stream that describes its run file
/// and the top of its nodes.
#[derive(Debug)]
pub struct ShardSummary<T> {
    path: PathBuf,
    access: FileAccess,
    /// The layers of the shard, in its order.
    pub ranges: Vec<RangeSummary<T>>,
}

impl<T: DeserializeOwned + Send> ShardSummary<T> {
    /// Opens the summary of a shard. Checks that it belongs to this shard and that its run files
    /// have the recorded lengths. `None` if the shard is not built yet or a run file is missing.
    ///
    /// # Errors
    /// If the summary cannot be read, is corrupt, or belongs to another job.
    pub fn find(shard: &Shard) -> Result<Option<ShardSummary<T>>> {
        ShardSummary::find_all(std::slice::from_ref(shard))?.pop().expect("one result for each shard")
    }

    /// Does [`ShardSummary::find`] for several shards, in their order.
    ///
    /// # Errors
    /// On cancellation. For each shard, those of [`ShardSummary::find`].
    pub fn find_all(shards: &[Shard]) -> Result<Vec<Result<Option<ShardSummary<T>>>>> {
        let mut all = parallel::map(shards, ShardSummary::find_without_runs);
        let Some(Shard { access, .. }) = shards.first() else { return Ok(all) };
        // Invariant: run files are published before the summary. A summary whose run files are
        // missing or have another length belongs to a partially removed shard, which counts as not
        // built. One batch of requests covers the run files of all shards.
        let mut runs = Vec::new();
        for (number, (shard, found)) in shards.iter().zip(&all).enumerate() {
            let Ok(Some(summary)) = found else { continue };
            let expected = summary.ranges.iter().filter(|range| range.run_bytes > 0);
            runs.extend(expected.map(|range| (number, shard.run_path(range.range.layer), range.run_bytes)));
        }
        let paths: Vec<&Path> = runs.iter().map(|(_, path, _)| &**path).collect();
        for ((number, _, bytes), state) in runs.iter().zip(access.stat(&paths)?) {
            match state {
                Ok(Some(state)) if state.length == *bytes => {}
                Ok(_) if all[*number].is_ok() => all[*number] = Ok(None),
                Ok(_) => {}
                Err(error) => all[*number] = Err(error),
            }
        }
        Ok(all)
    }

    /// Opens the summary of a shard without checking its run files: see [`ShardSummary::find`].
    ///
    /// # Errors
    /// Those of [`ShardSummary::find`].
    pub fn find_without_runs(shard: &Shard) -> Result<Option<ShardSummary<T>>> {
        let path = shard.summary_path();
        let file = match open(&path, &shard.access) {
            Err(Error::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        let bytes = file.section(SHARD, SECTION.name)?;
        let (identity, used): (Identity<T>, usize) = SECTION.decode(&path, &bytes)?;
        if used != bytes.len() {
            return Err(file.corrupt(
                SECTION.name,
                format!("{} bytes", bytes.len()),
                format!("{used} bytes"),
            ));
        }
        let is_same = |(stored, range): (&StoredRange<T>, &ShardRange)| {
            stored.layer == range.layer && CodeRange::new(stored.run[0], stored.run[1]) == Some(range.run)
        };
        if identity.job != shard.job
            || identity.number != shard.number
            || identity.ranges.len() != shard.ranges.len()
            || !identity.ranges.iter().zip(&shard.ranges).all(is_same)
        {
            return Err(shard.another_job());
        }
        let ranges = identity.ranges.into_iter().zip(&shard.ranges);
        let ranges = ranges.map(|(stored, range)| {
            let StoredRange { run_bytes, totals, .. } = stored;
            RangeSummary { range: *range, run_bytes, totals }
        });
        Ok(Some(ShardSummary { ranges: ranges.collect(), path, access: shard.access.clone() }))
    }
}

impl<T> ShardSummary<T> {
    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Total bytes of all run files.
    pub fn run_bytes(&self) -> u64 {
        self.ranges.iter().fold(0, |sum: u64, range| sum.saturating_add(range.run_bytes))
    }

    /// Opens the byte stream of a layer. The file is opened again for it, because many summaries
    /// are held while shards are merged.
    ///
    /// # Errors
    /// If the file cannot be read, or its list of blocks is corrupt.
    pub fn bytes_of(&self, range: &RangeSummary<T>) -> Result<SummaryBytes> {
        SummaryBytes::new(open(&self.path, &self.access)?, range.range.layer)
    }
}

fn open(path: &Path, access: &FileAccess) -> Result<BlockFile> {
    // Positioned reads turn truncation of an open file into an error.
    let options = OpenOptions::new().access(access.clone().positioned(CACHE));
    BlockFile::open(path, options.open(path)?, (Content::Shard, "a shard summary"), &options)
}
