//! `spinney info`: a file's contents.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use serde_json::json;
use spinney::query::ChannelStatistics;
use spinney::raw::io::{shown, url_of};
use spinney::raw::manifest::ListedFile;
use spinney::raw::ops::{LayerInfo, TreeFile};
use spinney::raw::report::{JsonNumbers, channels_as_json, class_as_json, commit_as_json};
use spinney::raw::store::goblin::LevelBytes;
use spinney::raw::store::{FileReference, LevelCounts, TagScope};
use spinney::{Codec, Crs, Dataset, Frame, Metadata};

use super::args::LayerOption;
use super::report::quantity::counted;
use super::report::unit::{suffix, unit};
use super::report::{commit, print_json, print_text, shortened};
use super::{Global, exact, lines, open, points};

const EXAMPLES: &str = "Examples:
  spinney info world.goblin
  spinney info world.goblin --json > world.json";

/// Print a file's properties
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Tree file
    file: PathBuf,
    #[command(flatten)]
    layer: LayerOption,
    /// Levels with their numbers of nodes, counted in any file: by default, not in .autumn files of
    /// more than 4 million records, where it takes long
    #[arg(long)]
    levels: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    describe(args, global)?;
    if url_of(&args.file).is_some() && !args.json {
        print_text(&format!("fetched     {}\n", global.access().traffic()))?;
    }
    Ok(())
}

fn describe(args: &Args, global: &Global) -> Result<()> {
    if let Some(model) = exact::open(&args.file, global)? {
        global.check_options(&args.file, exact::KIND, &["--json"])?;
        exact::info(&model, args.json)?;
        return Ok(model.check_unchanged()?);
    }
    if let Some(tree) = lines::open(&args.file, global)? {
        global.check_options(&args.file, lines::KIND, &["--levels", "--json"])?;
        return lines::info(&tree, args.levels, args.json);
    }
    if let Some(tree) = points::open(&args.file, global)? {
        global.check_options(&args.file, points::KIND, &["--json"])?;
        return points::info(&tree, args.json);
    }
    let tree = open(&args.layer.paths(&args.file, global)?[0], global.access())?;
    let layers = tree.layers()?;
    let (most, summed) = if args.levels { (u64::MAX, usize::MAX) } else { (COUNTED, SUMMED) };
    if layers.len() > 1 && !args.layer.is_given() && FileReference::of(&args.file).layer.is_none() {
        match args.json {
            true => print_json(&layers_as_json(&tree, &layers, (most, summed))?)?,
            false => print_text(&layers_as_text(&tree, &layers)?)?,
        }
        return Ok(tree.check_unchanged()?);
    }
    let levels = tree.level_counts(most, &())?;
    let levels = levels.as_ref().map(LevelCounts::levels);
    let segments = tree.level_bytes(summed)?;
    if args.json {
        print_json(&as_json(&tree, (levels, segments.as_deref()))?)?
    } else {
        print_text(&as_text(&tree, (levels, segments.as_deref()))?)?
    }
    Ok(tree.check_unchanged()?)
}

/// Describes a file of several layers.
fn layers_as_text(tree: &Dataset, layers: &[LayerInfo]) -> Result<String> {
    let mut text = String::new();
    writeln!(text, "{}: {} file of {} layers", shown(tree.name()), tree.format().name(), layers.len())?;
    if let Some(commit) = tree.commit() {
        writeln!(text, "commit      {}{}", commit.number, commit::about(commit))?;
    }
    write_georeferencing(&mut text, tree)?;
    if let Some(crs) = &tree.metadata().frame.crs {
        writeln!(text, "crs         {crs}")?;
    }
    writeln!(text, "bytes       {}", tree.file_size())?;
    let width = layers.iter().map(|layer| layer.name.chars().count()).max().unwrap_or(0);
    for (number, layer) in layers.iter().enumerate() {
        let header = &layer.header;
        let size: Vec<String> = header.extent[..header.form.axes()].iter().map(u64::to_string).collect();
        let (name, size, value) = (&layer.name, size.join(" x "), header.form.value.to_string());
        writeln!(
            text,
            "layer {number:<5} {name:<width$}  {value:<6} {}, {}, {size} cells, depth {}{}{}",
            header.kind,
            header.rule,
            header.depth(),
            if header.codec == Codec::Plain { "" } else { ", packed" },
            layer.bytes.map_or(String::new(), |bytes| format!(", {bytes} bytes"))
        )?;
    }
    writeln!(text, "next        spinney info {} --layer {}", shown(tree.name()), layers[0].name)?;
    Ok(text)
}

