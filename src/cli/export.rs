//! `spinney export`: the surface of a solid as a mesh.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::export::mesh::{MeshFormat, MeshRequest, export_mesh};
use spinney::io::Output;

use super::args::{ViewedTree, check_output};
use super::report::{Work, report_output};
use super::{Global, exact};

/// Write the surface of an octree as a mesh
///
/// The mesh is closed, its faces are counterclockwise seen from outside, and its coordinates are those of the
/// world. By default it has the outer faces of the cells, merged to rectangles; where rectangles of different
/// sizes meet, a face has the corners of its neighbours as points of its own. Memory does not grow with the
/// mesh.
///
/// Of an exact model the faces are written as they are, polygons with holes too, and as CityJSON (.city.json) as well.
///
/// PLY is binary and has colours and classes as properties of faces; OBJ is text; OFF is text and has colours of
/// faces; STL is binary, in single precision.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Output: .ply, .obj, .stl or .off, of exact models .city.json, too; `-` is standard output
    output: PathBuf,
    /// Level of detail: the file's depth (the default) is the cells as they are. A coarser cell is solid if
    /// it is at least half full (rule occupancy), or if anything is in it (other rules)
    #[arg(long)]
    level: Option<u8>,
    /// The smooth surface where cells are half full (surface nets), instead of the cells' faces
    #[arg(long)]
    smooth: bool,
    /// Triangles only, in PLY, OBJ and OFF too
    #[arg(long)]
    triangles: bool,
    /// Format where the output's name does not say: ply, obj, stl or off
    #[arg(long)]
    format: Option<MeshFormat>,
}

const EXAMPLES: &str = "Examples:
  spinney export bunny.goblin bunny.ply
  spinney export bunny.goblin small.obj --level 6
  spinney export bunny.goblin print.stl --smooth
  spinney export city.goblin quarter.ply --view window=0,256,0,512,512,64
  spinney export bunny.goblin - --format stl > bunny.stl";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Some(format) = args.format.or_else(|| MeshFormat::of(&args.output)) else {
        bail!("{}: unknown format; use .ply, .obj, .stl or .off, or --format", args.output.display());
    };
    if let Some(model) = exact::open(&args.tree.file)? {
        let given = [
            ("--view", args.tree.is_viewed()),
            ("--level", args.level.is_some()),
            ("--smooth", args.smooth),
            ("--triangles", args.triangles),
        ];
        exact::refuse(&args.tree.file, &given)?;
        return exact::export(&model, &args.output, format, global);
    }
    let tree = args.tree.open()?;
    check_output([args.tree.file.as_path()], &args.output)?;
    let mut request = MeshRequest::new();
    request.level = args.level;
    request.smooth = args.smooth;
    request.triangles = args.triangles;
    let work = Work::start(global, "cells")?;
    let output = Output::create(&args.output)?;
    let summary = export_mesh(&tree, &request, output, format, &work)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    work.finish();
    global.report("mesh", format_args!("{} faces, {} vertices", summary.faces, summary.vertices));
    report_output(global, &args.output, start);
    Ok(())
}
