//! `spinney shard merge`: merges shards into one file.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::raw::shards::{MergeOptions, MergeOutcome, merge};
use spinney::raw::store::TreeFormat;

use super::super::Global;
use super::super::args::{Memory, OutputLimit};
use super::super::report::{Work, report_built, warn};

/// Merge the shards of a job
///
/// Shards are checked and copied consecutively; the levels above them are computed. The job is kept
/// unless --remove-shards is given: remove its directory when the file is complete.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Directory of the job
    job: PathBuf,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    /// Remove each shard's data as soon as it is in the file (and the job when the file is
    /// complete), so that disk space for one copy is enough; an incomplete merge continues when it
    /// is called again, with the files OUT.goblin.partial and OUT.goblin.partial.job
    #[arg(long)]
    remove_shards: bool,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    limit: OutputLimit,
}

pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if TreeFormat::of(&args.output) == TreeFormat::Autumnal {
        bail!(
            "{}: shards make a .goblin file; for an .autumn file, run `spinney convert` on it",
            args.output.display()
        )
    }
    let work = Work::start(global, "bytes")?;
    let options =
        MergeOptions { limit: args.limit.bytes(), removes: args.remove_shards, memory: args.memory.bytes };
    let merged = merge(&args.job, &args.output, options, global.access(), &work)?;
    work.finish();
    let (job, output) = (args.job.display(), args.output.display());
    match merged {
        MergeOutcome::Made(bytes) => report_built(global, &args.output, start, Some(bytes)),
        MergeOutcome::Finished => {
            global.report("output", format_args!("{output}: was complete; the rest of {job} is removed"))
        }
        MergeOutcome::JobMissing => warn(&format!(
            "{job}: no such job, but {output} exists: the job was merged before, or has another name"
        )),
    }
    Ok(())
}
