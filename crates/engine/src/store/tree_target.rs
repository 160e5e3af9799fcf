//! Where trees are written: to a file of their own, or to a shard of one.

use std::path::PathBuf;

use super::goblin::Shard;
use super::tree_writer::TreeWriter;
use spinney_base::Result;
use spinney_base::io::{FileAccess, Output, directory_of};
use spinney_base::space::Dimension;

/// The file that trees are written to, or a shard of one.
///
/// ```
/// use spinney::{FileView, Output, WriteOptions};
/// use spinney::raw::ops::transform_to;
/// use spinney::raw::store::goblin::{Shard, ShardRange};
/// use spinney::raw::store::TreeTarget;
/// use spinney::raw::space::CodeRange;
///
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// # let directory = tempfile::tempdir().unwrap();
/// let (map, how) = (FileView::of("fixtures/v1/classes.goblin".as_ref()), WriteOptions::new(64 << 20));
/// let head = directory.path().join("head.goblin");
/// transform_to(&map, TreeTarget::Head(Output::create(&head)?), how, &())?;
/// let shard = Shard {
///     directory: directory.path().into(),
///     job: 1,
///     number: 0,
///     ranges: vec![ShardRange { layer: 0, run: CodeRange::ALL }],
///     access: Default::default(),
/// };
/// transform_to(&map, TreeTarget::Shard { head, shard, check: Box::new(|| Ok(())) }, how, &())?;
/// assert!(directory.path().join("0000.summary").exists());
/// # Ok::<(), spinney::Error>(())
/// ```
pub enum TreeTarget {
    /// A whole file.
    File(Output),
    /// A file with headers and metadata of layers, but without their cells: see
    /// [`TreeWriter::head`].
    Head(Output),
    /// A shard of a file: see [`TreeWriter::shard`].
    Shard {
        /// The file with headers and metadata of the layers.
        head: PathBuf,
        /// The shard that is built.
        shard: Shard,
        /// A check after all cells are written, such as that inputs have not changed. If it fails,
        /// the shard does not count as complete.
        check: ShardCheck,
    },
}

/// Check that runs before a shard counts as complete.
pub type ShardCheck = Box<dyn Fn() -> Result<()> + Send>;

impl From<Output> for TreeTarget {
    fn from(output: Output) -> TreeTarget {
        TreeTarget::File(output)
    }
}

impl TreeTarget {
    /// Starts writing `layers` layers, whose `space` has a dimension and a number of levels.
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

    /// Returns the output, if it is a whole file.
    pub fn whole(&self) -> Option<&Output> {
        match self {
            TreeTarget::File(output) => Some(output),
            TreeTarget::Head(_) | TreeTarget::Shard { .. } => None,
        }
    }

    /// Returns how the target is written.
    pub fn access(&self) -> &FileAccess {
        match self {
            TreeTarget::File(output) | TreeTarget::Head(output) => output.access(),
            TreeTarget::Shard { shard, .. } => &shard.access,
        }
    }

    /// Returns the directory for temporary files: that of the target, or the system's if the target
    /// is not a file.
    pub fn temporary(&self) -> PathBuf {
        match self {
            TreeTarget::File(output) | TreeTarget::Head(output) if output.is_file() => {
                directory_of(output.path()).to_path_buf()
            }
            TreeTarget::File(_) | TreeTarget::Head(_) => std::env::temp_dir(),
            TreeTarget::Shard { shard, .. } => shard.temporary().to_path_buf(),
        }
    }
}
