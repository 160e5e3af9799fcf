//! `spinney revert`: returns to an older commit.

use std::path::PathBuf;

use anyhow::Result;
use spinney::edit::{Edit, Editor};
use spinney::raw::ops::apply_edits;

use super::Global;
use super::args::CommitOptions;
use super::report::Work;
use super::report::commit::report_commit;

const EXAMPLES: &str = "Examples:
  spinney revert map.autumn 3
  spinney revert map.autumn 3 -m 'The survey was wrong' --author Ann";

/// Restore an older commit of an Autumnal file by adding a new one
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The Autumnal file
    file: PathBuf,
    /// The commit's number
    commit: u64,
    #[command(flatten)]
    options: CommitOptions,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let note = args.options.note(format!("Revert to commit {}", args.commit));
    let work = Work::start(global, "cells")?;
    // (The old records are reused: no memory is needed for new ones.)
    let mut editor = Editor::open_with(&args.file, 0, global.access())?;
    apply_edits(&mut editor, &mut [Ok(Edit::Revert(args.commit))].into_iter(), &work)?;
    let commit = editor.commit(note)?;
    work.finish();
    report_commit(global, commit.as_ref());
    Ok(())
}
