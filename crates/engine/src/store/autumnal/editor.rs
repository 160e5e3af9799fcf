//! Edits a file: a single writer, any number of edits, then a commit.

use std::borrow::Cow;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::append::Appender;
use super::archive::{Archive, OpenFile, RecordsForm, first_page};
use super::builder::{Mode, RecordBuilder};
use super::commit::{Commit, CommitLayer, Note, Root, WriteSummary};
use super::extents::{ExtentKind, Extents};
use super::layout::run_levels;
use super::meta::Meta;
use super::newest::NewestState;
use super::packed::{PackedExtents, PackedWriter};
use super::pages::FIRST_EXTENT;
use super::reader::Autumnal;
use super::write::check_plain;
use crate::store::builder::{BuildOptions, Fill, Packing, ReusableSource, TreeSink, walk};
use crate::tree::Source;
use spinney_base::io::{FileAccess, FileBackend, LockedFile, WriteBackend, redacted};
use spinney_base::space::CodeRange;
use spinney_base::value::ZoneStats;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Content, FileHeader, FileReference, Header, Metadata, TreeFormat, VOID};

/// A file that only this process edits until this value is dropped.
///
/// [`Editor::tree`] is the tree with all edits so far. An edit is a source derived from it (see
/// [`crate::ops`]), which becomes the new tree ([`apply_edits`](crate::ops::apply_edits)). Nodes
/// that the source passes through unchanged are kept without reading them. An edit therefore takes
/// time and space proportional to what changes, plus the tree's depth. Readers see nothing before
/// [`Editor::commit`], and uncommitted edits leave no trace.
pub struct Editor {
    appender: Appender,
    /// Tree with all edits so far.
    draft: Arc<Autumnal>,
    newest: Option<Commit>,
    /// State that was written last and is not committed yet.
    state: Option<Commit>,
    /// Meta slot of the newest commit.
    meta: Meta,
    /// File offset where uncommitted bytes begin.
    begin: u64,
    /// Memory in bytes that edits may use.
    memory: u64,
    /// Whether a layer was named at opening. Reverting then leaves the other layers alone.
    is_named: bool,
}

impl Editor {
    /// Opens a file for editing. `memory` is the memory in bytes that edits may use.
    ///
    /// # Errors
    /// If another process edits the file, it cannot be written, or as [`Autumnal::open`].
    pub fn open(path: &Path, memory: u64) -> Result<Editor> {
        Editor::open_with(path, memory, &FileAccess::default())
    }

    /// Opens a file for editing and reads it as `access` specifies.
    ///
    /// # Errors
    /// Those of [`Editor::open`].
    pub fn open_with(path: &Path, memory: u64, access: &FileAccess) -> Result<Editor> {
        let FileReference { file: path, layer, .. } = FileReference::of(path);
        let path = &*path;
        let file = File::options().read(true).write(true).open(path).map_err(Error::io(path, "open"))?;
        let file = FileBackend::new(file, path, access);
        // Check first: never write to a file that is not an Autumnal file.
        Archive::open(path, &|| open_file(&file), &access.into())?;
        let mut editor = Editor::on(Box::new(LockedFile::new(file)?), path, memory)?;
        if let Some(name) = layer {
            editor.select(&name)?;
            editor.is_named = true;
        }
        Ok(editor)
    }

