//! Tree files of either format as sources.

use std::path::Path;
use std::sync::Arc;

use super::autumnal::{Autumnal, Kept, Node};
use super::goblin::{Goblin, Handle, Header, Layout, Metadata, OpenOptions, read_header};
use super::{Positioned, TreeFormat, split_commit};
use crate::space::{Bounds, Oct, Quad};
use crate::tree::{Child, Patched, PatchedNode, Source, Stored};
use crate::value::{Tally, Value};
use crate::{Error, Result, with_value_type};

/// A tree file of either format, open for reading.
pub enum File<D: Layout, V: Value> {
    /// Published.
    Goblin(Box<Goblin<D, V>>),
    /// Edited: one of its commits.
    Autumnal(Arc<Autumnal<D, V>>),
    /// The same with changes on it that are not written yet.
    Patched(Patched<Arc<Autumnal<D, V>>>),
}

/// An INNER node of an open file.
#[derive(Clone, Copy, Debug)]
pub enum FileNode<D: Layout, V: Value> {
    /// Of a Goblin file.
    Goblin(Handle<D>),
    /// Of an Autumnal file.
    Autumnal(Node),
    /// Of one with changes.
    Patched(PatchedNode<D, V, Node>),
}

impl<D: Layout, V: Value> File<D, V> {
    /// Opens a file, or a commit of one: see [`split_commit`].
    ///
    /// # Errors
    /// If it cannot be read, is no tree file, is damaged, or holds other dimensions or values than asked for.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Self> {
        let (file, _) = split_commit(path);
        match file_format(&file)? {
            TreeFormat::Goblin => Ok(File::Goblin(Box::new(Goblin::open(path, options)?))),
            TreeFormat::Autumnal => Ok(File::Autumnal(Arc::new(Autumnal::open(path, options)?))),
        }
    }

    /// The file, for messages.
    pub fn path(&self) -> &Path {
        match self {
            File::Goblin(file) => file.path(),
            File::Autumnal(file) => file.path(),
            File::Patched(file) => file.source().path(),
        }
    }

    /// What the header says.
    pub fn header(&self) -> &Header {
        match self {
            File::Goblin(file) => file.header(),
            File::Autumnal(file) => file.header(),
            File::Patched(file) => file.source().header(),
        }
    }

    /// What is told about the data.
    pub fn metadata(&self) -> &Metadata {
        match self {
            File::Goblin(file) => file.metadata(),
            File::Autumnal(file) => file.metadata(),
            File::Patched(file) => file.source().metadata(),
        }
    }

    /// Whether classes are counted per zone.
    pub fn counts_classes(&self) -> bool {
        match self {
            File::Goblin(file) => file.counts_classes(),
            File::Autumnal(file) => file.counts_classes(),
            File::Patched(file) => file.source().counts_classes(),
        }
    }
}

/// The format that a file has, whatever its name.
pub(crate) fn file_format(file: &Path) -> Result<TreeFormat> {
    Ok(read_header(file, &Positioned::open(file)?)?.0)
}

/// Whether a file, or one of its commits, is a tree of either format, whatever its name.
pub fn file_is_tree(path: &Path) -> bool {
    file_format(&split_commit(path).0).is_ok()
}

/// Work on a file that is the same for all types, each compiled for itself.
pub(crate) trait Typed {
    /// What comes of it.
    type Out;

    /// The work, for a tree of one type.
    fn of<D: Layout, V: Value>(self) -> Result<Self::Out>;
}

/// Does some work with the types that a file has.
pub(crate) fn typed<T: Typed>(path: &Path, work: T) -> Result<T::Out> {
    let (file, _) = split_commit(path);
    let (_, header) = read_header(&file, &Positioned::open(&file)?)?;
    let unknown = || {
        let expected = "1 to 4 channels of u8, u16 or f32, or 1 channel";
        Error::corrupt(&*file, "header", format!("values {}", header.value), expected)
    };
    if header.axes == 2 {
        with_value_type!(header.value, V => work.of::<Quad, V>(), else Err(unknown()))
    } else {
        with_value_type!(header.value, V => work.of::<Oct, V>(), else Err(unknown()))
    }
}

/// A node that does not belong to the file.
const OTHER: &str = "nodes go to the file that they are from";

impl<D: Layout, V: Value> Source for File<D, V> {
    type Dim = D;
    type Value = V;
    type Node = FileNode<D, V>;

    fn depth(&self) -> u8 {
        self.header().shape.depth
    }

    fn root(&self) -> Result<Child<V, FileNode<D, V>>> {
        Ok(match self {
            File::Goblin(file) => file.root()?.map_node(FileNode::Goblin),
            File::Autumnal(file) => file.root()?.map_node(FileNode::Autumnal),
            File::Patched(file) => file.root()?.map_node(FileNode::Patched),
        })
    }

    fn each_child(
        &self,
        node: &FileNode<D, V>,
        mut each: impl FnMut(usize, Child<V, FileNode<D, V>>) -> Result<()>,
    ) -> Result<()> {
        match (self, node) {
            (File::Goblin(file), FileNode::Goblin(node)) => {
                file.each_child(node, |step, child| each(step, child.map_node(FileNode::Goblin)))
            }
            (File::Autumnal(file), FileNode::Autumnal(node)) => {
                file.each_child(node, |step, child| each(step, child.map_node(FileNode::Autumnal)))
            }
            (File::Patched(file), FileNode::Patched(node)) => {
                file.each_child(node, |step, child| each(step, child.map_node(FileNode::Patched)))
            }
            _ => unreachable!("{OTHER}"),
        }
    }

    fn draw(&self, bounds: &Bounds, values: &mut [V::Wire], valid: &mut [bool]) -> Result<bool> {
        match self {
            File::Goblin(file) => file.draw(bounds, values, valid),
            File::Autumnal(_) | File::Patched(_) => Ok(false),
        }
    }

    fn stored(&self, node: &FileNode<D, V>) -> Option<Stored<'_, D, V>> {
        match (self, node) {
            (File::Goblin(file), FileNode::Goblin(node)) => file.stored(node),
            _ => None,
        }
    }

    fn kept(&self, node: &FileNode<D, V>) -> Option<Kept> {
        match (self, node) {
            (File::Autumnal(file), FileNode::Autumnal(node)) => file.kept(node),
            (File::Patched(file), FileNode::Patched(node)) => file.kept(node),
            _ => None,
        }
    }

    fn tally(&self, node: &FileNode<D, V>) -> Result<Option<Tally<V>>> {
        match (self, node) {
            (File::Autumnal(file), FileNode::Autumnal(node)) => file.tally(node),
            (File::Patched(file), FileNode::Patched(node)) => file.tally(node),
            _ => Ok(None),
        }
    }
}
