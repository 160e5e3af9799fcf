//! Shards: parts of a file's bytes that are made by themselves, and where they are until the file is put together.

use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, folder, url_of};
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
    /// Folder of the shards of a file, on this machine or elsewhere.
    pub folder: PathBuf,
    /// A number of what is made, and of what; light files have it.
    pub job: u128,
    /// Its own number, in the order of the file.
    pub number: u32,
    /// The parts of layers that it has, in the order of the file.
    pub pieces: Vec<ShardPiece>,
    /// How its files are read and written.
    pub access: FileAccess,
}

impl Shard {
    /// All files that it may have: the light file, and the run file of each of its layers.
    pub fn files(&self) -> impl Iterator<Item = PathBuf> {
        let runs = self.pieces.iter().map(|piece| self.run_path(piece.layer));
        [self.light_path()].into_iter().chain(runs)
    }

    /// The folder of this machine for temporary files: that of the shards, if it is here.
    pub fn temporary(&self) -> &Path {
        match url_of(&self.folder) {
            Some(_) => folder(&self.folder),
            None => &self.folder,
        }
    }

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
