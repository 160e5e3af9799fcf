//! Writes a new file from the blocks of trees, layer by layer.

use std::path::Path;

use super::commit::Note;
use super::editor::Editor;
use crate::store::builder::{BuildOptions, Fill, no_segments};
use spinney_base::io::{FileBackend, Output};
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Result};
use spinney_container::{Codec, Header, LevelCounts, Metadata};

/// A file in progress, with one commit. The commit has no time unless one is given, so that equal
/// inputs give equal bytes. Its message lists the sources of the data.
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
    /// Starts a file of layers with up to `depth` levels.
    pub(in crate::store) fn new(output: Output, depth: u8) -> NewFile {
        NewFile { output, depth, editor: None, time: None, message: Vec::new() }
    }

    /// Writes the next layer from the blocks of a tree that `fill` pushes.
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
        // Edits do not maintain the node counts per level, so none are stored.
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

    /// Commits all layers and moves the file to its path.
    pub(in crate::store) fn finish(mut self) -> Result<()> {
        if let Some(mut editor) = self.editor.take() {
            let message = self.message.join("\n");
            editor.commit(Note { message, time: self.time, ..Note::default() })?;
        }
        self.output.commit()
    }
}

/// Rejects trees with packed segments: an Autumnal file has no segments.
pub(super) fn check_plain(header: &Header, path: &Path) -> Result<()> {
    match header.codec {
        Codec::Plain => Ok(()),
        Codec::Packed | Codec::Reference => Err(no_segments(path)),
    }
}

/// Returns the output as a backend for random-access writes.
pub(super) fn backend(output: &mut Output) -> Result<Box<FileBackend>> {
    let path = output.path().to_path_buf();
    if path.exists() {
        let advice =
            "edit it (see `spinney edit --help`), or remove it first, since its history would be lost";
        return Err(Error::unsupported(&path, "replacing an existing Autumnal file", advice));
    }
    // Check again when the file is moved to its path, so that a file created meanwhile is not lost.
    output.keep_existing();
    match output.backend() {
        Some(file) => file.map(Box::new).map_err(Error::io(&path, "open")),
        None => Err(Error::unsupported(&path, "an Autumnal file in a pipe", "write it to a file")),
    }
}
