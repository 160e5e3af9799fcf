//! Files of warped trees.

use super::source::Warped;
use crate::ops::view_source::ViewSource;
use crate::store::{BuildOptions, build};
use spinney_base::io::Output;
use spinney_base::value::ZoneStats;
use spinney_base::{Progress, Result};

/// Writes a warped tree to a file, in the format of the output's name; returns the tally of its
/// cells. Of `how`, only memory, time, packing and sharing of equal subtrees apply; all other
/// options are the tree's own.
///
/// # Errors
/// If the source is corrupt, the output cannot be written, or on cancellation.
pub fn warp(
    warped: Warped,
    how: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<ZoneStats> {
    let tree = ViewSource::from(warped);
    tree.report_remark(progress);
    let (header, metadata) = (tree.header().clone(), tree.metadata().clone());
    let BuildOptions { share, time, memory, packing, .. } = *how;
    let options = BuildOptions { metadata, share, time, packing, ..BuildOptions::like(&header, memory) };
    build(&tree, header.extent, &options, output, progress)
}
