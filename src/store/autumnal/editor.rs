//! Edits a file: one writer at a time, any number of edits, then a commit.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::append::Appender;
use super::archive::{Archive, first_page, pointer_bytes};
use super::commit::{Commit, Note, Root, Written};
use super::extents::{ExtentKind, Extents, FIRST, PAGE};
use super::form::Form;
use super::grow::{Grow, Sink, shape};
use super::lock::lock;
use super::medium::{FileMedium, Medium};
use super::meta::Meta;
use super::reader::Autumnal;
use crate::store::build::{Assembly, BuildOptions, Fill, walk};
use crate::store::goblin::{Header, Layout, Metadata, VOID};
use crate::tree::Source;
use crate::value::{Tally, Value};
use crate::{Error, Progress, Result};

/// A file that is being edited by this process and by nobody else.
///
/// [`Editor::tree`] is the tree with all edits so far; edits are sources made of it (see [`crate::ops`]), which
/// [`Editor::replace`] makes the tree. Where a source hands out nodes of the file as they are, these are kept and not
/// looked into: an edit takes time and room proportional to what changes, plus the tree's depth. Nothing is seen by
/// readers before [`Editor::commit`]; what is not committed is as if it had never been.
pub struct Editor<D: Layout, V: Value> {
    appender: Appender,
    /// With all edits so far.
    draft: Arc<Autumnal<D, V>>,
    /// The newest commit, and where it is.
    newest: Option<Commit>,
    meta: Meta,
    /// Where what is not committed begins.
    begin: u64,
    memory: u64,
}

impl<D: Layout, V: Value> Editor<D, V> {
    /// Opens a file to edit it. `memory` is what edits may use.
    ///
    /// # Errors
    /// If another process edits the file, it cannot be written, or as [`Autumnal::open`].
    pub fn open(path: &Path, memory: u64) -> Result<Self> {
        let file =
            std::fs::File::options().read(true).write(true).open(path).map_err(Error::io(path, "open"))?;
        let mut medium = FileMedium::new(file, path);
        // Nothing is written to what is no Autumnal file.
        Archive::open(path, || medium.storage(), medium.id(), true)?;
        lock(&mut medium)?;
        Self::on(Box::new(medium), path, memory)
    }

    /// The same on any medium; `path` is for messages. Whoever calls sees to it that there is one editor.
    ///
    /// # Errors
    /// As [`Editor::open`].
    pub fn on(mut medium: Box<dyn Medium>, path: &Path, memory: u64) -> Result<Self> {
        let archive = Archive::open(path, || medium.storage(), medium.id(), true)?;
        // Perhaps the newest slot was written and never became durable: what comes next stands on it.
        let meta = archive.meta;
        medium.write(meta.place(), &meta.to_bytes()).map_err(Error::io(path, "write the meta slot"))?;
        medium.sync().map_err(Error::io(path, "sync"))?;
        let newest = archive.newest()?;
        let share = archive.share.then_some(memory / 4);
        let appender = Appender::new(medium, path.to_path_buf(), archive.form.clone(), meta.end, share);
        let draft = Arc::new(Autumnal::new(archive, newest.clone())?);
        Ok(Editor { begin: appender.position(), appender, draft, newest: Some(newest), meta, memory })
    }

    /// Starts a file on an empty medium: a tree that is VOID, in no commit yet.
    ///
    /// # Errors
    /// If the medium cannot be written.
    pub(super) fn create(
        mut medium: Box<dyn Medium>,
        path: PathBuf,
        header: Header,
        options: &BuildOptions,
    ) -> Result<Self> {
        let (near, far) = pointer_bytes(options.share);
        let form = Form::new(&header, near, far);
        let mut page = first_page(&header, &form, options.share);
        page.resize(FIRST as usize, 0);
        medium.write(0, &page).map_err(Error::io(&*path, "write the header"))?;
        let meta = Meta { sequence: 0, commit: 0, end: FIRST };
        let extents = Arc::new(Extents::new(&path, medium.storage()?, FIRST, true));
        let archive =
            Archive { header, form: form.clone(), share: options.share, extents, meta, file: medium.id() };
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
        let appender = Appender::new(medium, path, form, FIRST, share);
        Ok(Editor { begin: FIRST, appender, draft, newest: None, meta, memory: options.memory })
    }

    /// The tree with all edits so far.
    pub fn tree(&self) -> Arc<Autumnal<D, V>> {
        self.draft.clone()
    }

    /// Makes a source the tree. Its depth must be the file's.
    ///
    /// # Errors
    /// If the source or writing fails, or on interruption. After a failed write nothing more can be written; the last
    /// commit is whole.
    pub fn replace<S>(&mut self, source: &S, progress: &dyn Progress) -> Result<()>
    where
        S: Source<Dim = D, Value = V> + Sync,
    {
        let options = self.options();
        let mut fill = |assembly: &mut dyn Assembly<D, V>, shape| {
            walk(source, &options, shape, true, assembly, progress)
        };
        self.fill([u64::MAX; 3], &options, None, &mut fill).map(|_| ())
    }

