//! `spinney compact`: copies a file without its older commits.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use spinney::raw::store::autumnal::{self, CompactOptions, Keep};

use super::Global;
use super::args::{Memory, OutputLimit, check_output};
use super::report::{Work, commit, report_output};

/// Copy some commits of an Autumnal file to a new, smaller file
///
/// Commits keep their numbers, messages, authors and times. Other programs can continue to read the
/// old file.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file
    file: PathBuf,
    /// File to write
    #[arg(short, long, value_name = "OUT.autumn")]
    output: PathBuf,
    /// Number of commits to keep, the newest ones
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    keep: u64,
    /// Numbers of the commits to keep
    #[arg(long, value_name = "N,...", value_delimiter = ',', conflicts_with = "keep")]
    commits: Option<Vec<u64>>,
    /// Store equal subtrees once, also in later commits
    #[arg(long)]
    share: bool,
    /// Pack records that only older commits have: fewer bytes, slower to read
    #[arg(long)]
    pack: bool,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    limit: OutputLimit,
}

const EXAMPLES: &str = "\
Examples:
  spinney compact map.autumn -o newest.autumn
  spinney compact map.autumn -o small.autumn --keep 10 --share
  spinney compact map.autumn -o releases.autumn --commits 1,12,40
  spinney compact map.autumn -o archive.autumn --keep 1000 --pack";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    check_output([Path::new(&args.file)], &args.output)?;
    let keep = args.commits.clone().map_or(Keep::Last(args.keep), Keep::Numbers);
    let work = Work::start(global, "cells")?;
    let output = args.limit.create_tree(&args.output, global)?;
    let options = CompactOptions::new(&keep, args.memory.bytes).share(args.share).pack(args.pack);
    let commits = autumnal::compact(&args.file, &options, output, &work)?;
    work.finish();
    for written in &commits {
        global.report("commit", format_args!("{}: {}", written.number, commit::written(written)));
    }
    report_output(global, &args.output, start);
    Ok(())
}
