//! Octrees for viewers: 3D Tiles and binary glTF.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::Dataset;
use spinney::export::{GltfOptions, MeshRequest, export_glb, export_tileset};
use spinney::raw::io::OutputDirectory;

use super::super::args::check_output;
use super::super::report::quantity::counted;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;
use super::mesh::check_octree;

/// Options of glTF.
#[derive(clap::Args)]
pub(super) struct GltfArgs {
    /// Compress vertices and triangles (EXT_meshopt_compression): smaller, for readers that support
    /// it
    #[arg(long)]
    meshopt: bool,
}

impl GltfArgs {
    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        self.meshopt.then_some("--meshopt")
    }

    fn options(&self) -> GltfOptions {
        let mut options = GltfOptions::new();
        options.meshopt = self.meshopt;
        options
    }
}

/// Opens the tree. Returns it with the request and the progress display.
fn start(args: &Args, what: &str, global: &Global) -> Result<(Dataset, MeshRequest, Work)> {
    if exact::open(&args.tree.file, global)?.is_some() {
        exact::refuse(&args.tree.file, &[(what, true)])?;
    }
    ensure!(!args.mesh.triangles, "--triangles: has no effect on {what}, which always has triangles");
    let tree = args.tree.open(global)?;
    check_octree(&tree, &args.tree.file)?;
    check_output([args.tree.file.as_path()], args.output.path())?;
    let mut request = MeshRequest::new();
    (request.level, request.smooth) = (args.mesh.level, args.mesh.smooth);
    Ok((tree, request, Work::start(global, "tiles")?))
}

/// Writes a tileset of 3D Tiles (`x/tileset.json`).
pub(super) fn write_tileset(args: &Args, global: &Global) -> Result<()> {
    let begin = Instant::now();
    let (tree, request, work) = start(args, "3D Tiles", global)?;
    let directory = args.output.path().parent().filter(|directory| *directory != Path::new(""));
    let name = args.output.path().display();
    let directory = directory
        .with_context(|| format!("{name}: expected a directory in the name, as in x/tileset.json"))?;
    let directory = OutputDirectory::create(directory)?;
    let summary = export_tileset(&tree, &request, &args.gltf.options(), directory, &work)
        .with_context(|| format!("{name}: cannot write"))?;
    work.finish();
    let (tiles, levels, triangles) = (summary.tiles, summary.levels, summary.triangles);
    let levels = counted(u64::from(levels), "level");
    global.report("tiles", format_args!("{tiles} in {levels}, {triangles} triangles"));
    match (summary.deviation, &tree.metadata().frame.crs) {
        (Some(deviation), _) => {
            global.report("position", format_args!("on the globe, within {deviation:.3} m"));
        }
        (None, Some(crs)) => {
            global.report(
                "position",
                format_args!("in coordinates of {crs}, which has no position on the globe"),
            );
        }
        (None, None) => {}
    }
    report_output(global, args.output.path(), begin);
    Ok(())
}

/// Writes one level as binary glTF.
pub(super) fn write_glb(args: &Args, global: &Global) -> Result<()> {
    let begin = Instant::now();
    let (tree, request, work) = start(args, ".glb", global)?;
    let output = global.access().create(args.output.path())?;
    let triangles = export_glb(&tree, &request, &args.gltf.options(), output, &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    global.report("mesh", format_args!("{triangles} triangles"));
    report_output(global, args.output.path(), begin);
    Ok(())
}
