//! `spinney log`: the commits of a file.

use std::path::PathBuf;

use spinney::store::autumnal::History;

use super::{Result, history, print_json, print_text};

const EXAMPLES: &str = "Examples:
  spinney log map.autumn
  spinney log map.autumn -n 5 --json
  spinney info map.autumn@12                         what was in the map at commit 12";

/// List the commits of an Autumnal file, the newest first
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Tree file
    file: PathBuf,
    /// How many at most
    #[arg(short = 'n', long = "number", value_name = "N")]
    most: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result {
    let file = History::open(&args.file, &Default::default())?;
    let commits = file.commits().take(args.most.unwrap_or(usize::MAX));
    if args.json {
        let commits = commits.map(|commit| Ok(history::as_json(&commit?))).collect::<Result<Vec<_>>>()?;
        return print_json(&commits.into());
    }
    for commit in commits {
        let commit = commit?;
        print_text(&format!("{:>6}{}\n", commit.number, history::about(&commit)))?;
        for line in commit.note.message.lines().skip(1) {
            print_text(&format!("       {line}\n"))?;
        }
        print_text(&format!("       {} cells; records: {}\n", commit.cells, history::written(&commit)))?;
    }
    Ok(())
}