/// Describes all layers as JSON, with node counts per level for up to `most` records, and bytes per
/// level for up to `summed` segments.
fn layers_as_json(
    tree: &Dataset,
    layers: &[LayerInfo],
    (most, summed): (u64, usize),
) -> Result<serde_json::Value> {
    let all = layers.iter().enumerate().map(|(number, layer)| {
        let tree = tree.layer(&layer.name)?;
        let levels = tree.level_counts(most, &())?;
        let segments = tree.level_bytes(summed)?;
        let mut json = as_json(&tree, (levels.as_ref().map(LevelCounts::levels), segments.as_deref()))?;
        json["number"] = json!(number);
        Ok(json)
    });
    Ok(json!({
        "file": shown(tree.name()),
        "format": tree.format().name(),
        "commit": tree.commit().map(|commit| commit_as_json(commit, JsonNumbers::Plain)),
        "bytes": tree.file_size(),
        "layers": all.collect::<Result<Vec<_>>>()?,
    }))
}

/// Record count up to which nodes are counted by default: takes about a second.
const COUNTED: u64 = 1 << 22;

/// Segment count up to which bytes are summed by default: reads about a megabyte of the segment
/// index.
const SUMMED: usize = 1 << 14;

/// VOID, LEAF and INNER nodes of each level.
type Levels<'a> = Option<&'a [[u64; 3]]>;
/// Bytes of segments of each level.
type Segments<'a> = Option<&'a [LevelBytes]>;

/// Returns the lengths of a cell's edges in the world.
fn cell_size(frame: &Frame) -> [f64; 3] {
    let [x, y, z] = frame.matrix;
    std::array::from_fn(|axis| x[axis].hypot(y[axis]).hypot(z[axis]))
}

/// Returns the raster's size in bytes as plain samples.
fn raw_bytes(tree: &Dataset) -> u64 {
    tree.header().extent.iter().product::<u64>().saturating_mul(tree.header().form.value.size() as u64)
}

fn tree_name(tree: &Dataset) -> &'static str {
    if tree.header().form.axes() == 2 { "quadtree" } else { "octree" }
}

fn as_json(tree: &Dataset, (levels, segments): (Levels<'_>, Segments<'_>)) -> Result<serde_json::Value> {
    let header = tree.header();
    let metadata = tree.metadata();
    let stats = tree.statistics(None, &())?;
    let axes = header.form.axes();
    let row = |(level, [void, leaf, inner]): (usize, &[u64; 3])| json!({ "level": level, "void": void, "leaf": leaf, "inner": inner });
    let epsg = metadata.frame.crs.as_ref().and_then(Crs::numbers);
    let levels = levels.map(|levels| levels.iter().enumerate().map(row).collect::<Vec<_>>());
    let of_level = |of: &LevelBytes| {
        let LevelBytes { level, segments, packed, references, bytes, plain } = of;
        let mut json = json!({ "level": level, "segments": segments, "packed": packed, "bytes": bytes, "plain_bytes": plain });
        if *references > 0 {
            json["references"] = json!(references);
        }
        json
    };
    let segments = segments.map(|levels| levels.iter().map(of_level).collect::<Vec<_>>());
    let [low, high] = metadata.frame.world_box(&header.extent_bounds());
    let sections: serde_json::Map<_, _> =
        tree.sections().into_iter().map(|(name, bytes)| (name.to_string(), json!(bytes))).collect();
    let classes: Vec<_> = stats
        .classes
        .iter()
        .map(|(value, cells)| {
            let colour = metadata
                .palette
                .as_ref()
                .and_then(|palette| palette.colours.get(usize::try_from(value.to_integer()?).ok()?));
            let name = metadata.class_names.get(value);
            json!({ "value": class_as_json(*value), "cells": cells, "name": name, "colour": colour })
        })
        .collect();
    let mut json = json!({
        "file": shown(tree.name()),
        "format": tree.format().name(),
        "commit": tree.commit().map(|commit| commit_as_json(commit, JsonNumbers::Plain)),
        "codec": header.codec.name(),
        "layer": metadata.name,
        "time": metadata.time,
        "tree": tree_name(tree),
        "value": header.form.value.to_string(),
        "size": header.extent[..axes],
        "depth": header.shape.depth,
        "kind": header.kind.name(),
        "rule": header.rule.name(),
        "transform": metadata.frame.affine(),
        "matrix": metadata.frame.matrix,
        "origin": metadata.frame.to_world([0.0; 3])[..axes],
        "cell": cell_size(&metadata.frame)[..axes],
        "world": [low[..axes], high[..axes]],
        "unit": unit(tree),
        "epsg": epsg.map(|epsg| epsg.horizontal),
        "vertical_epsg": epsg.and_then(|epsg| epsg.vertical),
        "crs": metadata.frame.crs.as_ref().map(crs_as_json),
        "nodata": metadata.nodata,
        "bands": metadata.band_names,
        "scale_offset": metadata.scale_offset,
        "units": metadata.units,
        "bytes": tree.file_size(),
        "raw_bytes": raw_bytes(tree),
        "sections": sections,
        "segments": tree.segments(),
        "segment_levels": segments,
        "records": tree.commit().map_or(metadata.counts.records(), |_| tree.stored_records()),
        "stored_records": tree.stored_records(),
        "levels": levels,
        "cells": stats.cells,
        "void_cells": stats.void_cells,
        "channels": channels_as_json(&stats, tree.header().form.value.sample, JsonNumbers::Plain),
        "classes": classes,
        "provenance": metadata.clean_provenance(),
        "tags": metadata.tags,
        "scoped_tags": scoped_tags_as_json(metadata),
        "control_points": control_points_as_json(metadata),
    });
    if let Some(files) = listed_as_json(tree) {
        json["files"] = files.into();
    }
    if let Some(sources) = indexed_sources(tree) {
        let (number, some) = sources?;
        let json_of = |(name, bytes): &(String, u64)| json!({ "path": name, "bytes": bytes });
        json["source_count"] = json!(number);
        json["sources"] = some.iter().map(json_of).collect::<Vec<_>>().into();
    }
    Ok(json)
}

