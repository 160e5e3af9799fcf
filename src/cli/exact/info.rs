//! `spinney info` of an exact model.

use std::fmt::Write as _;

use anyhow::Result;
use serde_json::json;
use spinney::ExactModel;
use spinney::brep::{DetailLevel, Faces};
use spinney::raw::io::shown;
use spinney::raw::store::Tag;

use super::super::report::{print_json, print_text, quantity, shortened};
use super::{list, space, unit};

/// Prints what an exact model contains.
pub(crate) fn info(model: &ExactModel, is_json: bool) -> Result<()> {
    if is_json { print_json(&as_json(model)?) } else { print_text(&as_text(model)?) }
}

fn as_json(model: &ExactModel) -> Result<serde_json::Value> {
    let exact_faces = model.exact_faces().0;
    let grid = model.grid();
    let nodes: serde_json::Map<_, _> =
        model.nodes().named().into_iter().map(|(name, count)| (name.to_lowercase(), json!(count))).collect();
    let sections: serde_json::Map<_, _> =
        model.sections().into_iter().map(|(name, bytes)| (name.to_string(), json!(bytes))).collect();
    let metadata = model.metadata();
    Ok(json!({
        "file": shown(model.path()),
        "format": "Goblin",
        "tree": "exact model",
        "faces": model.len(),
        "unbounded": model.is_unbounded(),
        "exact_faces": exact_faces,
        "codec": model.codec().name(),
        "depth": model.depth(),
        "grid": { "bits": grid.bits, "origin": grid.origin, "step": grid.width() },
        "space": space(model),
        "unit": metadata.tag(Tag::Unit),
        "nodes": nodes,
        "segments": model.segments(),
        "parts": model.parts(),
        "attributes": attributes(model)?,
        "face_columns": model.value_columns()?,
        "formula": model.formula()?,
        "epsg": metadata.frame.crs.as_ref().and_then(|crs| crs.numbers()).map(|numbers| numbers.horizontal),
        "provenance": metadata.clean_provenance(),
        "tags": metadata.tags,
        "levels": model.levels().iter().map(|level| level_json(level, model)).collect::<Vec<_>>(),
        "bytes": model.file_size(),
        "sections": sections,
    }))
}

fn level_json(level: &DetailLevel, model: &ExactModel) -> serde_json::Value {
    let width = model.grid().width();
    json!({
        "faces": level.faces,
        "error": level.error * width,
        "bytes": level.bytes,
        "vanished_bodies": level.vanished,
        "vanished_diameter": level.vanished_diameter * width,
    })
}

/// Returns the attributes of each part and of the source files; null if there are none.
fn attributes(model: &ExactModel) -> Result<serde_json::Value> {
    let files = model.file_attributes()?;
    if model.parts_with_attributes()? == 0 && files.is_empty() {
        return Ok(serde_json::Value::Null);
    }
    // (A string that is not JSON is returned as a JSON string.)
    let value = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| json!(text));
    let mut parts = Vec::new();
    for (part, _) in (0..).zip(model.parts()) {
        parts.push(model.part_attributes(part)?.as_deref().map(value));
    }
    let files: Vec<_> = files.iter().map(|text| value(text)).collect();
    Ok(json!({ "parts": parts, "files": files }))
}

fn as_text(model: &ExactModel) -> Result<String> {
    let mut text = String::new();
    let grid = model.grid();
    let unit = unit(model);
    writeln!(text, "{}", shown(model.path()))?;
    writeln!(text, "  format      Goblin, exact model")?;
    let far = if model.is_unbounded() { ", unbounded: infinity is inside" } else { "" };
    writeln!(text, "  faces       {}{far}", model.len())?;
    let (exact, proxies) = model.exact_faces();
    if exact > 0 {
        writeln!(text, "  exact       {exact} faces with off-grid vertices, {proxies} proxies")?;
    }
    let units = format!("units of {}{unit}, {} bits", grid.width(), grid.bits);
    writeln!(text, "  grid        {units}, from {}", list(grid.to_world([0; 3])))?;
    writeln!(text, "  octree      depth {}, {} segments", model.depth(), model.segments())?;
    let nodes = model.nodes();
    let kinds: Vec<String> = nodes.named().iter().map(|(name, count)| format!("{count} {name}")).collect();
    writeln!(text, "  nodes       {}: {}", nodes.total(), kinds.join(", "))?;
    let width = grid.width();
    for (number, level) in model.levels().iter().enumerate() {
        let DetailLevel { faces, error, bytes, vanished, vanished_diameter, .. } = level;
        let label = if number == 0 { "levels" } else { "" };
        if number + 1 == model.levels().len() {
            writeln!(text, "  {label:<12}{number}: the exact surface")?;
            break;
        }
        write!(text, "  {label:<12}{number}: {faces} faces, at most {:.3e}{unit} off", error * width)?;
        write!(text, ", {}", quantity::bytes(*bytes))?;
        match vanished {
            0 => writeln!(text)?,
            _ => writeln!(
                text,
                "; without {vanished} bodies of up to {:.3e}{unit}",
                vanished_diameter * width
            )?,
        }
    }
    let parts = model.parts();
    let names: Vec<&str> = parts.iter().take(8).map(String::as_str).collect();
    let more = if parts.len() > names.len() { ", ..." } else { "" };
    writeln!(text, "  parts       {}: {}{more}", parts.len(), names.join(", "))?;
    let described = model.parts_with_attributes()?;
    if described > 0 {
        writeln!(text, "  attributes  of {described} parts (printed with --json)")?;
    }
    let columns = model.value_columns()?;
    if !columns.is_empty() {
        let names: Vec<&str> = columns.iter().take(8).map(String::as_str).collect();
        let more = if columns.len() > names.len() { ", ..." } else { "" };
        writeln!(text, "  values      of faces: {}{more}", names.join(", "))?;
    }
    if let Some(formula) = model.formula()? {
        // (A formula of many operations is long.)
        writeln!(text, "  formula     {}", shortened(&formula, 14))?;
    }
    if let Some(crs) = &model.metadata().frame.crs {
        writeln!(text, "  crs         {crs}")?;
    }
    for line in model.metadata().clean_provenance() {
        writeln!(text, "  from        {line}")?;
    }
    for (key, value) in &model.metadata().tags {
        writeln!(text, "  tag         {key} = {}", shortened(value, 14))?;
    }
    writeln!(text, "  codec       {}", model.codec().name())?;
    writeln!(text, "  bytes       {}", model.file_size())?;
    for (name, bytes) in model.sections() {
        writeln!(text, "    {name:<20} {bytes}")?;
    }
    Ok(text)
}
