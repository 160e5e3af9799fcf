//! Shards: parts of a file's bytes that are made by themselves, and where they are until the file is put together.

use std::path::{Path, PathBuf};

use spinney_base::space::CodeRun;

/// A part of one layer of a file: nodes at the layer's crown level, one behind the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShardPiece {
    /// Number of the layer.
    pub layer: u32,
    /// The nodes.
    pub run: CodeRun,
}

/// A shard of a file: its segments go to *run files*, one for each piece that has some, and what whoever puts the file together has to
/// know besides goes to a *light file*, which is written last.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Folder of the shards of a file.
    pub folder: PathBuf,
    /// A number of what is made, and of what; light files have it.
    pub job: u128,
    /// Its own number, in the order of the file.
    pub number: u32,
    /// The parts of layers that it has, in the order of the file.
    pub pieces: Vec<ShardPiece>,
}

impl Shard {
    /// The light file, which is there when the shard is made.
    pub(in crate::store) fn light_path(&self) -> PathBuf {
        self.folder.join(format!("{:04}.light", self.number))
    }

    /// The run file of a layer; there is none if the shard has no segments of it.
    pub(in crate::store) fn run_path(&self, layer: u32) -> PathBuf {
        self.folder.join(format!("{:04}-{layer}.run", self.number))
    }

    /// The piece of a layer, if the shard has one.
    pub(super) fn piece(&self, layer: u32) -> Option<&ShardPiece> {
        self.pieces.iter().find(|piece| piece.layer == layer)
    }
}

/// Bytes of a file; 0 if there is none.
pub(super) fn length_of(path: &Path) -> std::io::Result<u64> {
    match std::fs::metadata(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(0),
        found => found.map(|found| found.len()),
    }
}
