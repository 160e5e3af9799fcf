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
pub use summary::{PieceSummary, ShardSummary};
pub use writer::SummaryWriter;

use spinney_base::io::{FileAccess, folder, url_of};
use spinney_base::space::CodeRun;
use spinney_base::{Error, Result};

/// Consecutive nodes of one layer, at the level at which a file is cut into shards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardPiece {
    /// Number of the layer; 0 for trees of points.
    pub layer: u32,
    /// The nodes.
    pub run: CodeRun,
}

/// Checks that the runs of a layer are contiguous and cover the whole space. `head` is for
/// messages.
///
/// # Errors
/// If they leave gaps, overlap, or are in another order.
pub fn check_cover(head: &Path, layer: u32, runs: &mut dyn Iterator<Item = CodeRun>) -> Result<()> {
    let wrong =
        |found, expected| Err(Error::invalid(format!("shards of {}", head.display()), found, expected));
    let mut next = 0;
    for run in runs {
        let [first, last] = run.ends();
        if first != next {
            let found = format!("a shard of layer {layer} that begins at {first:016x}");
            return wrong(found, format!("{next:016x}"));
        }
        next = last + 1;
    }
    if next != CodeRun::ALL.ends()[1] + 1 {
        let found = format!("shards of layer {layer} that end before {next:016x}");
        return wrong(found, "the whole space".into());
    }
    Ok(())
}

/// A shard of a file. Its summary is written last: the shard is complete if the summary exists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Local or remote directory of a file's shards.
    pub folder: PathBuf,
    /// Identifies the planned output and its inputs. Summaries store it.
    pub job: u128,
    /// Number of this shard, in file order.
    pub number: u32,
    /// Its run of each layer, in file order.
    pub pieces: Vec<ShardPiece>,
    /// How its files are read and written.
    pub access: FileAccess,
}

impl Shard {
    /// Paths of all files that it may have: the summary, and the run file of each of its layers.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let runs = self.pieces.iter().map(|piece| self.run_path(piece.layer));
        [self.summary_path()].into_iter().chain(runs)
    }

    /// Local directory for temporary files: the shard directory, unless that is remote.
    pub fn temporary(&self) -> &Path {
        match url_of(&self.folder) {
            Some(_) => folder(&self.folder),
            None => &self.folder,
        }
    }

    /// Path of the summary.
    pub fn summary_path(&self) -> PathBuf {
        self.folder.join(format!("{:04}.summary", self.number))
    }

    /// Path of a layer's run file, which exists only if the shard has bytes of that layer.
    pub fn run_path(&self, layer: u32) -> PathBuf {
        self.folder.join(format!("{:04}-{layer}.run", self.number))
    }

    /// Returns the run of a layer, if the shard has one.
    pub fn piece(&self, layer: u32) -> Option<&ShardPiece> {
        self.pieces.iter().find(|piece| piece.layer == layer)
    }

    /// The error for a summary that belongs to another job.
    pub fn another_job(&self) -> Error {
        let advice = format!("remove the folder {}, and build its shards again", self.folder.display());
        Error::unsupported(self.summary_path(), "a shard of another job", advice)
    }

    /// The error for a merge of a shard that is not built yet.
    pub fn not_built(&self) -> Error {
        let found = "a file of which a shard is not made";
        Error::unsupported(self.summary_path(), found, "build this shard first")
    }
}
