//! Commits, as text.

use spinney::edit::Commit;

use super::super::Global;
use super::quantity;

/// Returns the time, the author and the first line of the message of a commit, as far as known,
/// with a comma before each.
pub(crate) fn about(commit: &Commit) -> String {
    let note = &commit.note;
    let mut text = String::new();
    if let Some(time) = note.time {
        text += &format!(", {}", quantity::time(time));
    }
    if !note.author.is_empty() {
        text += &format!(", {}", note.author);
    }
    if let Some(line) = note.message.lines().next() {
        text += &format!(": {line}");
    }
    text
}

/// Returns the number of records and bytes that a commit wrote, and those that sharing saved.
pub(crate) fn written(commit: &Commit) -> String {
    let written = &commit.written;
    let mut text = format!("{} written, {}", written.records, quantity::bytes(written.bytes));
    if written.shared > 0 {
        text += &format!(", {} shared, {} saved", written.shared, quantity::bytes(written.spared));
    }
    text
}

/// Reports a new commit, or that there was nothing to commit.
pub(crate) fn report_commit(global: &Global, commit: Option<&Commit>) {
    match commit {
        Some(commit) => {
            global.report("commit", format_args!("{}{}", commit.number, about(commit)));
            global.report("records", written(commit));
        }
        None => global.report("commit", "nothing has changed"),
    }
}
