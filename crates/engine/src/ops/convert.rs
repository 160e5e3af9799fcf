//! Conversion of tree files to the other format.

use std::path::Path;

use super::tree_file::TreeFile;
use super::view_source::ViewSource;
use crate::store::builder::ReusableSource;
use crate::store::{BuildOptions, build, check_room};
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_container::OpenOptions;

/// Writes a tree as it is, in the format that the output's name asks for: an Autumnal tree (or one of its
/// commits) to be published, or a published one to be edited. From Goblin to Autumnal and back the bytes stay
/// the same.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{io::Output, ops};
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("published.goblin");
/// let history = "fixtures/v1/history.autumn@1";
/// ops::convert(history.as_ref(), false, Output::create(&path)?, 64 << 20, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read, the output not be written, there is no room for all of its nodes, or on interruption.
pub fn convert(path: &Path, share: bool, output: Output, memory: u64, progress: &dyn Progress) -> Result<()> {
    let file: ViewSource = TreeFile::open(path, &OpenOptions::default())?.into();
    let (header, metadata) = (file.header(), file.metadata().clone());
    let options = BuildOptions { metadata, share, ..BuildOptions::like(header, memory) };
    build_again(&file, &file, header.extent, &options, output, progress)
}

/// Writes what is seen of a tree, all of it or a view, with properties of its own.
///
/// # Errors
/// Those of [`convert`].
pub(crate) fn build_again<S: ReusableSource>(
    tree: &ViewSource,
    seen: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<()> {
    tree.tell_remark(progress);
    // (Of a part, or of larger cells, nobody knows how many nodes it has.)
    let records = if extent == tree.header().extent { tree.shared_records()? } else { 0 };
    check_room(&output, seen.form(), options.share, records)?;
    build(seen, extent, options, output, progress).map(drop)
}
