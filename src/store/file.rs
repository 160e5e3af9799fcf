//! Tree files of either format as sources.

use std::path::Path;

use super::autumnal::{Autumnal, Kept, Node};
use super::goblin::{Goblin, Handle, Header, Layout, Metadata, OpenOptions, read_header};
use super::{TreeFormat, split_commit};
use crate::Result;
use crate::space::Bounds;
use crate::tree::{Child, Source, Stored};
use crate::value::{Tally, Value};

/// A tree file of either format, open for reading.
pub enum File<D: Layout, V: Value> {
    /// Published.
    Goblin(Goblin<D, V>),
    /// Edited: one of its commits.
    Autumnal(Autumnal<D, V>),
}

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileNode<D: Layout> {
    /// Of a Goblin file.
    Goblin(Handle<D>),
    /// Of an Autumnal file.
    Autumnal(Node),
}

impl<D: Layout, V: Value> File<D, V> {
    /// Opens a file, or a commit of one: see [`split_commit`].
    ///
    /// # Errors
    /// If it cannot be read, is no tree file, is damaged, or holds other dimensions or values than asked for.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        let (file, _) = split_commit(path);
        let storage = options.storage(&file)?;
        match read_header(&file, &*storage)?.0 {
            TreeFormat::Goblin => Ok(File::Goblin(Goblin::from_storage(path, storage, options)?)),
            TreeFormat::Autumnal => Ok(File::Autumnal(Autumnal::open(path, options)?)),
        }
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        match self {
            File::Goblin(file) => file.path(),
            File::Autumnal(file) => file.path(),
        }
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        match self {
            File::Goblin(file) => file.header(),
            File::Autumnal(file) => file.header(),
        }
    }

    /// What is told about the data.
    pub fn metadata(&self) -> &Metadata {
        match self {
            File::Goblin(file) => file.metadata(),
            File::Autumnal(file) => file.metadata(),
        }
    }

    /// Whether classes are counted per zone.
    pub fn counts_classes(&self) -> bool {
        match self {
            File::Goblin(file) => file.counts_classes(),
            File::Autumnal(file) => file.counts_classes(),
        }
    }
}

/// A node that does not belong to the file.
const OTHER: &str = "nodes go to the file that they are from";

impl<D: Layout, V: Value> Source for File<D, V> {
    type Dim = D;
    type Value = V;
    type Node = FileNode<D>;

    fn depth(&self) -> u8 {
        self.header().shape.depth
    }

    fn root(&self) -> Result<Child<V, FileNode<D>>> {
        Ok(match self {
            File::Goblin(file) => file.root()?.map_node(FileNode::Goblin),
            File::Autumnal(file) => file.root()?.map_node(FileNode::Autumnal),
        })
    }

    fn each_child(
        &self,
        node: &FileNode<D>,
        mut each: impl FnMut(usize, Child<V, FileNode<D>>) -> Result<()>,
    ) -> Result<()> {
        match (self, node) {
            (File::Goblin(file), FileNode::Goblin(node)) => {
                file.each_child(node, |step, child| each(step, child.map_node(FileNode::Goblin)))
            }
            (File::Autumnal(file), FileNode::Autumnal(node)) => {
                file.each_child(node, |step, child| each(step, child.map_node(FileNode::Autumnal)))
            }
            _ => unreachable!("{OTHER}"),
        }
    }

    fn draw(&self, bounds: &Bounds, values: &mut [V::Wire], valid: &mut [bool]) -> Result<bool> {
        match self {
            File::Goblin(file) => file.draw(bounds, values, valid),
            File::Autumnal(file) => file.draw(bounds, values, valid),
        }
    }

    fn stored(&self, node: &FileNode<D>) -> Option<Stored<'_, D, V>> {
        match (self, node) {
            (File::Goblin(file), FileNode::Goblin(node)) => file.stored(node),
            _ => None,
        }
    }

    fn kept(&self, node: &FileNode<D>) -> Option<Kept> {
        match (self, node) {
            (File::Autumnal(file), FileNode::Autumnal(node)) => file.kept(node),
            _ => None,
        }
    }

    fn tally(&self, node: &FileNode<D>) -> Result<Option<Tally<V>>> {
        match (self, node) {
            (File::Autumnal(file), FileNode::Autumnal(node)) => file.tally(node),
            _ => Ok(None),
        }
    }
}
