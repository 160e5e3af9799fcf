//! Makes a new file of the parts of a tree.

use super::commit::Note;
use super::editor::Editor;
use crate::store::builder::{BuildOptions, Fill};
use spinney_base::io::{FileBackend, Output};
use spinney_base::value::Tally;
use spinney_base::{Error, Result};
use spinney_container::{Header, LevelCounts, Metadata};

/// Makes a file with one commit. It has no time, so that the same input makes the same bytes; its message is
/// where the data come from.
pub(in crate::store) fn write(
    options: &BuildOptions,
    header: Header,
    covered: [u64; 3],
    mut output: Output,
    fill: &mut Fill<'_>,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally> {
    let path = output.path().to_path_buf();
    let mut editor = Editor::create(backend(&mut output)?, path, (&header, header.depth()), options)?;
    let tally = editor.fill(covered, options, None, fill)?;
    // Nobody keeps nodes per level up to date when trees are edited.
    let mut metadata = Metadata { counts: LevelCounts::default(), ..options.metadata.clone() };
    complete(&mut metadata);
    let message = metadata.provenance.join("\n");
    editor.set_metadata(metadata)?;
    editor.commit(Note { message, time: options.time, ..Note::default() })?;
    drop(editor);
    output.commit()?;
    Ok(tally)
}

/// The output as something to be written in any order.
pub(super) fn backend(output: &mut Output) -> Result<Box<FileBackend>> {
    let path = output.path().to_path_buf();
    if path.exists() {
        let advice = "edit it (see `spinney edit --help`), or remove it first: its history would be lost";
        return Err(Error::unsupported(&path, "replacing an Autumnal file that is there", advice));
    }
    // The same holds at the end: an edit of a file that appears meanwhile must not be lost either.
    output.keep_existing();
    match output.backend() {
        Some(file) => file.map(Box::new).map_err(Error::io(&path, "open")),
        None => Err(Error::unsupported(&path, "an Autumnal file in a pipe", "write it to a file")),
    }
}
