//! `spinney info` of a tree of points.

use std::fmt::Write as _;

use anyhow::Result;
use serde_json::json;
use spinney::points::{PointTree, Selection};
use spinney::raw::io::shown;
use spinney::raw::points::PointStatistics;

use super::super::report::quantity::counted;
use super::super::report::{print_json, print_text};

/// Prints the contents of a tree of points.
pub(crate) fn info(tree: &PointTree, is_json: bool) -> Result<()> {
    // (The root has these statistics: no block is read.)
    let statistics = tree.statistics(&Selection::default(), &())?;
    if is_json { print_json(&as_json(tree, &statistics)) } else { print_text(&as_text(tree, &statistics)?) }
}

/// Returns the column names: coordinates and attributes.
pub(super) fn columns(tree: &PointTree) -> impl Iterator<Item = &str> {
    ["x", "y", "z"].into_iter().chain(tree.attributes().iter().map(|attribute| attribute.name.as_str()))
}

/// Returns counts, extremes and means as JSON.
pub(super) fn statistics_as_json(tree: &PointTree, statistics: &PointStatistics) -> serde_json::Value {
    let columns: Vec<_> = columns(tree)
        .zip(&statistics.columns)
        .map(|(name, found)| match found {
            Some(found) => json!({ "name": name, "count": found.count, "min": found.min, "max": found.max, "mean": found.mean }),
            None => json!({ "name": name, "count": 0 }),
        })
        .collect();
    json!({ "points": statistics.points, "columns": columns })
}

fn as_json(tree: &PointTree, statistics: &PointStatistics) -> serde_json::Value {
    let metadata = tree.metadata();
    let (nodes, blocks) = tree.counts();
    let types: serde_json::Map<_, _> = tree
        .attributes()
        .iter()
        .map(|attribute| (attribute.name.clone(), json!(attribute.sample.name())))
        .collect();
    json!({
        "file": shown(tree.path()),
        "format": "Goblin",
        "tree": if tree.dimension().axes() == 3 { "octree of points" } else { "quadtree of points" },
        "points": tree.len(),
        "duplicates": tree.duplicates(),
        "depth": tree.depth(),
        "leaf_size": tree.leaf_size(),
        "nodes": nodes,
        "blocks": blocks,
        "scale": tree.grid().scale,
        "offset": tree.grid().offset,
        "types": types,
        "statistics": statistics_as_json(tree, statistics),
        "epsg": metadata.frame.crs.as_ref().and_then(|crs| crs.numbers()).map(|numbers| numbers.horizontal),
        "provenance": metadata.clean_provenance(),
        "tags": metadata.tags,
        "bytes": tree.bytes(),
    })
}

/// Returns counts, extremes and means as lines of text.
pub(super) fn statistics_as_text(tree: &PointTree, statistics: &PointStatistics) -> String {
    let mut text = String::new();
    for (name, found) in columns(tree).zip(&statistics.columns) {
        if let Some(found) = found {
            text.push_str(&format!("  {name:<22} {} to {}, mean {}\n", found.min, found.max, found.mean));
        }
    }
    text
}

fn as_text(tree: &PointTree, statistics: &PointStatistics) -> Result<String> {
    let mut text = String::new();
    let kind = if tree.dimension().axes() == 3 { "octree" } else { "quadtree" };
    writeln!(text, "{}", shown(tree.path()))?;
    writeln!(text, "format      Goblin, {kind} of points")?;
    writeln!(text, "points      {}, {} of them duplicates", tree.len(), tree.duplicates())?;
    let (nodes, blocks) = tree.counts();
    writeln!(
        text,
        "nodes       {nodes} in {}, {blocks} blocks of at most {} points",
        counted(u64::from(tree.depth()) + 1, "level"),
        tree.leaf_size()
    )?;
    let [x, y, z] = tree.grid().scale;
    writeln!(text, "grid        units of {x}, {y}, {z}")?;
    if let Some(crs) = &tree.metadata().frame.crs {
        writeln!(text, "crs         {crs}")?;
    }
    for line in tree.metadata().clean_provenance() {
        writeln!(text, "from        {line}")?;
    }
    for (key, value) in tree.metadata().tags.iter().filter(|(_, value)| value.len() <= 80) {
        writeln!(text, "tag         {key} = {value}")?;
    }
    writeln!(text, "bytes       {}", tree.bytes())?;
    writeln!(text, "attributes")?;
    text.push_str(&statistics_as_text(tree, statistics));
    Ok(text)
}