    /// How blocks of the file are built.
    fn options(&self) -> BuildOptions {
        BuildOptions { share: self.draft.is_shared(), ..BuildOptions::like(self.draft.header(), self.memory) }
    }

    /// Makes the tree of parts, which cover some extent; the rest is VOID. `twin` is a commit of another file with the
    /// tree that this one has.
    pub(super) fn fill(
        &mut self,
        covered: [u64; 3],
        options: &BuildOptions,
        twin: Option<&Autumnal<D, V>>,
        fill: &mut Fill<'_, D, V>,
    ) -> Result<Tally<V>> {
        let base = self.draft.clone();
        let mut grow = Grow::new(options, covered, Sink::Append(&mut self.appender), Some(&base), twin);
        fill(&mut grow, shape::<D>(options.depth))?;
        let (root, zone) = grow.finish();
        self.appender.flush()?;
        let commit =
            Commit { root, cells: zone.tally.cells, records: zone.records, ..self.draft.commit.clone() };
        self.set_draft(commit, self.draft.metadata().clone())?;
        Ok(zone.tally)
    }

    /// What is written so far can be read.
    fn set_draft(&mut self, commit: Commit, metadata: Metadata) -> Result<()> {
        let mut archive = self.draft.archive.clone();
        let storage = self.appender.medium.storage()?;
        // (Nothing may be written since the last commit.)
        let end = self.appender.position().min(storage.len());
        let path = archive.extents.path.clone();
        archive.extents = Arc::new(Extents::new(&path, storage, end, true));
        self.draft = Arc::new(Autumnal::with_metadata(archive, commit, metadata)?);
        Ok(())
    }

    /// Makes the tree what it was in another commit; its metadata, too.
    ///
    /// # Errors
    /// If there is no such commit, or it cannot be read.
    pub fn revert(&mut self, number: u64) -> Result<()> {
        let old = self.draft.archive.commit(number)?;
        let tree = Autumnal::<D, V>::new(self.draft.archive.clone(), old)?;
        let metadata = tree.metadata().clone();
        let old = tree.commit;
        let commit =
            Commit { root: old.root, cells: old.cells, records: old.records, ..self.draft.commit.clone() };
        self.set_draft(commit, metadata)
    }

    /// Tells other things about the data.
    ///
    /// # Errors
    /// If what was written cannot be read.
    pub fn set_metadata(&mut self, metadata: Metadata) -> Result<()> {
        self.set_draft(self.draft.commit.clone(), metadata)
    }

    /// Makes all edits so far a commit, durable before this returns; `None` if there is nothing that differs from the
    /// newest commit.
    ///
    /// # Errors
    /// If writing fails. Then it is not known whether the commit is durable: the next editor finds out. This one writes
    /// nothing more.
    pub fn commit(&mut self, note: Note) -> Result<Option<Commit>> {
        let number = self.newest.as_ref().map_or(1, |newest| newest.number + 1);
        self.commit_as(number, note)
    }

    /// The same with any number that is larger than the newest commit's.
    pub(super) fn commit_as(&mut self, number: u64, note: Note) -> Result<Option<Commit>> {
        let draft = self.draft.clone();
        let metadata = self.metadata_place(&draft)?;
        let is_newest = |newest: &Commit| draft.commit.root == newest.root && metadata == newest.metadata;
        if self.newest.as_ref().is_some_and(is_newest) {
            return Ok(None);
        }
        let previous = self.newest.as_ref().map_or(0, |_| self.meta.commit);
        let jump =
            self.newest.as_ref().map_or(Ok((0, 0)), |newest| newest.next_jump(draft.extents(), previous))?;
        let written = Written { bytes: self.appender.position() - self.begin, ..self.appender.written };
        let commit = Commit {
            number,
            note,
            written,
            sequence: self.meta.sequence + 1,
            metadata,
            previous,
            jump,
            ..draft.commit.clone()
        };
        self.meta = self.appender.commit(&commit)?;
        self.begin = self.appender.position();
        self.newest = Some(commit.clone());
        self.set_draft(commit.clone(), draft.metadata().clone())?;
        Ok(Some(commit))
    }

    /// Where the metadata are; writes them if they are not those of the newest commit.
    fn metadata_place(&mut self, draft: &Autumnal<D, V>) -> Result<u64> {
        let path = draft.path();
        let bytes = draft.metadata().to_bytes(path)?;
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

const _: () = assert!(FIRST.is_multiple_of(PAGE));
