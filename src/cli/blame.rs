//! `spinney blame`: the commit that changed each cell last.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use spinney::raw::ops;
use spinney::{Codec, WriteOptions};

use super::Global;
use super::args::{self, Memory, OutputFile, OutputLimit, check_output};
use super::report::{Work, report_output};

const EXAMPLES: &str = "Examples:
  spinney blame map.autumn -o age.goblin
  spinney blame map.autumn@12 -o age.goblin          up to commit 12
  spinney find age.goblin --class 7                  what commit 7 changed, and none after it
  spinney log map.autumn                             who made commit 7, when and why";

/// Make a tree with the number of the commit that last changed each cell
///
/// Cells without a value in any commit are VOID. Coarse cells have the newest commit below them.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file; FILE@N: up to that commit
    file: PathBuf,
    #[command(flatten)]
    output: OutputFile,
    #[command(flatten)]
    memory: Memory,
    /// Packing of the output's segments: plain (mapped and read in place) or packed (smaller,
    /// unpacked when read); for .goblin files
    #[arg(long, value_name = "plain|packed", default_value = "plain")]
    codec: Codec,
    #[command(flatten)]
    limit: OutputLimit,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let output = args.output.path();
    check_output([args.file.as_path()], output)?;
    let how = WriteOptions::new(args.memory.bytes).packing(args::packing(args.codec));
    let work = Work::start(global, "cells")?;
    ops::blame(&args.file, args.limit.create_tree(output, global)?, how, &work)?;
    work.finish();
    report_output(global, output, start);
    Ok(())
}
