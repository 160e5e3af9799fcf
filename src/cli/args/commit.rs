//! Options of all subcommands that make a commit.

use std::time::{SystemTime, UNIX_EPOCH};

use spinney::edit::Note;
use spinney::raw::io::redacted;

use super::Memory;

/// A commit's note.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Commit")]
pub(crate) struct CommitOptions {
    /// Message: what was changed, and why [default: a short description of the change]
    #[arg(short, long, value_name = "TEXT")]
    message: Option<String>,
    /// Author of the commit
    #[arg(long, value_name = "NAME", env = "SPINNEY_AUTHOR", default_value = "")]
    author: String,
    /// Time of the commit, in seconds since 1970-01-01 00:00 UTC [default: now]
    #[arg(long, value_name = "SECONDS", env = "SOURCE_DATE_EPOCH", allow_negative_numbers = true)]
    time: Option<i64>,
}

/// A commit's note, and the memory limit of the edit.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct EditOptions {
    #[command(flatten)]
    pub(crate) commit: CommitOptions,
    #[command(flatten)]
    pub(crate) memory: Memory,
}

impl CommitOptions {
    /// Returns the commit's note; `message` is used if no `--message` was given.
    pub(crate) fn note(&self, message: String) -> Note {
        let now = || SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs() as i64);
        Note {
            time: self.time.or_else(now),
            author: self.author.clone(),
            message: self.message.clone().unwrap_or_else(|| redacted(&message).into_owned()),
        }
    }
}
