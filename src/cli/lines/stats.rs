//! `spinney stats` of a tree of lines.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use serde_json::json;
use spinney::lines::LineTree;
use spinney::raw::lines::{join_crossing_lines, join_nearest_lines};

use super::super::Global;
use super::super::args::{check_output, vector_format_of};
use super::super::report::{Work, print_json, print_text, report_output};
use super::{length_axes, lengths};

/// Prints the number of features and lines, and their length; with a window only of features that
/// pass through it.
pub(crate) fn stats(
    tree: &LineTree,
    window: Option<[[f64; 3]; 2]>,
    is_json: bool,
    global: &Global,
) -> Result<()> {
    let Some(window) = window else {
        let (features, segments, length) = (tree.len(), tree.segments(), tree.length()?);
        return match is_json {
            true => print_json(&json!({
                "features": features, "segments": segments, "length": length, "length_axes": length_axes(tree)
            })),
            false => print_text(&format!("features    {features}\nlines       {}\n", lengths(tree)?)),
        };
    };
    let work = Work::start(global, "blocks")?;
    let features = tree.window(window, &work)?.len();
    work.finish();
    match is_json {
        true => print_json(&json!({ "features": features })),
        false => print_text(&format!("features    {features}\n")),
    }
}

/// A join of other features to lines.
pub(crate) enum Join<'a> {
    /// Points of a file, within a distance.
    Nearest(&'a Path, f64),
    /// Lines of a file, within a distance.
    Crossing(&'a Path, f64),
}

/// Joins points with their nearest lines, or lines with the lines that they cross.
pub(crate) fn join(
    tree: &LineTree,
    request: Join<'_>,
    names: Option<&[String]>,
    output: Option<&Path>,
    (is_json, global): (bool, &Global),
) -> Result<()> {
    let start = Instant::now();
    let (Join::Nearest(input, _) | Join::Crossing(input, _)) = request;
    let target = match output {
        None => None,
        Some(path) => {
            check_output([tree.path(), input], path)?;
            let format = vector_format_of(path)?;
            Some((global.access().create(path)?, format))
        }
    };
    let failed = || format!("{}: cannot join", input.display());
    let (text, json) = match request {
        Join::Nearest(points, within) => {
            let work = Work::start(global, "points")?;
            let found =
                join_nearest_lines(tree, points, within, names, target, &work).with_context(failed)?;
            work.finish();
            let mean = if found.joined > 0 { found.sum / found.joined as f64 } else { 0.0 };
            let (points, joined, most) = (found.points, found.joined, found.most);
            (
                format!(
                    "points      {points}, {joined} of them joined to a line\ndistance    mean {mean}, at most {most}\n"
                ),
                json!({ "points": points, "joined": joined, "mean_distance": mean, "max_distance": most }),
            )
        }
        Join::Crossing(lines, within) => {
            let work = Work::start(global, "lines")?;
            let found =
                join_crossing_lines(tree, (lines, within), names, target, &work).with_context(failed)?;
            work.finish();
            let (lines, features, crossings) = (found.lines, found.features.len(), found.crossings);
            (
                format!("lines       {lines}\nfeatures    {features}\ncrossings   {crossings}\n"),
                json!({ "lines": lines, "features": features, "crossings": crossings }),
            )
        }
    };
    if is_json {
        print_json(&json)?
    } else {
        print_text(&text)?
    }
    if let Some(path) = output {
        report_output(global, path, start);
    }
    Ok(())
}
