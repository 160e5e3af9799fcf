//! Makes a new file of the parts of trees, layer after layer.

use std::path::Path;

use super::commit::Note;
use super::editor::Editor;
use crate::store::builder::{BuildOptions, Fill, no_segments};
use spinney_base::io::{FileBackend, Output};
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, LevelCounts, Metadata};

/// A file being made, with one commit. It has no time unless one is given, so that the same input makes the same bytes; its message is
/// where the data come from.
pub(in crate::store) struct NewFile {
    output: Output,
    /// Levels of the space that the layers share.
    depth: u8,
    editor: Option<Editor>,
    time: Option<i64>,
    /// Lines of the commit's message.
    message: Vec<String>,
}

impl NewFile {
    /// A file of layers that have up to so many levels.
    pub(in crate::store) fn new(output: Output, depth: u8) -> NewFile {
        NewFile { output, depth, editor: None, time: None, message: Vec::new() }
    }

    /// Makes the next layer of the parts of a tree, which `fill` hands over.
    pub(in crate::store) fn layer(
        &mut self,
        options: &BuildOptions,
        header: &Header,
        covered: [u64; 3],
        fill: &mut Fill<'_>,
        complete: &mut dyn FnMut(&mut Metadata),
    ) -> Result<ZoneStats> {
        check_plain(header, self.output.path())?;
        let editor = match &mut self.editor {
            Some(editor) => {
                editor.add_layer(header, options.metadata.clone())?;
                editor
            }
            none => {
                let path = self.output.path().to_path_buf();
                let backend = backend(&mut self.output)?;
                none.insert(Editor::create(backend, path, (header, self.depth), options, false)?)
            }
        };
        let tally = editor.fill(covered, options, None, fill)?;
        // Nobody keeps nodes per level up to date when trees are edited.
        let mut metadata = Metadata { counts: LevelCounts::default(), ..options.metadata.clone() };
        complete(&mut metadata);
        self.time = self.time.or(options.time);
        for line in &metadata.provenance {
            if !self.message.contains(line) {
                self.message.push(line.clone());
            }
        }
        editor.set_metadata(metadata)?;
        Ok(tally)
    }

    /// Commits all layers, and puts the file in its place.
    pub(in crate::store) fn finish(mut self) -> Result<()> {
        if let Some(mut editor) = self.editor.take() {
            let message = self.message.join("\n");
            editor.commit(Note { message, time: self.time, ..Note::default() })?;
        }
        self.output.commit()
    }
}

/// Makes sure that a tree whose segments are to be packed does not become part of an Autumnal file, which has none.
pub(super) fn check_plain(header: &Header, path: &Path) -> Result<()> {
    match header.codec {
        Codec::Plain => Ok(()),
        Codec::Packed => Err(no_segments(path)),
    }
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
