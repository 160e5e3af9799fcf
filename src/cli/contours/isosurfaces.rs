//! `spinney contours` of an octree: surfaces of equal values.

use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::Dataset;
use spinney::export::MeshFormat;
use spinney::query::ContourRequest;
use spinney::raw::export::mesh::export_isosurfaces;

use super::args::Args;
use crate::cli::Global;
use crate::cli::report::{Work, report_output, warn};

pub(super) fn run(
    args: &Args,
    tree: &Dataset,
    request: &ContourRequest,
    global: &Global,
    start: Instant,
) -> Result<()> {
    let given = [("--filled", args.filled), ("--smooth", args.smooth > 0), ("--3d", args.has_z)];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        let file = args.tree.file.display();
        bail!("{option}: works only with contours of rasters; {file} is an octree, which has isosurfaces");
    }
    let format = mesh_format(args)?;
    let work = Work::start(global, "cells")?;
    let summary = args
        .limit
        .create(&args.output, global)
        .and_then(|output| export_isosurfaces(tree, request, output, format, &work))
        .with_context(|| format!("{}: cannot write", args.output.display()))?;
    work.finish();
    global.report(
        "contours",
        format_args!(
            "{} triangles, {} vertices, {} of {} tiles read",
            summary.triangles, summary.vertices, summary.tiles_read, summary.tiles
        ),
    );
    report_output(global, &args.output, start);
    if summary.triangles == 0
        && let Some((min, max)) = tree.value_bounds()?.first()
    {
        let found = format!("has no triangles: values are {min} to {max}");
        let advice = "and surfaces end near VOID cells unless --ends is close";
        warn(&format!("{}: {found}, {advice}", args.output.display()));
    }
    Ok(())
}

/// Returns the format by `--format`, or else by the output's name.
fn mesh_format(args: &Args) -> Result<MeshFormat> {
    let named = args.format.as_deref().map(|name| name.parse().ok());
    match named.unwrap_or_else(|| MeshFormat::of(&args.output)) {
        None | Some(MeshFormat::CityJson) => bail!(
            "{}: unknown format for isosurfaces; use .ply, .obj, .stl or .off, or --format",
            args.output.display()
        ),
        Some(format) => Ok(format),
    }
}
