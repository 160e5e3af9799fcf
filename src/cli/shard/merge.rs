//! `spinney shard merge`: the file that shards make together.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::raw::shards::Job;
use spinney::raw::store::TreeFormat;
use spinney::raw::store::goblin::MergeOutput;

use super::super::Global;
use super::super::args::{Memory, OutputLimit};
use super::super::report::{Work, report_built};

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
    /// cut off goes on, with the file OUT.goblin.partial
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
    let job = Job::open_with(&args.job, global.access())?;
    let work = Work::start(global, "bytes")?;
    let output = MergeOutput::create(&args.output, args.limit.bytes(), args.remove_shards, global.access())?;
    job.merge(output, args.memory.bytes, &work)?;
    work.finish();
    let bytes = job.input_bytes();
    if args.remove_shards {
        job.remove()?;
    }
    report_built(global, &args.output, start, Some(bytes));
    Ok(())
}
