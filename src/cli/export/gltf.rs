//! Octrees for viewers: 3D Tiles and binary glTF.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::Dataset;
use spinney::brep::Faces as _;
use spinney::export::{GltfOptions, MeshRequest, export_glb, export_model_tileset, export_tileset};
use spinney::raw::io::OutputDirectory;

use super::super::args::{DEFAULT_MEMORY, check_output};
use super::super::report::quantity::counted;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;
use super::mesh::{self, check_octree};

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
    mesh::check_cells(args)?;
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
    let name = args.output.path().display();
    let directory = || {
        let directory = args.output.path().parent().filter(|directory| *directory != Path::new(""));
        let expected = || format!("{name}: expected a directory in the name, as in x/tileset.json");
        anyhow::Ok(OutputDirectory::create(directory.with_context(expected)?)?)
    };
    if let Some(view) = args.tree.open_model(global)? {
        global.check_options(&args.tree.file, exact::KIND, &["--output", "--format", "--meshopt"])?;
        check_output([args.tree.file.as_path()], args.output.path())?;
        let model = view.as_model("faces")?;
        let work = Work::start(global, "faces")?;
        let (options, memory) = (args.gltf.options(), DEFAULT_MEMORY);
        let summary = export_model_tileset(model, &options, directory()?, memory, &work)
            .with_context(|| format!("{name}: cannot write"))?;
        work.finish();
        let levels = counted(u64::from(summary.levels), "level");
        global
            .report("tiles", format_args!("{} in {levels}, {} triangles", summary.tiles, summary.triangles));
        match (summary.is_on_globe, model.crs()) {
            (true, _) => global.report("position", format_args!("on the globe, vertex by vertex")),
            (false, Some(crs)) => global.report("position", format_args!("in coordinates of {crs}")),
            (false, None) => {}
        }
        report_output(global, args.output.path(), begin);
        return Ok(());
    }
    let (tree, request, work) = start(args, "3D Tiles", global)?;
    let directory = directory()?;
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
    if let Some(view) = args.tree.open_model(global)? {
        let fitting = [
            "--output",
            "--format",
            "--meshopt",
            "--where",
            "--level",
            "--error",
            "--faces",
            "--view",
            "--window",
            "--in",
        ];
        global.check_options(&args.tree.file, exact::KIND, &fitting)?;
        let contents = exact::MeshContents {
            triangles: false,
            filter: args.mesh.filter.as_ref(),
            detail: args.mesh.detail(),
            within: exact::window(&args.part)?,
        };
        let format = exact::MeshOutput::Glb(args.gltf.options());
        return exact::export(view.as_model("faces")?, args.output.path(), format, contents, global);
    }
    let (tree, request, work) = start(args, ".glb", global)?;
    let output = global.access().create(args.output.path())?;
    let triangles = export_glb(&tree, &request, &args.gltf.options(), output, &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    global.report("mesh", format_args!("{triangles} triangles"));
    report_output(global, args.output.path(), begin);
    Ok(())
}