    /// Edits the file of any backend. `path` is for messages. The caller ensures that there is only
    /// one editor.
    ///
    /// # Errors
    /// As [`Editor::open`].
    pub fn on(mut backend: Box<dyn WriteBackend>, path: &Path, memory: u64) -> Result<Editor> {
        // Another file may have replaced this one between opening and locking.
        backend.check_path()?;
        let archive = Archive::open(path, &|| open_file(&*backend), &backend.access().into())?;
        // Never write to a file whose newest commit is corrupt: that commit would be lost for good.
        let newest = archive.newest()?;
        // Invariant: the newest commit's slot is durable before anything else is written. It may
        // have been written without becoming durable. Then the next commit, which uses the other
        // slot, would overwrite the only slot that is certain to be on disk.
        let meta = archive.meta;
        backend.write(meta.offset(), &meta.to_bytes()).map_err(Error::io(path, "write the meta slot"))?;
        backend.sync().map_err(Error::io(path, "sync"))?;
        let share = archive.form.share.then_some(memory / 4);
        let draft = Arc::new(Autumnal::new(archive, newest.clone(), 0)?);
        let appender = Appender::new(backend, path.to_path_buf(), draft.layout().clone(), meta.end, share);
        Ok(Editor {
            begin: appender.position(),
            appender,
            draft,
            newest: Some(newest),
            state: None,
            meta,
            memory,
            is_named: false,
        })
    }

    /// Starts a file on an empty backend, with one VOID layer that is not committed yet. Layers may
    /// have up to `depth` levels. `may_pack` permits packed records.
    ///
    /// # Errors
    /// If the backend cannot be written.
    pub(super) fn create(
        mut backend: Box<dyn WriteBackend>,
        path: PathBuf,
        (header, depth): (&Header, u8),
        options: &BuildOptions,
        may_pack: bool,
    ) -> Result<Editor> {
        let dimension = header.form.dimension;
        let levels = run_levels(dimension);
        // The fewer levels a record has, the more records are equal.
        let run_levels = if options.share { *levels.start() } else { *levels.end() };
        let (format, content) = (TreeFormat::Autumnal, Content::Cells);
        let file_header = FileHeader { format, content, dimension, depth, layers: 0 };
        let form = RecordsForm { run_levels, share: options.share, may_pack };
        let mut pages = first_page(&file_header, form);
        pages.resize(FIRST_EXTENT as usize, 0);
        backend.write(0, &pages).map_err(Error::io(&*path, "write the header"))?;
        let (bytes, file) = open_file(&*backend)?;
        let meta = Meta { sequence: 0, commit: 0, end: FIRST_EXTENT };
        let packed =
            may_pack.then(|| Arc::new(PackedExtents::new(&file_header, run_levels, &backend.access())));
        let extents = Arc::new(Extents::new(&path, bytes, FIRST_EXTENT, true)?.with_packed(packed));
        let archive = Archive {
            header: file_header,
            form,
            extents,
            meta,
            state: NewestState::Good,
            file,
            access: backend.access(),
        };
        let commit = Commit {
            number: 0,
            note: Note::default(),
            cells: 0,
            inner_nodes: 0,
            written: WriteSummary::default(),
            sequence: 0,
            layers: vec![void_layer(header, &options.metadata.name)],
            previous: 0,
            jump: (0, 0),
        };
        let draft = Arc::new(Autumnal::with_metadata(archive, commit, 0, options.metadata.clone())?);
        let share = options.share.then_some(options.memory / 4);
        let appender = Appender::new(backend, path, draft.layout().clone(), FIRST_EXTENT, share);
        Ok(Editor {
            begin: FIRST_EXTENT,
            appender,
            draft,
            newest: None,
            state: None,
            meta,
            memory: options.memory,
            is_named: false,
        })
    }

    /// Selects a layer for the following operations.
    ///
    /// # Errors
    /// If there is no layer of that name, or it is corrupt.
    pub fn select(&mut self, name: &str) -> Result<()> {
        let commit = &self.draft.commit;
        let place = FileReference { file: self.draft.path().into(), commit: None, layer: Some(name.into()) };
        let number = place.layer_number(commit.layers.iter().map(|layer| &*layer.name))?;
        if number == self.draft.number {
            return Ok(());
        }
        self.keep_metadata()?;
        let tree = Autumnal::new(self.draft.archive.clone(), self.draft.commit.clone(), number)?;
        self.appender.set_tree(&tree);
        self.draft = Arc::new(tree);
        Ok(())
    }