/// Maximum number of listed sources of an index.
const MAX_SOURCES: usize = 32;

/// Number of an index's sources, and names and lengths of some.
type Sources = (usize, Vec<(String, u64)>);

/// Returns the sources of an index; `None` for another tree.
fn indexed_sources(tree: &Dataset) -> Option<Result<Sources>> {
    let Some(TreeFile::Goblin(file)) = tree.as_file() else { return None };
    let (cells, bytes) = file.references()?;
    let mut some = Vec::new();
    let visited = cells.visit_sources(bytes, &mut |name, stat| {
        some.push((name.to_string(), stat.length));
        Ok(some.len() < MAX_SOURCES)
    });
    Some(visited.map(|()| (cells.sources(), some)).map_err(Into::into))
}

/// Whether a tree comes from a manifest.
fn is_listed(tree: &Dataset) -> bool {
    matches!(tree.as_file(), Some(TreeFile::Mosaic(_)))
}

/// Returns the files that a manifest lists.
fn listed_as_json(tree: &Dataset) -> Option<Vec<serde_json::Value>> {
    let Some(TreeFile::Mosaic(tree)) = tree.as_file() else { return None };
    let json = |entry: &ListedFile| json!({ "path": entry.path, "layer": entry.layer, "from": entry.bounds.min, "size": entry.bounds.size(), "bytes": entry.tag.length });
    Some(tree.entries().iter().map(json).collect())
}

fn crs_as_json(crs: &Crs) -> serde_json::Value {
    let text = crs.to_text();
    json!({
        "form": crs.form(),
        "name": crs.name(),
        "definition": crs.definition(),
        // The definition for other programs, or the reason why there is none.
        "text": text.as_ref().ok().cloned().or_else(|| crs.foreign_text()),
        "problem": text.err().map(|error| error.to_string()),
    })
}

fn as_text(tree: &Dataset, (levels, segments): (Levels<'_>, Segments<'_>)) -> Result<String> {
    let mut text = String::new();
    write_raster(&mut text, tree)?;
    write_storage(&mut text, tree)?;
    write_segments(&mut text, tree, segments)?;
    write_values(&mut text, tree)?;
    if !is_listed(tree) {
        write_levels(&mut text, levels)?;
    }
    for line in tree.metadata().clean_provenance() {
        writeln!(text, "from        {line}")?;
    }
    for (name, value) in &tree.metadata().tags {
        writeln!(text, "tag         {name} = {}", shortened(value, 12))?;
    }
    for (scope, tags) in &tree.metadata().scoped_tags {
        let channel = scope.channel.map(|channel| format!("channel {}", u32::from(channel) + 1));
        let domain = Some(scope.domain.clone()).filter(|domain| !domain.is_empty());
        let scope = [channel, domain].into_iter().flatten().collect::<Vec<_>>().join(", ");
        for (name, value) in tags {
            writeln!(text, "tag         {scope}: {name} = {}", shortened(value, 12))?;
        }
    }
    Ok(text)
}

