//! `spinney shard merge`: the file that shards make together.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::raw::shards::{MergeOptions, Merged, merge};
use spinney::raw::store::TreeFormat;

use super::super::Global;
use super::super::args::{Memory, OutputLimit};
use super::super::report::{Work, report_built, warn};

/// Put the shards of a job together
///
/// Shards are checked and copied one behind the other; what stands above them all is made. The job stays as it is, unless --remove-shards is given: remove its folder
/// when the file is there.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of the job
    job: PathBuf,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    /// Remove what shards have left as soon as it is in the file, and the job when the file is there, so that there is room for one of both; what is
    /// cut off goes on when it is called again, with the files OUT.goblin.partial and OUT.goblin.partial.job
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
            "{}: shards make a .goblin file; `spinney build` of that makes an .autumn file, which can be edited",
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
        Merged::Made(bytes) => report_built(global, &args.output, start, Some(bytes)),
        Merged::Finished => {
            global.report("output", format_args!("{output}: was whole; what was left of {job} is removed"))
        }
        Merged::JobMissing => warn(&format!(
            "{job}: no job is there, and {output} is: it was merged before, or the job has another name"
        )),
    }
    Ok(())
}
