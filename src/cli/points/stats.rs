//! `spinney stats` of a tree of points.

use anyhow::Result;
use spinney::points::{PointTree, Selection};

use super::super::Global;
use super::super::report::{Work, print_json, print_text};
use super::info::{statistics_as_json, statistics_as_text};

/// Prints counts, extremes and means of the points of a selection.
pub(crate) fn stats(tree: &PointTree, selection: &Selection, is_json: bool, global: &Global) -> Result<()> {
    let work = Work::start(global, "blocks")?;
    let found = tree.statistics(selection, &work)?;
    work.finish();
    match is_json {
        true => print_json(&statistics_as_json(tree, &found)),
        false => print_text(&format!("points      {}\n{}", found.points, statistics_as_text(tree, &found))),
    }
}
