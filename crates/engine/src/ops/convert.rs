//! Conversion of tree files to the other format.

use std::path::Path;

use super::layers::{file_depth, layer_paths};
use super::tree_file::TreeFile;
use super::view_source::ViewSource;
use crate::store::builder::ReusableSource;
use crate::store::{BuildOptions, TreeTarget, TreeWriter, WriteOptions, build_with, check_space};
use spinney_base::io::Output;
use spinney_base::{Progress, Result};

/// Writes a tree, or all layers of a file, unchanged in the format of the output's name. Publishes
/// an Autumnal file (or one of its commits), or makes a Goblin file editable. Bytes are preserved
/// from Goblin to Autumnal and back. Segments are packed as `how` says, regardless of the packing
/// of the file. The file is opened with the output's [access](Output::access).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{Output, WriteOptions};
/// use spinney::raw::ops;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("published.goblin");
/// let history = "fixtures/v1/history.autumn@1";
/// spinney::convert(history.as_ref(), false, Output::create(&path)?, WriteOptions::new(64 << 20), &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read, the output cannot be written or has insufficient space for all
/// nodes, or on cancellation.
pub fn convert(
    path: &Path,
    share: bool,
    output: Output,
    how: WriteOptions,
    progress: &dyn Progress,
) -> Result<()> {
    let paths = layer_paths(path, output.access())?;
    let files = paths.iter().map(|path| TreeFile::open(path, &output.access().into()));
    let files = files.collect::<Result<Vec<TreeFile>>>()?;
    let first = files[0].header();
    let mut needed = Vec::with_capacity(files.len());
    for file in &files {
        needed.push((file.header().form, file.shared_records()?));
    }
    for (form, records) in needed {
        check_space(&output, form, share, records)?;
    }
    let depth = file_depth(files.iter().map(TreeFile::header));
    let mut writer = TreeWriter::create(output, (first.form.dimension, depth), files.len() as u32)?;
    ViewSource::from(files[0].clone()).report_remark(progress);
    for file in files {
        let (header, metadata) = (file.header(), file.metadata().clone());
        let options = BuildOptions { metadata, share, ..BuildOptions::written_like(header, how) };
        writer.source(&ViewSource::from(file.clone()), header.extent, &options, progress)?;
    }
    writer.finish()
}

/// Writes a tree, or a view of it, with the given build options.
///
/// # Errors
/// Those of [`convert`].
pub(crate) fn build_again<S: ReusableSource>(
    tree: &ViewSource,
    seen: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    target: TreeTarget,
    progress: &dyn Progress,
) -> Result<()> {
    tree.report_remark(progress);
    // (The number of nodes of a window or of coarser cells is unknown.)
    let records = if extent == tree.header().extent { tree.shared_records()? } else { 0 };
    if let Some(output) = target.whole() {
        check_space(output, seen.form(), options.share, records)?;
    }
    build_with(seen, extent, options, target, progress, &mut |_| {}).map(drop)
}
