//! Edits a file: one writer at a time, any number of edits, then a commit.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::append::Appender;
use super::archive::{Archive, OpenFile, first_page};
use super::builder::{Mode, RecordBuilder};
use super::commit::{Commit, Note, Root, Written};
use super::extents::{ExtentKind, Extents};
use super::layout::{PointeredLayout, run_levels};
use super::meta::Meta;
use super::newest::Newest;
use super::pages::FIRST_EXTENT;
use super::reader::Autumnal;
use crate::store::builder::{BuildOptions, Fill, ReusableSource, TreeSink, walk};
use crate::tree::Source;
use spinney_base::io::{FileBackend, LockedFile, WriteBackend};
use spinney_base::value::Tally;
use spinney_base::{Error, Progress, Result};
use spinney_container::{Header, Metadata, VOID};

/// A file that is being edited by this process and by nobody else, until this is dropped.
///
/// [`Editor::tree`] is the tree with all edits so far; edits are sources made of it (see [`crate::ops`]),
/// which becomes the tree ([`apply_edits`](crate::ops::apply_edits)). Where a source hands out nodes of the file as they are, these
/// are kept and not looked into: an edit takes time and room proportional to what changes, plus the tree's
/// depth. Nothing is seen by readers before [`Editor::commit`]; what is not committed is as if it had never
/// been.
pub struct Editor {
    appender: Appender,
    /// The tree with all edits so far.
    draft: Arc<Autumnal>,
    newest: Option<Commit>,
    /// The meta slot of the newest commit.
    meta: Meta,
    /// Offset at which what is not committed begins.
    begin: u64,
    /// Bytes that edits may use.
    memory: u64,
}

impl Editor {
    /// Opens a file to edit it. `memory` is what edits may use.
    ///
    /// # Errors
    /// If another process edits the file, it cannot be written, or as [`Autumnal::open`].
    pub fn open(path: &Path, memory: u64) -> Result<Editor> {
        let file = File::options().read(true).write(true).open(path).map_err(Error::io(path, "open"))?;
        let file = FileBackend::new(file, path);
        // Nothing is written to what is no Autumnal file.
        Archive::open(path, &|| open_file(&file), true)?;
        Editor::on(Box::new(LockedFile::new(file)?), path, memory)
    }

    /// Edits what any backend has; `path` is for messages. Whoever calls sees to it that there is one editor.
    ///
    /// # Errors
    /// As [`Editor::open`].
    pub fn on(mut backend: Box<dyn WriteBackend>, path: &Path, memory: u64) -> Result<Editor> {
        // Between opening the file and locking it another one may have taken its place.
        backend.check_path()?;
        let archive = Archive::open(path, &|| open_file(&*backend), true)?;
        // Nothing is written to a file whose newest commit is damaged: it would be lost for good.
        let newest = archive.newest()?;
        // Invariant: the newest commit's slot is durable before anything else is written. Perhaps it was
        // written and never became that: then the next commit, which takes the other slot, would overwrite
        // the only one that is sure to be on the disk.
        let meta = archive.meta;
        backend.write(meta.offset(), &meta.to_bytes()).map_err(Error::io(path, "write the meta slot"))?;
        backend.sync().map_err(Error::io(path, "sync"))?;
        let share = archive.share.then_some(memory / 4);
        let appender = Appender::new(backend, path.to_path_buf(), archive.layout.clone(), meta.end, share);
        let draft = Arc::new(Autumnal::new(archive, newest.clone())?);
        Ok(Editor { begin: appender.position(), appender, draft, newest: Some(newest), meta, memory })
    }

