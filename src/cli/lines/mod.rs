//! The subcommands for trees of lines.

mod build;
mod get;
mod info;
mod nearest;
mod stats;

use std::path::Path;

use anyhow::{Result, bail};
use spinney::Coordinates;
use spinney::lines::LineTree;
use spinney::raw::lines::is_line_file;

use super::Global;
use super::args::PartOptions;

pub(super) use build::LineImport;
pub(super) use get::get;
pub(super) use info::info;
pub(super) use nearest::nearest;
pub(super) use stats::{Join, join, stats};

/// Opens the tree of lines in a file; `None` if the file has anything else.
pub(super) fn open(path: &Path, global: &Global) -> Result<Option<LineTree>> {
    if !is_line_file(path, global.access())? {
        return Ok(None);
    }
    Ok(Some(LineTree::open(path, &global.access().into())?))
}

/// Name of trees of lines in messages.
pub(super) const KIND: &str = "a tree of lines";

/// Returns the window, if one was given; a window of four numbers has all heights.
pub(super) fn window(tree: &LineTree, part: &PartOptions) -> Result<Option<[[f64; 3]; 2]>> {
    if !matches!(part.coordinates().given(), None | Some(Coordinates::World)) {
        bail!("--in: expected world: windows of trees of lines are in their own coordinates");
    }
    if part.is_solid() && tree.grid().axes() == 2 {
        bail!("--window: got 6 numbers, expected 4 for a tree of lines without heights");
    }
    Ok(part.corners())
}

/// Coordinates of a position: x and y, and z in a tree with heights.
pub(super) fn coordinates<'a>(tree: &LineTree, position: &'a [f64; 3]) -> &'a [f64] {
    &position[..tree.grid().axes()]
}

/// Whether there are heights that do not count in lengths.
fn is_in_plane(tree: &LineTree) -> bool {
    tree.grid().axes() == 3 && !tree.grid().measures_space()
}

/// Number of axes that lengths and distances combine.
fn length_axes(tree: &LineTree) -> usize {
    if tree.grid().measures_space() { 3 } else { 2 }
}

/// Returns the number and the length of segments as text.
fn lengths(tree: &LineTree) -> Result<String> {
    let plane = if is_in_plane(tree) { " in x and y" } else { "" };
    Ok(format!("{} segments, length {}{plane}", tree.segments(), tree.length()?))
}

/// Splits a comma-separated list of names.
pub(super) fn names(text: Option<&str>) -> Option<Vec<String>> {
    text.map(|text| text.split(',').map(|name| name.trim().to_owned()).collect())
}
