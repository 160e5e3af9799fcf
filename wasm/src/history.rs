//! Commits of Autumnal files, and how they differ.

use std::sync::Arc;

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};
use spinney_container::FileReference;
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::{TreeFile, View, diff as differences};
use spinney_engine::store::autumnal::History;
use spinney_report::{JsonNumbers, commit_as_json};

use crate::files::Opened;
use crate::region::Region;
use crate::result::{Found, count, sample};

/// A comparison of two commits.
#[derive(Deserialize)]
pub(crate) struct Request {
    from: u64,
    to: Option<u64>,
    /// Maximum number of blocks that are returned; all are counted.
    limit: Option<usize>,
}

/// Default maximum number of blocks.
const BLOCKS: usize = 10_000;

/// Fails if the file has no commits.
fn check_commits(tree: &Dataset) -> Result<()> {
    match tree.commit() {
        Some(_) => Ok(()),
        None => Err(Error::unsupported(
            tree.name(),
            "the history of a file without commits",
            "only `.autumn` files have commits",
        )),
    }
}

/// Returns the commits of a file, newest first.
pub(crate) fn commits(opened: &Opened, limit: Option<usize>) -> Result<Found> {
    check_commits(opened.cells()?)?;
    let file = &opened.file;
    let history = History::open(&file.name, &file.options())?;
    let commits = history.commits().take(limit.unwrap_or(usize::MAX));
    let commits = commits
        .map(|commit| Ok(commit_as_json(&commit?, JsonNumbers::Marked)))
        .collect::<Result<Vec<_>>>()?;
    history.check_newest()?;
    Ok(Value::from(commits).into())
}

/// Returns the differences of two commits.
pub(crate) fn diff(opened: &Opened, region: &Region, request: &Request) -> Result<Found> {
    let tree = opened.cells()?;
    check_commits(tree)?;
    let within = match region.boxes(tree)? {
        None => vec![tree.header().extent_bounds()],
        Some(boxes) => boxes,
    };
    let at = |commit: Option<u64>| {
        let layer = Some(tree.layer_number().to_string());
        let reference = FileReference { file: opened.file.name.as_path().into(), commit, layer };
        let file = TreeFile::at(&reference, &opened.file.options())?;
        let extent = file.header().extent;
        View::new(Arc::new(file.into()), extent)
    };
    let [first, second] = [at(Some(request.from))?, at(request.to)?];
    let limit = request.limit.unwrap_or(BLOCKS);
    let (mut added, mut removed, mut changed, mut number) = (0u64, 0u64, 0u64, 0u64);
    let mut blocks = Vec::new();
    let (depth, value) = (tree.depth(), tree.header().form.value);
    differences(&first, &second, &(), &mut |block| {
        let all = block.code.bounds(depth);
        let cells: u64 = within.iter().map(|bounds| bounds.intersect(&all).volume()).sum();
        if cells == 0 {
            return Ok(());
        }
        match (block.before, block.after) {
            (None, _) => added += cells,
            (_, None) => removed += cells,
            _ => changed += cells,
        }
        number += 1;
        if blocks.len() < limit {
            let first = |found: Option<_>| found.map(|found| sample(value.first_number(found), value.sample));
            let (before, after) = (first(block.before), first(block.after));
            blocks.push(block_json(tree, &all, (before, after)));
        }
        Ok(())
    })?;
    Ok(json!({
        "from": request.from,
        "to": request.to.or(tree.commit().map(|commit| commit.number)),
        "added": count(added),
        "removed": count(removed),
        "changed": count(changed),
        "changedCells": count(added + removed + changed),
        "blockCount": count(number),
        "blocks": blocks,
    })
    .into())
}

fn block_json(tree: &Dataset, cells: &Bounds, (before, after): (Option<Value>, Option<Value>)) -> Value {
    let axes = tree.header().form.axes();
    let [low, high] = tree.metadata().frame.world_box(cells);
    json!({
        "min": cells.min[..axes],
        "size": cells.size()[..axes],
        "world": [&low[..axes], &high[..axes]],
        "before": before,
        "after": after,
    })
}
