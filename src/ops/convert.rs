//! The same trees in other files: the other format, or less history.

use std::path::Path;
use std::sync::Arc;

use super::combine::{Combined, Operation};
use super::view::View;
use crate::store::autumnal::{Commit, Keep, compact};
use crate::store::build::{BuildOptions, build};
use crate::store::goblin::{Layout, OpenOptions};
use crate::store::{File, Output, Typed, typed};
use crate::value::Value;
use crate::{Progress, Result};

/// Writes some commits of a file to a new one: see [`compact`].
///
/// # Errors
/// As [`compact`].
pub fn compact_file(
    path: &Path,
    keep: &Keep,
    share: bool,
    output: Output,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<Commit>> {
    typed(path, Compacting { path, keep, share, output, memory, progress })
}

struct Compacting<'a> {
    path: &'a Path,
    keep: &'a Keep,
    share: bool,
    output: Output,
    memory: u64,
    progress: &'a dyn Progress,
}

impl Typed for Compacting<'_> {
    type Out = Vec<Commit>;

    fn of<D: Layout, V: Value>(self) -> Result<Vec<Commit>> {
        compact::<D, V>(self.path, self.keep, self.share, self.output, self.memory, self.progress)
    }
}

/// Writes a tree as it is, in the format that the output's name asks for: an Autumnal tree (or one of its commits) to be
/// published, or a published one to be edited. From Goblin to Autumnal and back the bytes stay the same.
///
/// # Errors
/// If the file cannot be read, the output not be written, or on interruption.
pub fn convert(path: &Path, share: bool, output: Output, memory: u64, progress: &dyn Progress) -> Result<()> {
    typed(path, Converting { path, share, output, memory, progress })
}

struct Converting<'a> {
    path: &'a Path,
    share: bool,
    output: Output,
    memory: u64,
    progress: &'a dyn Progress,
}

impl Typed for Converting<'_> {
    type Out = ();

    fn of<D: Layout, V: Value>(self) -> Result<()> {
        let file = Arc::new(File::<D, V>::open(self.path, &OpenOptions::default())?);
        let header = file.header().clone();
        let metadata = file.metadata().clone();
        let options =
            BuildOptions { metadata, share: self.share, ..BuildOptions::like(&header, self.memory) };
        let view = View::new(file, header.extent)?.deepened(header.shape.depth)?;
        let source = Combined::new(vec![view], Operation::Over, header.extent)?;
        build(&source, header.extent, &options, self.output, self.progress).map(|_| ())
    }
}
