//! Octrees as models for viewers.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::export::mesh::{MeshRequest, export_glb, export_tileset};
use spinney::io::{Output, OutputFolder};

use super::super::args::check_output;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;

/// Writes a tileset of 3D Tiles (`x/tileset.json`), or one level as binary glTF.
pub(super) fn run(args: &Args, is_tileset: bool, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file)?.is_some() {
        exact::refuse(&args.tree.file, &[(if is_tileset { "3D Tiles" } else { ".glb" }, true)])?;
    }
    let tree = args.tree.open()?;
    check_output([args.tree.file.as_path()], &args.output)?;
    let mut request = MeshRequest::new();
    (request.level, request.smooth) = (args.mesh.level, args.mesh.smooth);
    let work = Work::start(global, "tiles")?;
    let failed = || format!("cannot write {}", args.output.display());
    let summary = if is_tileset {
        let folder = args.output.parent().filter(|folder| *folder != Path::new(""));
        ensure!(folder.is_some(), "{}: name the folder, too, as in x/tileset.json", args.output.display());
        let folder = OutputFolder::create(folder.unwrap_or(Path::new(".")))?;
        export_tileset(&tree, &request, folder, &work).with_context(failed)?
    } else {
        export_glb(&tree, &request, Output::create(&args.output)?, &work).with_context(failed)?
    };
    work.finish();
    let levels = if is_tileset { format!(" in {} levels", summary.levels) } else { String::new() };
    global.report("tiles", format_args!("{}{levels}, {} triangles", summary.tiles, summary.triangles));
    report_output(global, &args.output, start);
    Ok(())
}