    /// Starts a file on an empty backend: a tree that is VOID, in no commit yet.
    ///
    /// # Errors
    /// If the backend cannot be written.
    pub(super) fn create(
        mut backend: Box<dyn WriteBackend>,
        path: PathBuf,
        header: Header,
        options: &BuildOptions,
    ) -> Result<Editor> {
        let levels = run_levels(header.form.dimension);
        // The fewer levels a record has, the more of them are equal.
        let levels = if options.share { *levels.start() } else { *levels.end() };
        let layout = PointeredLayout::new(header.form, levels, header.depth());
        let mut pages = first_page(&header, options.share, layout.heights);
        pages.resize(FIRST_EXTENT as usize, 0);
        backend.write(0, &pages).map_err(Error::io(&*path, "write the header"))?;
        let (bytes, file) = open_file(&*backend)?;
        let meta = Meta { sequence: 0, commit: 0, end: FIRST_EXTENT };
        let extents = Arc::new(Extents::new(&path, bytes, FIRST_EXTENT, true)?);
        let archive = Archive {
            header,
            layout: layout.clone(),
            share: options.share,
            extents,
            meta,
            newest: Newest::Good,
            file,
        };
        let commit = Commit {
            number: 0,
            note: Note::default(),
            cells: 0,
            records: 0,
            written: Written::default(),
            sequence: 0,
            root: Root { state: VOID, value: Vec::new(), address: 0 },
            metadata: 0,
            previous: 0,
            jump: (0, 0),
        };
        let draft = Arc::new(Autumnal::with_metadata(archive, commit, options.metadata.clone())?);
        let share = options.share.then_some(options.memory / 4);
        let appender = Appender::new(backend, path, layout, FIRST_EXTENT, share);
        Ok(Editor { begin: FIRST_EXTENT, appender, draft, newest: None, meta, memory: options.memory })
    }

    /// The tree with all edits so far.
    pub fn tree(&self) -> Arc<Autumnal> {
        self.draft.clone()
    }

    /// Makes a source the tree. Its form and depth must be the file's.
    ///
    /// # Errors
    /// If they are not, the source or writing fails, or on interruption. After a failed write nothing more
    /// can be written; the last commit is whole.
    pub fn replace<S: ReusableSource>(&mut self, source: &S, progress: &dyn Progress) -> Result<()> {
        let (form, expected) = (source.form(), self.draft.form());
        if form != expected {
            return Err(Error::invalid("source", form.to_string(), format!("{expected}, as the file")));
        }
        let options = self.options();
        let mut fill = |sink: &mut dyn TreeSink, shape| walk(source, &options, shape, true, sink, progress);
        self.fill([u64::MAX; 3], &options, None, &mut fill).map(|_| ())
    }

    /// Options for building blocks of the file.
    fn options(&self) -> BuildOptions {
        BuildOptions { share: self.draft.is_shared(), ..BuildOptions::like(self.draft.header(), self.memory) }
    }

    /// Makes the tree of parts, which cover some extent; the rest is VOID. `twin` is a commit of another file
    /// with the tree that this one has.
    pub(super) fn fill(
        &mut self,
        covered: [u64; 3],
        options: &BuildOptions,
        twin: Option<&Autumnal>,
        fill: &mut Fill<'_>,
    ) -> Result<Tally> {
        let base = self.draft.clone();
        // Invariant: records are appended, and what a commit has stays as it is: the tree that is edited is
        // read from the same file while its new records are written behind it. So a source made of this tree
        // may be gone through meanwhile, readers need no lock, and what is not committed has never been.
        let mode = Mode::Write(&mut self.appender);
        let mut builder = RecordBuilder::new(&base, options, covered, mode, twin);
        fill(&mut builder, base.heights().shape())?;
        let (root, zone) = builder.finish();
        self.appender.flush()?;
        let commit =
            Commit { root, cells: zone.tally.cells, records: zone.records, ..self.draft.commit.clone() };
        self.set_draft(commit, self.draft.metadata().clone())?;
        Ok(zone.tally)
    }

    /// Makes the draft a tree of what is written so far.
    fn set_draft(&mut self, commit: Commit, metadata: Metadata) -> Result<()> {
        let mut archive = self.draft.archive.clone();
        let bytes = self.appender.backend.reader()?;
        // (Nothing may be written since the last commit.)
        let end = self.appender.position().min(bytes.len());
        archive.extents = Arc::new(Extents::new(self.draft.path(), bytes, end, true)?);
        self.draft = Arc::new(Autumnal::with_metadata(archive, commit, metadata)?);
        Ok(())
    }

