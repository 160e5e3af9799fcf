//! Commits, for people and for programs.

use serde_json::json;
use spinney::store::autumnal::Commit;

use super::quantity;

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
