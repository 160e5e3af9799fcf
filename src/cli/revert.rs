//! `spinney revert`: back to an older commit.

use std::path::PathBuf;

use spinney::ops::{Edit, edit};

use super::history::{self, Told};
use super::{Global, Result};

const EXAMPLES: &str = "Examples:
  spinney revert map.autumn 3
  spinney revert map.autumn 3 -m 'The survey was wrong' --author Ann";

/// Make an Autumnal file what it was at an older commit: a commit more, nothing is lost
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file
    file: PathBuf,
    /// The commit's number
    commit: u64,
    #[command(flatten)]
    told: Told,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result {
    let note = args.told.note(format!("Revert to commit {}", args.commit));
    let commit = edit(&args.file, [Ok(Edit::Revert(args.commit))], note, args.told.memory, &())?;
    history::tell_commit(global, commit.as_ref());
    Ok(())
}