fn scoped_tags_as_json(metadata: &Metadata) -> Vec<serde_json::Value> {
    let json = |(scope, tags): (&TagScope, _)| json!({ "channel": scope.channel.map(|channel| u32::from(channel) + 1), "domain": scope.domain, "tags": tags });
    metadata.scoped_tags.iter().map(json).collect()
}

fn control_points_as_json(metadata: &Metadata) -> Option<serde_json::Value> {
    let points = metadata.control_points.as_ref()?;
    let list: Vec<_> =
        points.points.iter().map(|point| json!({ "cell": point.cell, "world": point.world })).collect();
    Some(json!({ "crs": points.crs.as_ref().map(crs_as_json), "points": list }))
}

/// Writes the tree's type, size, and georeferencing.
fn write_raster(text: &mut String, tree: &Dataset) -> Result<()> {
    let (header, metadata) = (tree.header(), tree.metadata());
    writeln!(text, "{}: {} {}", shown(tree.name()), tree.format().name(), tree_name(tree))?;
    if let Some(commit) = tree.commit() {
        writeln!(text, "commit      {}{}", commit.number, commit::about(commit))?;
    }
    if let Some(TreeFile::Mosaic(tree)) = tree.as_file() {
        writeln!(text, "files       {}", tree.entries().len())?;
    }
    if !metadata.name.is_empty() {
        writeln!(text, "layer       {}", metadata.name)?;
    }
    if let Some(time) = &metadata.time {
        writeln!(text, "time        {time}")?;
    }
    let size: Vec<String> = header.extent[..header.form.axes()].iter().map(u64::to_string).collect();
    let (size, depth) = (size.join(" x "), header.depth());
    writeln!(text, "size        {size} cells of {}, depth {depth}", header.form.value)?;
    writeln!(text, "values      {}, averaged by {}", header.kind, header.rule)?;
    write_georeferencing(text, tree)?;
    if let Some(crs) = &metadata.frame.crs {
        writeln!(text, "crs         {crs}")?;
        if crs.numbers().is_none() {
            let definition: Vec<_> = crs.definition().split_whitespace().map(String::from).collect();
            let definition = definition.join(" ");
            let shown = shortened(&definition, 12);
            let more = if shown == definition { "" } else { " (--json shows all)" };
            writeln!(text, "            {shown}{more}")?;
        }
    }
    if let Some(points) = &metadata.control_points {
        let system = points.crs.as_ref().map_or(String::new(), |crs| format!(" in {crs}"));
        writeln!(text, "points      {} ground control points{system}", points.points.len())?;
    }
    if let Some(nodata) = metadata.nodata {
        writeln!(text, "nodata      {nodata}")?;
    }
    Ok(())
}

/// Writes the georeferencing of the cells.
fn write_georeferencing(text: &mut String, tree: &Dataset) -> Result<()> {
    let (frame, axes) = (&tree.metadata().frame, tree.header().form.axes());
    let list = |numbers: &[f64], between: &str| -> String {
        numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(between)
    };
    if axes == 2 {
        writeln!(text, "transform   {}", list(&frame.affine(), ", "))?;
    } else {
        for (heading, row) in ["transform", "", ""].into_iter().zip(&frame.matrix) {
            writeln!(text, "{heading:<11} {}", list(row, ", "))?;
        }
        writeln!(text, "origin      {}", list(&frame.to_world([0.0; 3]), ", "))?;
    }
    let [low, high] = frame.world_box(&tree.header().extent_bounds());
    writeln!(text, "cell        {}{}", list(&cell_size(frame)[..axes], " x "), suffix(tree, ""))?;
    writeln!(text, "world       {} to {}", list(&low[..axes], ","), list(&high[..axes], ","))?;
    Ok(())
}

