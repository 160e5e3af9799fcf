//! `spinney recover`: makes an older commit the newest if the newest is corrupt.

use std::path::PathBuf;

use anyhow::Result;
use spinney::raw::store::autumnal::recover;

use super::Global;
use super::report::Work;

const EXAMPLES: &str = "Examples:
  spinney log map.autumn                             the commits that can be read, and what is wrong
  cp map.autumn copy.autumn                          what is given up may be of use to somebody
  spinney recover map.autumn --to 11";

/// Make an older commit the newest, in an Autumnal file whose newest commit is corrupt
///
/// Everything after that commit is discarded: the next edit overwrites it. Files that are not
/// corrupt are not changed; `spinney revert` goes back without losing anything.
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
    global.report("newest", format_args!("commit {}; what came behind it is given up", commit.number));
    Ok(())
}
