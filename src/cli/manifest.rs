//! `spinney manifest`: many files as one.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use spinney::raw::io::{shown, url_of};
use spinney::raw::manifest::list_files;

use super::Global;
use super::report::{Work, warn};

/// Make or change a manifest: a JSON file that opens many trees as one
///
/// A manifest is accepted wherever a tree file is. Its files have one grid of cells and values of
/// one kind. Cells without data in any file are VOID; where two files overlap, the later one is on
/// top. Files given by relative paths are listed relative to the manifest. A manifest is replaced
/// as a whole: readers see the old one or the new one. If two processes change it at the same time,
/// one of them fails and must be run again.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Goblin files to list, or layers of some, as in FILE:LAYER
    files: Vec<PathBuf>,
    /// File to write: the manifest, or the one to change
    #[arg(short, long, value_name = "OUT.manifest.json")]
    output: PathBuf,
    /// Files to add to the existing manifest; a file that it lists already is listed in its current
    /// state
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with = "files")]
    add: Vec<PathBuf>,
    /// Files to remove from the existing manifest, by the names in it
    #[arg(long, value_name = "NAME", num_args = 1.., conflicts_with = "files")]
    remove: Vec<String>,
}

const EXAMPLES: &str = "\
Examples:
  spinney manifest tiles/*.goblin -o world.manifest.json
  spinney manifest -o world.manifest.json --add tiles/new.goblin --remove tiles/old.goblin
  spinney info world.manifest.json
  spinney get world.manifest.json -o overview.png --size 1024
  spinney transform world.manifest.json -o world.goblin";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let is_update = !args.add.is_empty() || !args.remove.is_empty();
    ensure!(
        is_update || !args.files.is_empty(),
        "expected files to list, or --add or --remove to change the manifest"
    );
    let listed = args.files.iter().chain(&args.add);
    listed.filter(|file| url_of(file).is_some_and(|url| shown(file) != url)).for_each(|file| {
        warn(&format!(
            "{}: the URL's query and password are not stored; --signed-urls supplies them again",
            shown(file)
        ));
    });
    let work = Work::start(global, "files")?;
    let files = if is_update { &args.add } else { &args.files };
    let manifest = list_files(&args.output, is_update, files, &args.remove, global.access(), &work)?;
    work.finish();
    global.report("files", manifest.entries.len());
    Ok(())
}
