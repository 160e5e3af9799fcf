//! `spinney log`: the commits of a file.

use std::path::PathBuf;

use anyhow::Result;
use spinney::raw::report::{JsonNumbers, commit_as_json};
use spinney::raw::store::autumnal::History;

use super::Global;
use super::report::{commit, print_json, print_text, warn};

const EXAMPLES: &str = "Examples:
  spinney log map.autumn
  spinney log map.autumn --limit 5 --json
  spinney info map.autumn@12                         what was in the map at commit 12";

/// List the commits of an Autumnal file, the newest first
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Tree file
    file: PathBuf,
    /// Maximum number of commits
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let file = History::open(&args.file, &global.access().into())?;
    if let Some(remark) = file.remark() {
        warn(&format!("{}: {remark}", args.file.display()));
    }
    let commits = file.commits().take(args.limit.unwrap_or(usize::MAX));
    if args.json {
        let commits = commits
            .map(|entry| Ok(commit_as_json(&entry?, JsonNumbers::Plain)))
            .collect::<Result<Vec<_>>>()?;
        print_json(&commits.into())?;
        file.check_newest()?;
        return Ok(file.check_unchanged()?);
    }
    for entry in commits {
        let entry = entry?;
        print_text(&format!("{:>6}{}\n", entry.number, commit::about(&entry)))?;
        for line in entry.note.message.lines().skip(1) {
            print_text(&format!("       {line}\n"))?;
        }
        print_text(&format!("       {} cells; records: {}\n", entry.cells, commit::written(&entry)))?;
    }
    // Also with --limit: the newest commit may be corrupt.
    file.check_newest()?;
    Ok(file.check_unchanged()?)
}
