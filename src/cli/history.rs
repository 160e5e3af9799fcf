//! Commits, for people and for programs.

use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::json;
use spinney::store::autumnal::{Commit, Note};

use super::{Global, quantity};

/// When, by whom and why, as far as it was told.
pub(super) fn about(commit: &Commit) -> String {
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

/// What a commit wrote, and what it did not need to.
pub(super) fn written(commit: &Commit) -> String {
    let written = &commit.written;
    let mut text = format!("{} written, {}", written.records, quantity::bytes(written.bytes));
    if written.shared > 0 {
        text += &format!(", {} shared, {} spared", written.shared, quantity::bytes(written.spared));
    }
    text
}

pub(super) fn as_json(commit: &Commit) -> serde_json::Value {
    let (note, written) = (&commit.note, &commit.written);
    json!({
        "number": commit.number,
        "time": note.time,
        "author": note.author,
        "message": note.message,
        "cells": commit.cells,
        "records": commit.records,
        "written_records": written.records,
        "written_bytes": written.bytes,
        "shared_records": written.shared,
        "spared_bytes": written.spared,
    })
}

/// What is told about a commit that is made.
#[derive(clap::Args, Clone, Debug)]
#[command(next_help_heading = "Commit")]
pub(super) struct Told {
    /// What was done, and why [default: the change in a few words]
    #[arg(short, long, value_name = "TEXT")]
    message: Option<String>,
    /// Who did it
    #[arg(long, value_name = "NAME", env = "SPINNEY_AUTHOR", default_value = "")]
    author: String,
    /// When, in seconds since the beginning of 1970 [default: now]
    #[arg(long, value_name = "SECONDS", env = "SOURCE_DATE_EPOCH", allow_negative_numbers = true)]
    time: Option<i64>,
    /// Memory to use, such as 256M or 2G
    #[arg(long, value_name = "BYTES", default_value = "256M", value_parser = quantity::parse_bytes)]
    pub(super) memory: u64,
}

impl Told {
    /// The commit's note; the message is used if none was given.
    pub(super) fn note(&self, message: String) -> Note {
        let now = || SystemTime::now().duration_since(UNIX_EPOCH).ok().map(|time| time.as_secs() as i64);
        Note {
            time: self.time.or_else(now),
            author: self.author.clone(),
            message: self.message.clone().unwrap_or(message),
        }
    }
}

/// A line about a commit that was made.
pub(super) fn tell_commit(global: &Global, commit: Option<&Commit>) {
    match commit {
        Some(commit) => {
            global.say(format_args!("{:<10} {}{}", "commit", commit.number, about(commit)));
            global.say(format_args!("{:<10} {}", "records", written(commit)));
        }
        None => global.say(format_args!("{:<10} nothing has changed", "commit")),
    }
}