    /// Makes the tree what it was in another commit; its metadata, too.
    ///
    /// # Errors
    /// If there is no such commit, or it cannot be read.
    pub fn revert(&mut self, number: u64) -> Result<()> {
        let old = self.draft.archive.commit(number)?;
        let tree = Autumnal::new(self.draft.archive.clone(), old)?;
        let metadata = tree.metadata().clone();
        let old = tree.commit;
        let commit =
            Commit { root: old.root, cells: old.cells, records: old.records, ..self.draft.commit.clone() };
        self.set_draft(commit, metadata)
    }

    /// Replaces the metadata.
    ///
    /// # Errors
    /// If what was written cannot be read.
    pub(crate) fn set_metadata(&mut self, metadata: Metadata) -> Result<()> {
        self.set_draft(self.draft.commit.clone(), metadata)
    }

    /// Makes all edits so far a commit, durable before this returns; `None` if there is nothing that differs
    /// from the newest commit.
    ///
    /// # Errors
    /// If writing fails. Then it is not known whether the commit is durable: the next editor finds out. This
    /// one writes nothing more.
    pub fn commit(&mut self, note: Note) -> Result<Option<Commit>> {
        let number = self.newest.as_ref().map_or(Ok(1), |newest| self.after(newest.number))?;
        let metadata = self.metadata_offset()?;
        let root = &self.draft.commit.root;
        let is_newest = |newest: &Commit| *root == newest.root && metadata == newest.metadata;
        if self.newest.as_ref().is_some_and(is_newest) {
            return Ok(None);
        }
        self.write_commit(number, note, metadata).map(Some)
    }

    /// Makes all edits so far a commit, whether they differ from the newest one or not, with any number that is larger
    /// than the newest one's.
    ///
    /// # Errors
    /// Those of [`Editor::commit`].
    pub(super) fn commit_as(&mut self, number: u64, note: Note) -> Result<Commit> {
        let metadata = self.metadata_offset()?;
        self.write_commit(number, note, metadata)
    }

    /// The number after one that the file has.
    fn after(&self, number: u64) -> Result<u64> {
        let next = number.checked_add(1);
        next.ok_or_else(|| {
            self.draft.extents().corrupt("commit", format!("number {number}"), "one that has a next one")
        })
    }

    fn write_commit(&mut self, number: u64, note: Note, metadata: u64) -> Result<Commit> {
        let draft = self.draft.clone();
        let previous = self.newest.as_ref().map_or(0, |_| self.meta.commit);
        let jump =
            self.newest.as_ref().map_or(Ok((0, 0)), |newest| newest.next_jump(draft.extents(), previous))?;
        let written = Written { bytes: self.appender.position() - self.begin, ..self.appender.written };
        let commit = Commit {
            number,
            note,
            written,
            sequence: self.after(self.meta.sequence)?,
            metadata,
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

    /// Offset of the metadata; writes them if they are not those of the newest commit.
    fn metadata_offset(&mut self) -> Result<u64> {
        let draft = self.draft.clone();
        let bytes = draft.metadata().to_bytes(draft.path())?;
        if let Some(newest) = &self.newest
            && draft.extents().whole(ExtentKind::Metadata, newest.metadata)?[..] == bytes
        {
            return Ok(newest.metadata);
        }
        self.appender.extent(ExtentKind::Metadata, &bytes)
    }

    /// The newest commit.
    pub fn newest(&self) -> Option<&Commit> {
        self.newest.as_ref()
    }
}

/// The bytes that a backend has now, and which file it is.
pub(super) fn open_file(backend: &dyn WriteBackend) -> Result<OpenFile> {
    Ok((backend.reader()?, backend.id()))
}
