//! `spinney get` of a tree of lines.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use spinney::io::Output;
use spinney::lines::{LineTree, export_lines};

use super::super::Global;
use super::super::args::{PartOptions, check_output, vector_format};
use super::super::report::{Work, report_output};

/// Writes whole features: all, or those of which a line passes through a window.
pub(crate) fn get(
    tree: &LineTree,
    part: &PartOptions,
    (path, format): (&Path, Option<&str>),
    attributes: Option<&str>,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let format = vector_format(format, path)?;
    check_output([tree.path()], path)?;
    let window = super::window(part)?;
    let names = super::names(attributes);
    let work = Work::start(global, "features")?;
    let written = export_lines(tree, window, names.as_deref(), (Output::create(path)?, format), &work)?;
    work.finish();
    global.report("features", format_args!("{written} of {}", tree.len()));
    report_output(global, path, start);
    Ok(())
}