    /// Names the file's only layer if it has no name. A file with several layers has a name for
    /// each.
    ///
    /// # Errors
    /// If what was written cannot be read.
    pub(crate) fn name_layer(&mut self, name: &str) -> Result<()> {
        if !self.draft.layer().name.is_empty() {
            return Ok(());
        }
        self.keep_metadata()?;
        let layer = CommitLayer { name: name.into(), ..self.draft.layer().clone() };
        let metadata = Metadata { name: name.into(), ..self.draft.metadata().clone() };
        self.set_draft(self.draft.commit.with_layer(self.draft.number, layer), metadata)
    }

    /// Renames the first layer to `name`, which no layer has, if either name is empty. An empty
    /// `name` leaves only that layer.
    ///
    /// # Errors
    /// If what was written cannot be read.
    pub(super) fn follow_name(&mut self, name: &str) -> Result<()> {
        let there = &self.draft.commit;
        let is_known = there.layer_named(name).is_some();
        if is_known || !(name.is_empty() || there.layers[0].name.is_empty()) {
            return Ok(());
        }
        self.keep_metadata()?;
        let mut commit = self.draft.commit.clone();
        commit.layers[0].name = name.into();
        if name.is_empty() {
            commit.layers.truncate(1);
        }
        commit.count();
        let tree = Autumnal::new(self.draft.archive.clone(), commit, 0)?;
        self.appender.set_tree(&tree);
        self.draft = Arc::new(tree);
        Ok(())
    }

    /// Adds a VOID layer and selects it.
    ///
    /// # Errors
    /// If there is a layer of that name, or it does not fit into the file's space.
    pub fn add_layer(&mut self, header: &Header, metadata: Metadata) -> Result<()> {
        check_plain(header, &self.draft.archive.extents.path)?;
        let file = &self.draft.archive.header;
        let name = &metadata.name;
        if header.form.dimension != file.dimension || header.depth() > file.depth {
            let found = format!("a {} of depth {}", header.form.dimension.tree_name(), header.depth());
            let expected = format!("a {} of at most depth {}", file.dimension.tree_name(), file.depth);
            return Err(Error::invalid("layer", found, expected));
        }
        if name.is_empty() || self.draft.commit.layer_named(name).is_some() {
            return Err(Error::invalid("layer name", format!("`{name}`"), "a name that no other layer has"));
        }
        self.keep_metadata()?;
        let number = self.draft.commit.layers.len();
        let commit = self.draft.commit.with_layer(number, void_layer(header, name));
        self.appender.flush()?;
        let tree = Autumnal::with_metadata(self.draft.archive.clone(), commit, number, metadata)?;
        self.appender.set_tree(&tree);
        self.draft = Arc::new(tree);
        Ok(())
    }

    /// Selects the layer with the name and the type of another one, and adds it if there is none.
    ///
    /// # Errors
    /// Those of [`Editor::select`] and [`Editor::add_layer`].
    pub(super) fn select_or_add(&mut self, header: &Header, metadata: &Metadata) -> Result<()> {
        let there = self.draft.commit.layer_named(&metadata.name);
        match there {
            Some(there) if self.draft.commit.layers[there].header[..] == header.to_bytes() => {
                self.select(&metadata.name)
            }
            // The layer of that name has another type.
            Some(_) if self.draft.commit.layers.len() == 1 => {
                let commit = self.draft.commit.with_layer(0, void_layer(header, &metadata.name));
                let tree = Autumnal::with_metadata(self.draft.archive.clone(), commit, 0, metadata.clone())?;
                self.appender.set_tree(&tree);
                self.draft = Arc::new(tree);
                Ok(())
            }
            Some(_) => {
                self.drop_layer(&metadata.name)?;
                self.add_layer(header, metadata.clone())
            }
            None => self.add_layer(header, metadata.clone()),
        }
    }

