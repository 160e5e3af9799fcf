//! Where trees are written: to a file of their own, or to a part of one.

use std::path::PathBuf;

use super::goblin::Shard;
use super::tree_writer::TreeWriter;
use spinney_base::Result;
use spinney_base::io::{FileAccess, Output, folder};
use spinney_base::space::Dimension;

/// The file that trees are written to, or the part of one.
///
/// ```
/// use spinney::{FileView, Output, WriteOptions};
/// use spinney::raw::ops::transform_to;
/// use spinney::raw::store::goblin::{Shard, ShardPiece};
/// use spinney::raw::store::TreeTarget;
/// use spinney::raw::space::CodeRun;
///
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// # let folder = tempfile::tempdir().unwrap();
/// let (map, how) = (FileView::of("fixtures/v1/classes.goblin".as_ref()), WriteOptions::new(64 << 20));
/// let head = folder.path().join("head.goblin");
/// transform_to(&map, TreeTarget::Head(Output::create(&head)?), how, &())?;
/// let shard = Shard {
///     folder: folder.path().into(),
///     job: 1,
///     number: 0,
///     pieces: vec![ShardPiece { layer: 0, run: CodeRun::ALL }],
///     access: Default::default(),
/// };
/// transform_to(&map, TreeTarget::Shard { head, shard, check: Box::new(|| Ok(())) }, how, &())?;
/// assert!(folder.path().join("0000.summary").exists());
/// # Ok::<(), spinney::Error>(())
/// ```
pub enum TreeTarget {
    /// A whole file.
    File(Output),
    /// A file that tells of layers, and has none of their cells: see [`TreeWriter::head`].
    Head(Output),
    /// A shard of a file: see [`TreeWriter::shard`].
    Shard {
        /// The file that tells of the layers.
        head: PathBuf,
        /// The part of them that is made.
        shard: Shard,
        /// A check, such as that inputs have not changed, without which the shard does not count as made when all of its cells are there.
        check: ShardCheck,
    },
}

/// Check that is done before a shard counts as made.
pub type ShardCheck = Box<dyn Fn() -> Result<()> + Send>;

impl From<Output> for TreeTarget {
    fn from(output: Output) -> TreeTarget {
        TreeTarget::File(output)
    }
}

impl TreeTarget {
    /// Starts writing so many layers, whose space has so many levels.
    ///
    /// # Errors
    /// Those of [`TreeWriter::create`], [`TreeWriter::head`] and [`TreeWriter::shard`].
    pub fn start(self, space: (Dimension, u8), layers: u32) -> Result<TreeWriter> {
        match self {
            TreeTarget::File(output) => TreeWriter::create(output, space, layers),
            TreeTarget::Head(output) => TreeWriter::head(output, space, layers),
            TreeTarget::Shard { head, shard, check } => Ok(TreeWriter::shard(&head, shard)?.checked(check)),
        }
    }

    /// The file that appears, if it is a whole one.
    pub fn whole(&self) -> Option<&Output> {
        match self {
            TreeTarget::File(output) => Some(output),
            TreeTarget::Head(_) | TreeTarget::Shard { .. } => None,
        }
    }

    /// How it is written.
    pub fn access(&self) -> &FileAccess {
        match self {
            TreeTarget::File(output) | TreeTarget::Head(output) => output.access(),
            TreeTarget::Shard { shard, .. } => &shard.access,
        }
    }

    /// The folder for temporary files, beside what is written.
    pub fn temporary(&self) -> PathBuf {
        match self {
            TreeTarget::File(output) | TreeTarget::Head(output) if output.is_file() => {
                folder(output.path()).to_path_buf()
            }
            TreeTarget::File(_) | TreeTarget::Head(_) => std::env::temp_dir(),
            TreeTarget::Shard { shard, .. } => shard.temporary().to_path_buf(),
        }
    }
}
