//! Files of warped trees.

use super::source::Warped;
use crate::ops::view_source::ViewSource;
use crate::store::{BuildOptions, build};
use spinney_base::io::Output;
use spinney_base::value::Tally;
use spinney_base::{Progress, Result};

/// Writes a warped tree to a file, in the format that the output's name asks for; returns the tally of its cells. `share` is whether equal
/// subtrees are stored once, `memory` as in [`BuildOptions`].
///
/// # Errors
/// If the source is damaged, the output cannot be written, or on interruption.
pub fn warp(
    warped: Warped,
    (share, time): (bool, Option<i64>),
    output: Output,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Tally> {
    let tree = ViewSource::from(warped);
    tree.tell_remark(progress);
    let (header, metadata) = (tree.header().clone(), tree.metadata().clone());
    let options = BuildOptions { metadata, share, time, ..BuildOptions::like(&header, memory) };
    build(&tree, header.extent, &options, output, progress)
}