    /// Drops all layers that `commit` does not have, and puts the others into its order.
    pub(super) fn keep_only(&mut self, commit: &Commit) -> Result<()> {
        self.keep_metadata()?;
        let mut draft = self.draft.commit.clone();
        let named =
            |layer: &CommitLayer| draft.layer_named(&layer.name).map(|there| draft.layers[there].clone());
        let layers: Vec<CommitLayer> = commit.layers.iter().filter_map(named).collect();
        if layers == draft.layers {
            return Ok(());
        }
        draft.layers = layers;
        draft.count();
        let tree = Autumnal::new(self.draft.archive.clone(), draft, 0)?;
        self.appender.set_tree(&tree);
        self.draft = Arc::new(tree);
        Ok(())
    }

    /// Removes a layer and selects another one. Older commits keep the removed layer.
    ///
    /// # Errors
    /// If there is no layer of that name, or no other layer.
    pub fn drop_layer(&mut self, name: &str) -> Result<()> {
        if self.draft.commit.layer_named(name).is_none() {
            return Err(Error::invalid("layer", format!("`{name}`"), "the name of a layer of the file"));
        }
        self.select(name)?;
        let mut commit = self.draft.commit.clone();
        if commit.layers.len() == 1 {
            return Err(Error::unsupported(self.draft.path(), "dropping the only layer", "remove the file"));
        }
        commit.layers.remove(self.draft.number);
        commit.count();
        let tree = Autumnal::new(self.draft.archive.clone(), commit, 0)?;
        self.appender.set_tree(&tree);
        self.draft = Arc::new(tree);
        Ok(())
    }

    /// Returns the tree with all edits so far.
    pub fn tree(&self) -> Arc<Autumnal> {
        self.draft.clone()
    }

    /// Replaces the tree by a source, whose cells are rounded as `packing` specifies. The source
    /// must have the file's form and depth.
    ///
    /// # Errors
    /// If the form differs, if the source or writing fails, or on cancellation. After a failed
    /// write nothing more can be written; the last commit is intact.
    pub fn replace<S: ReusableSource>(
        &mut self,
        source: &S,
        packing: Packing,
        progress: &dyn Progress,
    ) -> Result<()> {
        let (form, expected) = (source.form(), self.draft.form());
        if form != expected {
            return Err(Error::invalid("source", form.to_string(), format!("{expected}, like the file")));
        }
        let options = self.options().packing(packing);
        let mut fill = |sink: &mut dyn TreeSink, shape| {
            walk(source, &options, (shape, CodeRange::ALL), true, sink, progress)
        };
        self.fill([u64::MAX; 3], &options, None, &mut fill).map(|_| ())
    }

    /// Returns the options for building blocks of the file.
    fn options(&self) -> BuildOptions {
        BuildOptions { share: self.draft.is_shared(), ..BuildOptions::like(self.draft.header(), self.memory) }
    }

    /// Replaces the tree by blocks that cover an extent; the rest is VOID. `twin` is a commit of
    /// another file with the same tree as this one.
    pub(super) fn fill(
        &mut self,
        covered: [u64; 3],
        options: &BuildOptions,
        twin: Option<&Autumnal>,
        fill: &mut Fill<'_>,
    ) -> Result<ZoneStats> {
        let base = self.draft.clone();
        // Invariant: records are appended, and a commit's records stay unchanged. The edited tree
        // is read from the same file while its new records are appended. So a source derived from
        // this tree can be traversed meanwhile, readers need no lock, and uncommitted records are
        // never visible.
        let mode = Mode::Write(&mut self.appender);
        let mut builder = RecordBuilder::new(&base, options, covered, mode, twin);
        fill(&mut builder, base.heights().shape())?;
        let (root, zone) = builder.finish();
        self.appender.flush()?;
        let (cells, inner_nodes) = (zone.tally.cells, zone.inner_nodes);
        let layer = CommitLayer { root, cells, inner_nodes, ..self.draft.layer().clone() };
        let commit = self.draft.commit.with_layer(self.draft.number, layer);
        self.set_draft(commit, self.draft.metadata().clone())?;
        Ok(zone.tally)
    }

