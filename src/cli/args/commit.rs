//! Options of everything that makes a commit.

use std::time::{SystemTime, UNIX_EPOCH};

use spinney::edit::Note;
use spinney::raw::io::redacted;

use super::Memory;

/// A commit's note.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Commit")]
pub(crate) struct CommitOptions {
    /// Message: what was done, and why [default: the change in a few words]
    #[arg(short, long, value_name = "TEXT")]
    message: Option<String>,
    /// Name of who did it
    #[arg(long, value_name = "NAME", env = "SPINNEY_AUTHOR", default_value = "")]
    author: String,
    /// Time of the commit, in seconds since the beginning of 1970 [default: now]
    #[arg(long, value_name = "SECONDS", env = "SOURCE_DATE_EPOCH", allow_negative_numbers = true)]
    time: Option<i64>,
}

/// A commit's note, and the memory that making it may use.
#[derive(clap::Args, Clone, Debug)]
pub(crate) struct EditOptions {
    #[command(flatten)]
    pub(crate) commit: CommitOptions,
    #[command(flatten)]
    pub(crate) memory: Memory,
}

impl CommitOptions {
    /// The commit's note; the message is used if none was given.
    pub(crate) fn note(&self, message: String) -> Note {
        let now = || SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs() as i64);
        Note {
            time: self.time.or_else(now),
            author: self.author.clone(),
            message: self.message.clone().unwrap_or_else(|| redacted(&message).into_owned()),
        }
    }
}
