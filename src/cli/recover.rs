//! `spinney recover`: makes an older commit the newest if the newest is corrupt.

use std::path::PathBuf;

use anyhow::Result;
use spinney::raw::store::autumnal::recover;

use super::Global;
use super::report::Work;

const EXAMPLES: &str = "Examples:
  spinney log map.autumn                             print readable commits, and the error
  cp map.autumn copy.autumn                          keep a copy: later data is discarded
  spinney recover map.autumn --to 11";

/// Recover an Autumnal file whose newest commit is corrupt: restore an older one
///
/// Everything after that commit is discarded: the next edit overwrites it. Files that are not
/// corrupt are not changed; `spinney revert` restores a commit of those without discarding others.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file
    file: PathBuf,
    /// Number of the commit that becomes the newest
    #[arg(long, value_name = "N")]
    to: u64,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let work = Work::start(global, "bytes")?;
    let commit = recover(&args.file, args.to, global.access(), &work)?;
    work.finish();
    global.report("newest", format_args!("commit {}; everything after it is discarded", commit.number));
    Ok(())
}
