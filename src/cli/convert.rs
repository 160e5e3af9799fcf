//! `spinney convert`: the same tree in the other format.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;

use super::Global;
use super::args::{Memory, OutputFile, OutputLimit, Packing, check_output};
use super::report::{Work, report_output};

/// Convert between Goblin and Autumnal files, or change the packing
///
/// Writes the same tree: a compact, read-only Goblin file, or an Autumnal file, which can be
/// edited, if the output's name ends with .autumn. Converting from Goblin to Autumnal and back
/// gives the same bytes.
///
/// Segments are plain unless --codec is given, whatever those of the file are. (Commands that copy
/// layers, such as edit add-layer, keep their packing.)
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Tree file; FILE@N is one of its commits
    file: PathBuf,
    #[command(flatten)]
    output: OutputFile,
    /// Store equal subtrees once; for .autumn files
    #[arg(long)]
    share: bool,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    limit: OutputLimit,
}

const EXAMPLES: &str = "\
Examples:
  spinney convert map.autumn map.goblin
  spinney convert map.autumn@12 release.goblin
  spinney convert release.goblin small.goblin --codec packed
  spinney convert release.goblin next.autumn --share";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let output = args.output.path();
    check_output([Path::new(&args.file)], output)?;
    let how = args.packing.with(args.memory);
    let work = Work::start(global, "cells")?;
    spinney::convert(&args.file, args.share, args.limit.create_tree(output, global)?, how, &work)?;
    work.finish();
    report_output(global, output, start);
    Ok(())
}
