//! The surface of a solid as a mesh.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use spinney::Dataset;
use spinney::brep::SurfaceDetail;
use spinney::export::{MeshFormat, MeshRequest, export_mesh};
use spinney::import::feature::FeatureFilter;

use super::super::args::check_output;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;

/// Options of meshes.
#[derive(clap::Args)]
pub(super) struct MeshOptions {
    /// Level of detail: the file's depth (the default) is the original cells. A coarser cell is
    /// solid if it is at least half full (rule occupancy), or if any cell below it is not VOID
    /// (other rules). Of exact models, 0 is the coarsest, and the last one (the default) the exact
    /// surface
    #[arg(long)]
    pub(super) level: Option<u8>,
    /// Maximum distance from the surface, of exact models with levels of detail: as few faces as
    /// possible
    #[arg(long, value_name = "DISTANCE", conflicts_with_all = ["level", "faces"])]
    pub(super) error: Option<f64>,
    /// Maximum number of faces, of exact models with levels of detail: those with the smallest
    /// error
    #[arg(long, value_name = "N", conflicts_with = "level")]
    pub(super) faces: Option<u64>,
    /// Smooth surface: where cells are half full (surface nets; every edge has two faces), instead
    /// of the cells' faces
    #[arg(long)]
    pub(super) smooth: bool,
    /// Triangles only, in OBJ and OFF too, and in PLY of cells; also of exact models
    #[arg(long)]
    pub(super) triangles: bool,
    /// Only features for which all conditions hold, as in 'type=Building,height>=10': an
    /// attribute, one of =, !=, <, <=, > and >=, and a value; of exact models objects, with their
    /// parts, where id and type count as attributes
    #[arg(long = "where", value_name = "CONDITION,...")]
    pub(super) filter: Option<FeatureFilter>,
}

impl MeshOptions {
    /// Returns how much detail of an exact model is written.
    pub(super) fn detail(&self) -> SurfaceDetail {
        let level = self.level.map(SurfaceDetail::Level);
        let other = || self.error.map(SurfaceDetail::Error).or(self.faces.map(SurfaceDetail::Faces));
        level.or_else(other).unwrap_or_default()
    }

    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--level", self.level.is_some()),
            ("--error", self.error.is_some()),
            ("--faces", self.faces.is_some()),
            ("--smooth", self.smooth),
            ("--triangles", self.triangles),
            ("--where", self.filter.is_some()),
        ];
        given.iter().find(|(_, is_given)| *is_given).map(|(name, _)| *name)
    }
}

/// Fails for options that need an exact model.
pub(super) fn check_cells(args: &Args) -> Result<()> {
    let given = [("--error", args.mesh.error.is_some()), ("--faces", args.mesh.faces.is_some())];
    if let Some((name, _)) = given.iter().find(|(_, is_given)| *is_given) {
        bail!("{name}: works only with exact models, which have levels of detail");
    }
    ensure!(args.mesh.filter.is_none(), "--where: works only with exact models, which have objects");
    let name = args.output.path().display();
    ensure!(
        !args.part.is_given(),
        "{name}: --window works only with tiles of web maps and meshes of exact models; otherwise, add --view window=..."
    );
    Ok(())
}

/// Fails for a raster, whose surface is a TIN.
pub(super) fn check_octree(tree: &Dataset, file: &Path) -> Result<()> {
    ensure!(
        tree.header().form.axes() == 3,
        "{}: is a quadtree, expected an octree of a solid; for the surface of a raster (.ply, .obj, .off), add --tin ERROR",
        file.display()
    );
    Ok(())
}

/// Writes a mesh of an octree or of an exact model.
pub(super) fn run(args: &Args, format: MeshFormat, global: &Global) -> Result<()> {
    let start = Instant::now();
    let MeshOptions { level, smooth, triangles, ref filter, .. } = args.mesh;
    if let Some(view) = args.tree.open_model(global)? {
        let fitting = [
            "--output",
            "--format",
            "--triangles",
            "--where",
            "--view",
            "--level",
            "--error",
            "--faces",
            "--window",
            "--in",
        ];
        global.check_options(&args.tree.file, exact::KIND, &fitting)?;
        ensure!(
            !triangles || !matches!(format, MeshFormat::Ply | MeshFormat::Stl),
            "--triangles: has no effect on PLY and STL of exact models, which always have triangles"
        );
        let detail = args.mesh.detail();
        let within = exact::window(&args.part)?;
        let contents = exact::MeshContents { triangles, filter: filter.as_ref(), detail, within };
        let format = exact::MeshOutput::Mesh(format);
        return exact::export(view.as_model("faces")?, args.output.path(), format, contents, global);
    }
    check_cells(args)?;
    let tree = args.tree.open(global)?;
    check_octree(&tree, &args.tree.file)?;
    check_output([args.tree.file.as_path()], args.output.path())?;
    let mut request = MeshRequest::new();
    (request.level, request.smooth, request.triangles) = (level, smooth, triangles);
    let work = Work::start(global, "cells")?;
    let output = global.access().create(args.output.path())?;
    let summary = export_mesh(&tree, &request, output, format, &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    global.report("mesh", format_args!("{} faces, {} vertices", summary.faces, summary.vertices));
    report_output(global, args.output.path(), start);
    Ok(())
}
