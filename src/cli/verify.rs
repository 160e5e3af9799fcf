//! `spinney verify`: checks every checksum and every invariant of a file.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use spinney::lines::LineTree;
use spinney::points::PointTree;
use spinney::raw::brep::is_model_file;
use spinney::raw::export::tiles::{is_tile_archive, verify_tiles};
use spinney::raw::io::shown;
use spinney::raw::lines::is_line_file;
use spinney::raw::points::is_point_file;
use spinney::raw::store::Finding;
use spinney::{Error, ExactModel};

use super::Global;
use super::args::DEFAULT_MEMORY;
use super::report::{Work, complain, print_text};

const EXAMPLES: &str = "Examples:
  spinney verify world.goblin
  spinney verify world.pmtiles map/
  spinney verify --quiet *.goblin || echo corrupt

A line of the output has a file and `good`, or the location and kind of a problem. All files are
checked, also after one that cannot be read; the exit code is 1 if any is not good.";

/// Check all checksums and invariants of files
///
/// Exact models: the faces are planar and bound a body, and each node of the octree matches them.
///
/// Web tiles that `export` wrote (.pmtiles, .mbtiles, directories; not 3D Tiles): all exist, in
/// order, with the bytes that were written.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Tree files, archives and directories of web tiles
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Check the trees of the newest commits only, or of the named ones (FILE@N)
    #[arg(long)]
    quick: bool,
}

/// Returns all findings in a file.
fn verify(file: &Path, is_quick: bool, global: &Global, work: &Work) -> spinney::Result<Vec<Finding>> {
    let access = global.access();
    if is_tile_archive(file) {
        return verify_tiles(file, work);
    }
    if file.is_dir() {
        let found = "checking a directory without web tiles of `spinney export`";
        let advice =
            "give tree files, .pmtiles, .mbtiles or directories of web tiles; 3D Tiles are not checked";
        return Err(Error::unsupported(file, found, advice));
    }
    if is_model_file(file, access)? {
        return ExactModel::open(file, &access.into())?.verify(DEFAULT_MEMORY, work);
    }
    if is_line_file(file, access)? {
        return LineTree::open(file, &access.into())?.verify(DEFAULT_MEMORY, work);
    }
    if is_point_file(file, access)? {
        return PointTree::open(file, &access.into())?.verify(work);
    }
    let tree = spinney::raw::dataset::open(file, &access.into())?;
    if is_quick { tree.verify_quickly(DEFAULT_MEMORY, work) } else { tree.verify(DEFAULT_MEMORY, work) }
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<ExitCode> {
    let work = Work::start(global, "cells")?;
    let mut good = true;
    for file in &args.files {
        let findings = match verify(file, args.quick, global, &work) {
            Ok(findings) => findings,
            Err(Error::Interrupted) => return Err(Error::Interrupted.into()),
            Err(error) => {
                // Continue with the other files.
                complain(&error.into(), global.given());
                good = false;
                continue;
            }
        };
        for finding in &findings {
            print_text(&format!("{}: {}: {}\n", shown(file), finding.place, finding.problem))?;
        }
        if findings.is_empty() && !global.quiet {
            print_text(&format!("{}: good\n", shown(file)))?;
        }
        good &= findings.is_empty();
    }
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
