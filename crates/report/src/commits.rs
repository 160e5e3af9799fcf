//! Commits of Autumnal files.

use serde_json::{Value, json};
use spinney_engine::store::autumnal::Commit;

use crate::JsonNumbers;

/// Returns a commit as JSON: its note, and the records and bytes that it wrote.
pub fn commit_as_json(commit: &Commit, numbers: JsonNumbers) -> Value {
    let (note, written) = (&commit.note, &commit.written);
    json!({
        "number": commit.number,
        "time": note.time,
        "author": note.author,
        "message": note.message,
        "cells": numbers.count(commit.cells),
        "records": numbers.count(commit.inner_nodes),
        "written_records": written.records,
        "written_bytes": written.bytes,
        "shared_records": written.shared,
        "spared_bytes": written.spared,
    })
}