/// Writes bytes and records. (A dense block usually needs fewer record slots than it has records;
/// records that are stored twice need more.)
fn write_storage(text: &mut String, tree: &Dataset) -> Result<()> {
    let (bytes, raw) = (tree.file_size(), raw_bytes(tree));
    let ratio = raw as f64 / bytes.max(1) as f64;
    writeln!(text, "bytes       {bytes}; plain samples would be {raw}, {ratio:.1} times as many")?;
    if is_listed(tree) {
        // (Records are in the listed files.)
        return Ok(());
    }
    let sections: Vec<String> =
        tree.sections().iter().map(|(name, bytes)| format!("{name} {bytes}")).collect();
    writeln!(text, "            {}", sections.join(", "))?;
    match tree.commit() {
        Some(commit) => {
            writeln!(text, "records     {}; {}", tree.stored_records(), commit::written(commit))?;
        }
        None => {
            let (slots, segments) = (tree.stored_records(), tree.segments());
            let records = tree.metadata().counts.records();
            let segments = counted(segments as u64, "segment");
            writeln!(text, "records     {records} inner nodes, in {slots} record slots of {segments}")?;
        }
    }
    Ok(())
}

/// Writes the codec of segments, and the bytes of each level's segments.
fn write_segments(text: &mut String, tree: &Dataset, segments: Segments<'_>) -> Result<()> {
    let Some(levels) = segments else { return Ok(()) };
    let is_packed = tree.header().codec != Codec::Plain;
    writeln!(text, "codec       {}", tree.header().codec.name())?;
    let headings = std::iter::once("segments").chain(std::iter::repeat(""));
    for (heading, LevelBytes { level, segments, bytes, plain, references, .. }) in headings.zip(levels) {
        if *references > 0 {
            writeln!(text, "{heading:<11} level {level}: {references} references to cells, {bytes} bytes")?;
            continue;
        }
        let unpacked = if is_packed { format!(", {plain} unpacked") } else { String::new() };
        writeln!(text, "{heading:<11} level {level}: {segments}, {bytes} bytes{unpacked}")?;
    }
    if let Some(sources) = indexed_sources(tree) {
        let (number, some) = sources?;
        let total: u64 = some.iter().map(|(_, bytes)| *bytes).sum();
        let in_all = if some.len() == number { format!(", {total} bytes") } else { String::new() };
        writeln!(text, "sources     {}{in_all}", counted(number as u64, "file"))?;
        some.iter().try_for_each(|(name, bytes)| writeln!(text, "            {name}, {bytes} bytes"))?;
    }
    Ok(())
}

/// Writes the cell count, and the classes, or else the statistics of each channel.
fn write_values(text: &mut String, tree: &Dataset) -> Result<()> {
    /// Maximum number of listed classes.
    const MAX_CLASSES: usize = 32;
    let stats = tree.statistics(None, &())?;
    writeln!(text, "cells       {}, and {} VOID", stats.cells, stats.void_cells)?;
    if stats.classes.is_empty() {
        for (number, channel) in (1..).zip(&stats.channels) {
            let ChannelStatistics { min, max, mean, standard_deviation, .. } = channel;
            writeln!(
                text,
                "channel {number}   min {min}, max {max}, mean {mean:.6}, standard deviation {standard_deviation:.6}"
            )?;
        }
        return Ok(());
    }
    writeln!(text, "classes     {}", stats.classes.len())?;
    let metadata = tree.metadata();
    for (value, cells) in stats.classes.iter().take(MAX_CLASSES) {
        let colour = metadata
            .palette
            .as_ref()
            .and_then(|palette| palette.colours.get(usize::try_from(value.to_integer()?).ok()?));
        let colour = colour.map(|[r, g, b, _]| format!("  #{r:02x}{g:02x}{b:02x}")).unwrap_or_default();
        let name = metadata.class_names.get(value).map(String::as_str).unwrap_or_default();
        writeln!(text, "{value:>8} {cells:>14} cells{colour}  {name}")?;
    }
    if stats.classes.len() > MAX_CLASSES {
        writeln!(text, "         and {} more", stats.classes.len() - MAX_CLASSES)?;
    }
    Ok(())
}

/// Writes the node count of each state, level by level.
fn write_levels(text: &mut String, levels: Levels<'_>) -> Result<()> {
    let Some(levels) = levels else {
        writeln!(text, "levels      not counted: more than {COUNTED} records; --levels counts them")?;
        return Ok(());
    };
    writeln!(text, "level           VOID           LEAF          INNER")?;
    for (level, [void, leaf, inner]) in levels.iter().enumerate() {
        writeln!(text, "{level:>5} {void:>14} {leaf:>14} {inner:>14}")?;
    }
    Ok(())
}