    /// Reopens the draft on everything written so far.
    fn set_draft(&mut self, commit: Commit, metadata: Metadata) -> Result<()> {
        // (Commits made meanwhile can be reverted to.)
        let mut archive = Archive { meta: self.meta, ..self.draft.archive.clone() };
        let bytes = self.appender.backend.reader()?;
        // (Nothing may have been written since the last commit.)
        let end = self.appender.position().min(bytes.len());
        let packed = archive.extents.packed().cloned();
        archive.extents = Arc::new(Extents::new(self.draft.path(), bytes, end, true)?.with_packed(packed));
        self.draft = Arc::new(Autumnal::with_metadata(archive, commit, self.draft.number, metadata)?);
        Ok(())
    }

    /// Restores all layers and their metadata from another commit, or only the layer that was named
    /// at opening.
    ///
    /// # Errors
    /// If there is no such commit, it has no such layer or one of another type, or it cannot be
    /// read.
    pub fn revert(&mut self, number: u64) -> Result<()> {
        let old = self.draft.archive.commit(number)?;
        if !self.is_named && (old.layers.len() > 1 || self.draft.commit.layers.len() > 1) {
            let (layers, cells, inner_nodes) = (old.layers, old.cells, old.inner_nodes);
            let commit = Commit { layers, cells, inner_nodes, ..self.draft.commit.clone() };
            let tree = Autumnal::new(self.draft.archive.clone(), commit, 0)?;
            self.appender.set_tree(&tree);
            self.draft = Arc::new(tree);
            return Ok(());
        }
        let now = self.draft.layer();
        let Some(there) = old.layer_named(&now.name).filter(|there| old.layers[*there].header == now.header)
        else {
            let found = format!("no layer `{}` of the same type", now.name);
            let expected = "that layer in the commit";
            return Err(Error::invalid(format!("commit {number}"), found, expected));
        };
        let tree = Autumnal::new(self.draft.archive.clone(), old, there)?;
        let metadata = tree.metadata().clone();
        let commit = self.draft.commit.with_layer(self.draft.number, tree.layer().clone());
        self.set_draft(commit, metadata)
    }

    /// Replaces the metadata.
    ///
    /// # Errors
    /// If what was written cannot be read.
    pub(crate) fn set_metadata(&mut self, metadata: Metadata) -> Result<()> {
        self.set_draft(self.draft.commit.clone(), metadata)
    }

    /// Commits all edits so far. The commit is durable when this returns. Returns `None` if nothing
    /// differs from the newest commit.
    ///
    /// # Errors
    /// If writing fails. Then it is unknown whether the commit is durable: the next editor finds
    /// out, and this one writes nothing more.
    pub fn commit(&mut self, note: Note) -> Result<Option<Commit>> {
        let number = self.newest.as_ref().map_or(Ok(1), |newest| self.after(newest.number))?;
        self.keep_metadata()?;
        let is_newest = |newest: &Commit| newest.layers == self.draft.commit.layers;
        if self.newest.as_ref().is_some_and(is_newest) {
            return Ok(None);
        }
        self.write_commit(number, note, WriteSummary::default()).map(Some)
    }

    /// Commits all edits so far, even if nothing differs from the newest commit. `number` must be
    /// larger than the newest commit's.
    ///
    /// # Errors
    /// Those of [`Editor::commit`].
    pub(super) fn commit_as(&mut self, number: u64, note: Note) -> Result<Commit> {
        self.keep_metadata()?;
        self.write_commit(number, note, WriteSummary::default())
    }

    /// Packs all further records if the file permits it.
    pub(super) fn pack(&mut self) -> Result<()> {
        let Some(reader) = self.draft.extents().packed().cloned() else { return Ok(()) };
        let run_levels = self.draft.archive.form.run_levels;
        self.appender.pack(PackedWriter::new(self.draft.header(), run_levels), reader)
    }

