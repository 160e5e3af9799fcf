//! Shards: runs of consecutive nodes of a file that are built independently, and their output
//! files.
//!
//! A shard writes the bytes that the merged file contains to *run files*, one per layer. It writes
//! everything else that merging needs to a *shard summary*.

mod reader;
mod run_file;
mod summary;
#[cfg(test)]
mod tests;
mod writer;

use std::path::{Path, PathBuf};

pub use reader::SummaryBytes;
pub use run_file::RunFile;
pub use summary::{RangeSummary, ShardSummary};
pub use writer::SummaryWriter;

use spinney_base::io::{FileAccess, directory_of, url_of};
use spinney_base::space::CodeRange;
use spinney_base::{Error, Result};

/// Consecutive nodes of one layer, at the level at which a file is cut into shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardRange {
    /// Number of the layer; 0 for trees of points.
    pub layer: u32,
    /// The nodes.
    pub run: CodeRange,
}

/// Checks that the runs of a layer are contiguous and cover the whole space. `head` is for
/// messages.
///
/// # Errors
/// If they leave gaps, overlap, or are in another order.
pub fn check_cover(head: &Path, layer: u32, runs: &mut dyn Iterator<Item = CodeRange>) -> Result<()> {
    let wrong =
        |found, expected| Err(Error::invalid(format!("shards of {}", head.display()), found, expected));
    let mut next = 0;
    for run in runs {
        let [first, last] = run.ends();
        if first != next {
            let found = format!("a shard of layer {layer} that begins at code {first:016x}");
            return wrong(found, format!("code {next:016x}"));
        }
        next = last + 1;
    }
    if next != CodeRange::ALL.ends()[1] + 1 {
        let found = format!("shards of layer {layer} that end at code {next:016x}");
        return wrong(found, "shards up to the last code".into());
    }
    Ok(())
}

/// A shard of a file. Its summary is written last: the shard is complete if the summary exists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Local or remote directory of a file's shards.
    pub directory: PathBuf,
    /// Identifies the planned output and its inputs. Summaries store it.
    pub job: u128,
    /// Number of this shard, in file order.
    pub number: u32,
    /// Its run of each layer, in file order.
    pub ranges: Vec<ShardRange>,
    /// How its files are read and written.
    pub access: FileAccess,
}

impl Shard {
    /// Paths of all files that it may have: the summary, the checksums of an index's sources, and
    /// the run file of each of its layers.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let runs = self.ranges.iter().map(|range| self.run_path(range.layer));
        [self.summary_path(), self.sources_path()].into_iter().chain(runs)
    }

    /// Path of the checksums of the chunks that it has read, if it is one of an index.
    pub fn sources_path(&self) -> PathBuf {
        self.directory.join(format!("{:04}.sources", self.number))
    }

    /// Local directory for temporary files: the shard directory, unless that is remote.
    pub fn temporary(&self) -> &Path {
        match url_of(&self.directory) {
            Some(_) => directory_of(&self.directory),
            None => &self.directory,
        }
    }

    /// Path of the summary.
    pub fn summary_path(&self) -> PathBuf {
        self.directory.join(format!("{:04}.summary", self.number))
    }

    /// Path of a layer's run file, which exists only if the shard has bytes of that layer.
    pub fn run_path(&self, layer: u32) -> PathBuf {
        self.directory.join(format!("{:04}-{layer}.run", self.number))
    }

    /// Returns the run of a layer, if the shard has one.
    pub fn range(&self, layer: u32) -> Option<&ShardRange> {
        self.ranges.iter().find(|range| range.layer == layer)
    }

    /// The error for a summary that belongs to another job.
    pub fn another_job(&self) -> Error {
        let advice = format!("remove the directory {}, and build its shards again", self.directory.display());
        Error::unsupported(self.summary_path(), "a shard of another job", advice)
    }

    /// The error for a merge of a shard that is not built yet.
    pub fn not_built(&self) -> Error {
        let found = "merging before this shard is built";
        Error::unsupported(self.summary_path(), found, "build the shard first")
    }
}
