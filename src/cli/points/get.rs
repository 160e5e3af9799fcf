//! `spinney get` of a tree of points.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::points::{PointTree, Selection};
use spinney::raw::points::{PointFormat, attribute_index, export_points};

use super::super::Global;
use super::super::args::check_output;
use super::super::report::{Work, report_output, warn};

/// Writes the points of a selection, with the named attributes, or all.
pub(crate) fn get(
    tree: &PointTree,
    selection: &Selection,
    (path, format): (&Path, Option<&str>),
    attributes: Option<&str>,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let name = format.map(|format| Path::new("x").with_extension(format));
    let format = PointFormat::of(name.as_deref().unwrap_or(path)).with_context(|| {
        format!(
            "{}: unknown format for points; use .las, .laz, .csv, .ply or .npy, or --format",
            path.display()
        )
    })?;
    check_output([tree.path()], path)?;
    let chosen = attributes.map(|names| {
        names
            .split(',')
            .map(|name| attribute_index(tree.attributes(), name.trim()))
            .collect::<spinney::Result<Vec<_>>>()
    });
    let chosen = chosen.transpose()?;
    let work = Work::start(global, "blocks")?;
    let written =
        export_points(tree, selection, chosen.as_deref(), global.access().create(path)?, format, &work)?;
    work.finish();
    global.report("points", format_args!("{written} of {}", tree.len()));
    report_output(global, path, start);
    if written == 0 && !tree.is_empty() {
        warn(&format!(
            "{}: has no points: none is in the region and satisfies all conditions",
            path.display()
        ));
    }
    Ok(())
}
