//! Lists of inputs in files.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use spinney::raw::io::{gdal_url, listed_path};

/// Maximum size of a list, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Replaces each `@file` by the paths in that file: one a line, relative to the file's directory.
/// Lines that begin with # are comments. GDAL's names of remote files become URLs.
pub(crate) fn expand_lists(inputs: Vec<PathBuf>) -> Result<Vec<PathBuf>> {
    let mut expanded = Vec::with_capacity(inputs.len());
    for input in inputs {
        match input.to_str().and_then(|text| text.strip_prefix('@')) {
            Some(list) => read(Path::new(list), &mut expanded)?,
            None => expanded.push(input.to_str().and_then(gdal_url).map_or(input, PathBuf::from)),
        }
    }
    Ok(expanded)
}

fn read(list: &Path, paths: &mut Vec<PathBuf>) -> Result<()> {
    let about = || format!("{}: cannot read the list of inputs", list.display());
    let mut text = String::new();
    let file = File::open(list).with_context(about)?;
    let length = file.take(MAX_BYTES + 1).read_to_string(&mut text).with_context(about)?;
    if length as u64 > MAX_BYTES {
        bail!("{}: the list of inputs is longer than {MAX_BYTES} bytes", list.display());
    }
    let before = paths.len();
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    for line in lines {
        paths.push(listed_path(list, line)?);
    }
    if paths.len() == before {
        bail!("{}: the list of inputs is empty", list.display());
    }
    Ok(())
}
