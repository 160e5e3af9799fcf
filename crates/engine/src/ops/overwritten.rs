//! Outputs that would overwrite files that inputs read.

use std::path::{Path, PathBuf};

use super::tree_file::TreeFile;
use spinney_base::io::listed_path;
use spinney_container::{FileReference, OpenOptions};

/// Returns a message if an output that exists is one of the inputs, or a file that has cells of
/// one: a source of an index, or a file of a manifest. Such a file must not be replaced: the input
/// would lose its cells.
pub fn overwritten_input(inputs: &[&Path], output: &Path) -> Option<String> {
    let output = output.canonicalize().ok()?;
    inputs.iter().find_map(|input| {
        let file = FileReference::of(input).file;
        if is_same(&file, &output) {
            return Some(format!("{}: is an input and the output; choose another output", input.display()));
        }
        let own = file_with_cells(&file, &output)?;
        Some(format!("{}: has cells of {}; choose another output", own.display(), input.display()))
    })
}

/// Whether a path names a file with this canonical path.
fn is_same(path: &Path, canonical: &Path) -> bool {
    path.canonicalize().is_ok_and(|path| path == canonical)
}

/// Returns the path by which a file names `output`, if `output` has cells of it. A file that cannot
/// be opened is an error later.
fn file_with_cells(file: &Path, output: &Path) -> Option<PathBuf> {
    if !file.is_file() {
        return None;
    }
    match TreeFile::open(file, &OpenOptions::new()).ok()? {
        TreeFile::Goblin(index) => {
            let path = |name: &str| listed_path(index.path(), name).ok();
            let is_output = |name: &str| path(name).is_some_and(|source| is_same(&source, output));
            index.find_source(&is_output).ok()?.and_then(|name| path(&name))
        }
        TreeFile::Mosaic(manifest) => {
            let mut files = manifest.entries().iter().filter_map(|entry| entry.file(file).ok());
            files.find(|file| is_same(file, output))
        }
        TreeFile::Autumnal(_) => None,
    }
}
