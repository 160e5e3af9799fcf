//! `spinney info` of a tree of lines.

use std::fmt::Write as _;

use anyhow::Result;
use serde_json::json;
use spinney::lines::LineTree;
use spinney::raw::io::shown;
use spinney::raw::lines::LevelTotals;

use super::super::report::quantity::counted;
use super::super::report::{print_json, print_text};
use super::{coordinates, is_in_plane, length_axes, lengths};

/// Prints the contents of a tree of lines; with `levels` also the nodes of each level.
pub(crate) fn info(tree: &LineTree, levels: bool, is_json: bool) -> Result<()> {
    let totals = tree.levels()?;
    if is_json { print_json(&as_json(tree, &totals)?) } else { print_text(&as_text(tree, &totals, levels)?) }
}

fn as_json(tree: &LineTree, levels: &[LevelTotals]) -> Result<serde_json::Value> {
    let metadata = tree.metadata();
    let (nodes, blocks, feature_blocks) = tree.counts();
    let level = |totals: &LevelTotals| {
        json!({
            "nodes": totals.nodes,
            "segments": totals.segments,
            "length": totals.length,
            "most_segments": totals.most_segments,
            "most_features": totals.most_features,
        })
    };
    let names: Vec<&str> = tree.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    Ok(json!({
        "file": shown(tree.path()),
        "format": "Goblin",
        "tree": kind(tree),
        "features": tree.len(),
        "segments": tree.segments(),
        "length": tree.length()?,
        "length_axes": length_axes(tree),
        "bounds": tree.bounds()?.map(|bounds| bounds.map(|corner| coordinates(tree, &corner).to_vec())),
        "leaf_size": tree.leaf_size(),
        "nodes": nodes,
        "blocks": blocks,
        "feature_blocks": feature_blocks,
        "levels": levels.iter().map(level).collect::<Vec<_>>(),
        "scale": coordinates(tree, &tree.grid().scale),
        "offset": coordinates(tree, &tree.grid().offset),
        "attributes": names,
        "epsg": metadata.frame.crs.as_ref().and_then(|crs| crs.numbers()).map(|numbers| numbers.horizontal),
        "provenance": metadata.clean_provenance(),
        "tags": metadata.tags,
        "bytes": tree.bytes(),
    }))
}

fn kind(tree: &LineTree) -> &'static str {
    if tree.grid().axes() == 3 { "octree of lines" } else { "quadtree of lines" }
}

fn joined(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

fn as_text(tree: &LineTree, levels: &[LevelTotals], with_levels: bool) -> Result<String> {
    let mut text = String::new();
    writeln!(text, "{}", shown(tree.path()))?;
    writeln!(text, "format      Goblin, {}", kind(tree))?;
    writeln!(text, "features    {}", tree.len())?;
    writeln!(text, "lines       {}", lengths(tree)?)?;
    if let Some(bounds) = tree.bounds()? {
        let [low, high] = bounds.map(|corner| joined(coordinates(tree, &corner)));
        writeln!(text, "bounds      {low} to {high}")?;
    }
    let (nodes, blocks, _) = tree.counts();
    let (count, leaf) = (counted(levels.len() as u64, "level"), tree.leaf_size());
    writeln!(text, "nodes       {nodes} in {count}, {blocks} blocks of at most {leaf} segments")?;
    let [scale, _, height] = tree.grid().scale;
    let height = if is_in_plane(tree) { format!(", {height} of height") } else { String::new() };
    writeln!(text, "grid        units of {scale}{height}")?;
    if let Some(crs) = &tree.metadata().frame.crs {
        writeln!(text, "crs         {crs}")?;
    }
    for line in tree.metadata().clean_provenance() {
        writeln!(text, "from        {line}")?;
    }
    for (key, value) in tree.metadata().tags.iter().filter(|(_, value)| value.len() <= 80) {
        writeln!(text, "tag         {key} = {value}")?;
    }
    let names: Vec<&str> = tree.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    writeln!(text, "attributes  {}", names.join(", "))?;
    writeln!(text, "bytes       {}", tree.bytes())?;
    for (level, totals) in levels.iter().enumerate().filter(|_| with_levels) {
        let LevelTotals { nodes, segments, length, most_segments, most_features } = totals;
        writeln!(
            text,
            "level {level:<5} {nodes} nodes with {segments} segments of their own, length {length}; at most {most_segments} segments of {most_features} features in a subtree"
        )?;
    }
    Ok(text)
}
