//! Lists of inputs in files.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// Maximum size of a list, in bytes.
const MOST: u64 = 64 << 20;

/// Replaces each `@file` by the paths in that file: one a line, relative to the file's directory.
/// Lines that begin with # are comments.
pub(crate) fn expand_lists(inputs: Vec<PathBuf>) -> Result<Vec<PathBuf>> {
    let mut expanded = Vec::with_capacity(inputs.len());
    for input in inputs {
        match input.to_str().and_then(|text| text.strip_prefix('@')) {
            Some(list) => read(Path::new(list), &mut expanded)?,
            None => expanded.push(input),
        }
    }
    Ok(expanded)
}

fn read(list: &Path, paths: &mut Vec<PathBuf>) -> Result<()> {
    let about = || format!("{}: the list of inputs", list.display());
    let mut text = String::new();
    let file = File::open(list).with_context(about)?;
    let length = file.take(MOST + 1).read_to_string(&mut text).with_context(about)?;
    if length as u64 > MOST {
        bail!("{} has more than {MOST} bytes", about());
    }
    let folder = list.parent().unwrap_or(Path::new(""));
    let before = paths.len();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    paths.extend(lines.map(|line| folder.join(line)));
    if paths.len() == before {
        bail!("{} names no file", about());
    }
    Ok(())
}
