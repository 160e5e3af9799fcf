//! `spinney export`: trees as files of other programs. Each kind of them has a module with its own options; the
//! output's name chooses between them.

mod mesh;

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, Result};
use spinney::export::mesh::MeshFormat;

use super::Global;
use super::args::ViewedTree;

/// Write a tree as a file of other programs: a mesh
///
/// The output's name says what is written, or else --format.
///
/// A mesh of an octree is closed, its faces are counterclockwise seen from outside, and its coordinates are those of
/// the world. By default it has the outer faces of the cells, merged to rectangles; where rectangles of different
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
    /// Format where the output's name does not say: ply, obj, stl, off or city.json
    #[arg(long)]
    format: Option<Target>,
    #[command(flatten)]
    mesh: mesh::Options,
}

const EXAMPLES: &str = "Examples:
  spinney export bunny.goblin bunny.ply
  spinney export bunny.goblin small.obj --level 6
  spinney export bunny.goblin print.stl --smooth
  spinney export city.goblin quarter.ply --view window=0,256,0,512,512,64
  spinney export bunny.goblin - --format stl > bunny.stl";

/// Kinds of files that are exported: a new one is a module, a line here, one in [`Target::of`] and [`FromStr`], and one in
/// [`run`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    Mesh(MeshFormat),
}

impl Target {
    /// The kind of a file by its name.
    fn of(path: &Path) -> Option<Target> {
        path.extension()?.to_str()?.parse().ok()
    }
}

impl FromStr for Target {
    type Err = spinney::Error;

    fn from_str(name: &str) -> spinney::Result<Target> {
        name.parse().map(Target::Mesh)
    }
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let target = args.format.or_else(|| Target::of(&args.output));
    let target = target.with_context(|| {
        format!("{}: unknown format; use .ply, .obj, .stl or .off, or --format", args.output.display())
    })?;
    match target {
        Target::Mesh(format) => mesh::run(args, format, global),
    }
}