    /// Writes all edits so far as the state of a future commit, with its write summary; see
    /// [`Editor::commit_state`].
    ///
    /// # Errors
    /// If writing fails.
    pub(super) fn state(&mut self) -> Result<Commit> {
        self.keep_metadata()?;
        let written = self.written();
        self.begin = self.appender.position();
        self.appender.written = WriteSummary::default();
        let state = Commit { written, ..self.draft.commit.clone() };
        self.state = Some(state.clone());
        Ok(state)
    }

    /// Commits a state. `number` must be larger than the newest commit's.
    ///
    /// # Errors
    /// Those of [`Editor::commit`].
    pub(super) fn commit_state(&mut self, state: Commit, number: u64, note: Note) -> Result<Commit> {
        let tree = Autumnal::new(self.draft.archive.clone(), state, 0)?;
        self.appender.set_tree(&tree);
        let written = tree.commit.written;
        self.draft = Arc::new(tree);
        self.write_commit(number, note, written)
    }

    /// Returns the summary of what was written and belongs to no commit or state yet.
    fn written(&self) -> WriteSummary {
        WriteSummary { bytes: self.appender.position() - self.begin, ..self.appender.written }
    }

    /// Returns `number + 1`, or an error if it overflows.
    fn after(&self, number: u64) -> Result<u64> {
        let next = number.checked_add(1);
        next.ok_or_else(|| {
            self.draft.extents().corrupt("commit", format!("number {number}"), "a smaller number")
        })
    }

    /// Writes a commit. `earlier` summarizes what was written for it before.
    fn write_commit(&mut self, number: u64, mut note: Note, earlier: WriteSummary) -> Result<Commit> {
        // (Messages contain the names of inputs, which may be URLs with credentials.)
        if let Cow::Owned(clean) = redacted(&note.message) {
            note.message = clean;
        }
        let draft = self.draft.clone();
        let previous = self.newest.as_ref().map_or(0, |_| self.meta.commit);
        let jump =
            self.newest.as_ref().map_or(Ok((0, 0)), |newest| newest.next_jump(draft.extents(), previous))?;
        let written = self.written().and(earlier);
        let commit = Commit {
            number,
            note,
            written,
            sequence: self.after(self.meta.sequence)?,
            previous,
            jump,
            ..draft.commit.clone()
        };
        self.meta = self.appender.commit(&commit)?;
        self.begin = self.appender.position();
        self.newest = Some(commit.clone());
        self.set_draft(commit.clone(), draft.metadata().clone())?;
        Ok(commit)
    }

    /// Writes the layer's metadata unless they equal the newest commit's.
    fn keep_metadata(&mut self) -> Result<()> {
        let draft = self.draft.clone();
        let bytes = draft.metadata().to_bytes(draft.path())?;
        let there = self.newest.as_ref().or(self.state.as_ref()).and_then(|newest| {
            newest.layer_named(&draft.layer().name).map(|number| newest.layers[number].metadata)
        });
        let metadata = match there {
            Some(there) if draft.extents().whole(ExtentKind::Metadata, there)?[..] == bytes => there,
            _ => self.appender.extent(ExtentKind::Metadata, &bytes)?,
        };
        self.appender.flush()?;
        let layer = CommitLayer { metadata, ..draft.layer().clone() };
        self.set_draft(draft.commit.with_layer(draft.number, layer), draft.metadata().clone())
    }

    /// Returns the newest commit.
    pub fn newest(&self) -> Option<&Commit> {
        self.newest.as_ref()
    }
}

/// Returns a layer without cells.
fn void_layer(header: &Header, name: &str) -> CommitLayer {
    let root = Root { state: VOID, value: Vec::new(), address: 0 };
    CommitLayer {
        name: name.into(),
        cells: 0,
        inner_nodes: 0,
        header: header.to_bytes().to_vec(),
        root,
        metadata: 0,
    }
}

/// Returns the backend's current bytes and the identity of its file.
pub(super) fn open_file(backend: &dyn WriteBackend) -> Result<OpenFile> {
    Ok((backend.reader()?, backend.id()))
}
