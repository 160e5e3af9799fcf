//! Rasters as triangulated surfaces.

use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::export::MeshFormat;
use spinney::raw::export::mesh::{SurfaceMesh, export_triangles};
use spinney::raw::tin::{approximate, read_heights};

use super::super::args::{check_output, level_of};
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;

/// Options of surfaces.
#[derive(clap::Args)]
pub(super) struct TinOptions {
    /// Triangulated surface (TIN) of a raster, with at most this height error at each cell's centre
    #[arg(long, value_name = "ERROR")]
    pub(super) tin: Option<f64>,
}

/// Writes the surface.
pub(super) fn run(args: &Args, most: f64, format: MeshFormat, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file, global)?.is_some() {
        exact::refuse(&args.tree.file, &[("--tin", true)])?;
    }
    if let Some(option) = args.mesh.given().filter(|option| *option != "--level") {
        bail!("{option}: has no effect on --tin");
    }
    let tree = args.tree.open(global)?;
    check_output([args.tree.file.as_path()], args.output.path())?;
    let level = level_of(&tree, args.mesh.level)?;
    global.report_approximate(&tree, level);
    let work = Work::start(global, "cells")?;
    let tin = approximate(&read_heights(&tree, level)?, most, &work)?;
    let mesh = SurfaceMesh { vertices: tin.vertices().collect(), triangles: tin.triangles().to_vec() };
    let summary = global
        .access()
        .create(args.output.path())
        .and_then(|output| export_triangles(&[(String::new(), mesh)], tree.metadata(), output, format, &work))
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    global.report("surface", format_args!("{} triangles, {} vertices", summary.faces, summary.vertices));
    report_output(global, args.output.path(), start);
    Ok(())
}
