//! `spinney get` of a tree of lines.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::lines::LineTree;
use spinney::raw::lines::{export_lines, join_crossing_lines};

use super::super::Global;
use super::super::args::{PartOptions, check_output, vector_format};
use super::super::report::{Work, report_output, warn};

/// Writes whole features: all, those with a line that passes through a window, or those that lines
/// of a file cross, or have within a distance.
pub(crate) fn get(
    tree: &LineTree,
    (part, crossing, within): (&PartOptions, Option<&Path>, f64),
    (path, format): (&Path, Option<&str>),
    attributes: Option<&str>,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let format = vector_format(format, path)?;
    check_output([tree.path()].into_iter().chain(crossing), path)?;
    let window = super::window(tree, part)?;
    let names = super::names(attributes);
    let output = global.access().create(path)?;
    let numbers = match (window, crossing) {
        (Some(window), _) => {
            let work = Work::start(global, "blocks")?;
            Some(tree.window(window, &work)?)
        }
        (None, Some(lines)) => {
            let work = Work::start(global, "lines")?;
            let found = join_crossing_lines(tree, (lines, within), None, None, &work)
                .with_context(|| format!("{}: cannot find crossings", lines.display()))?;
            Some(found.features)
        }
        (None, None) => None,
    };
    let work = Work::start(global, "features")?;
    let written = export_lines(tree, numbers.as_deref(), names.as_deref(), output, format, &work)?;
    work.finish();
    global.report("features", format_args!("{written} of {}", tree.len()));
    report_output(global, path, start);
    if written == 0 && !tree.is_empty() {
        let found = if crossing.is_some() {
            "no line crosses those of the other file"
        } else {
            "no line is in the window"
        };
        warn(&format!("{}: has no features: {found}", path.display()));
    }
    Ok(())
}
