//! `spinney contours`: contour lines of rasters, and the areas between them; isosurfaces of
//! octrees; isolines of triangulated surfaces.

mod args;
mod isosurfaces;
mod surface;

use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::export::export_contours;
use spinney::query::{ContourLevels, ContourRequest};
use spinney::raw::export::vector::ContourFeatures;
use spinney::raw::import::mesh::is_model;
use spinney::raw::query::ContourEnds;

pub(crate) use self::args::Args;
use self::args::Ends;
use super::args::{check_output, level_of, vector_format};
use super::report::{Work, report_output, warn};
use super::{Global, exact};

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let levels = match (args.values.every, &args.values.at) {
        (Some(step), _) => ContourLevels::Every { step, base: args.base },
        (None, levels) => ContourLevels::At(levels.clone().unwrap_or_default()),
    };
    if let Some(model) = exact::open(&args.tree.file, global)? {
        return surface::run(args, Some(&model), &levels, global, start);
    }
    if is_model(&args.tree.file, global.access())? {
        return surface::run(args, None, &levels, global, start);
    }
    if let Some(option) = ["--object", "--side"].into_iter().find(|option| global.given().has(option)) {
        bail!(
            "{option}: works only with exact models and mesh files, {} is neither",
            args.tree.file.display()
        );
    }
    let tree = args.tree.open(global)?;
    check_output([args.tree.file.as_path()], &args.output)?;
    let mut request = ContourRequest::new(levels);
    let level = level_of(&tree, args.level)?;
    global.report_approximate(&tree, level);
    request.level = Some(level);
    request.memory = args.memory.bytes;
    request.ends = match args.ends {
        Ends::Open => ContourEnds::Open,
        Ends::Extend => ContourEnds::Extend,
        Ends::Close => ContourEnds::Close,
    };
    if tree.header().form.axes() == 3 {
        return isosurfaces::run(args, &tree, &request, global, start);
    }
    let format = vector_format(args.format.as_deref(), &args.output)?;
    let mut features = ContourFeatures::new();
    (features.filled, features.smooth, features.has_z) = (args.filled, args.smooth, args.has_z);
    let work = Work::start(global, "cells")?;
    let summary = args
        .limit
        .create(&args.output, global)
        .and_then(|output| export_contours(&tree, &request, &features, output, format, &work))
        .with_context(|| format!("{}: cannot write", args.output.display()))?;
    work.finish();
    let what = if args.filled { "polygons" } else { "lines" };
    global.report(
        "contours",
        format_args!(
            "{} {what} of {} points, {} of {} tiles read",
            summary.count, summary.points, summary.tiles_read, summary.tiles
        ),
    );
    report_output(global, &args.output, start);
    if summary.count == 0
        && !args.tree.is_viewed()
        && let Some((min, max)) = tree.value_bounds()?.first()
    {
        warn(&format!("{}: has no {what}: values are {min} to {max}", args.output.display()));
    }
    Ok(())
}
