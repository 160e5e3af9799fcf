//! `spinney shard build`: one shard of a job.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::Result;
use spinney::raw::shards::Job;

use super::super::Global;
use super::super::args::Memory;
use super::super::report::{Work, quantity};

/// Build a shard of a job, unless it is built already
///
/// Shards can be built in any order, concurrently, and again after a process was killed: its
/// incomplete output is ignored. Fails if an input, or an accompanying file, has changed since the
/// job was planned.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Directory of the job
    job: PathBuf,
    /// Number of the shard, from 0
    #[arg(value_name = "K")]
    number: u32,
    #[command(flatten)]
    memory: Memory,
}

pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let job = Job::open_with(&args.job, global.access())?;
    let work = Work::start(global, "cells")?;
    let built = job.build(args.number, args.memory.bytes, &work)?;
    work.finish();
    let (number, bytes) = (args.number, quantity::bytes(built.bytes));
    let text = match built.existed {
        true => format!("{number} of {}: {bytes}, was built already", job.shards()),
        false => format!("{number} of {}: {bytes}, in {:.1} s", job.shards(), start.elapsed().as_secs_f64()),
    };
    global.report("shard", text);
    Ok(())
}
