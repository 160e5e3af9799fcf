//! The files of an updated index: they are compared with its sources, and those that were changed
//! or added are opened.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::names::name_in_index;
use super::super::{RecordedChunks, RecordedImage, RecordedSource, SourceRecorder};
use super::{IndexUpdate, UpdateReport, is_of_virtual_raster, refused};
use crate::import::{ImportHistory, RasterInfo, RasterOptions, check_pages, open};
use spinney_base::io::{FileAccess, FileStat, listed_path};
use spinney_base::{Error, Result};
use spinney_engine::store::goblin::Goblin;
use spinney_references::{Chunk, IndexContents, IndexedFile, IndexedSource, PixelRule, SourceImage};

/// A file of an updated index.
pub(super) struct UpdatedFile {
    /// Number in the recorder.
    pub(super) number: usize,
    pub(super) path: PathBuf,
    /// Page of a file of several.
    page: Option<usize>,
    /// Position among the listed files; 0 without a list.
    pub(super) position: usize,
    /// Properties of a file that was changed or added. (The file is closed again, since there may
    /// be more files than a process may have open.)
    pub(super) info: Option<RasterInfo>,
}

/// The files of an updated index.
pub(super) struct UpdatedFiles {
    /// Files by number in the old index; `None` if the file was removed.
    pub(super) kept: Vec<Option<UpdatedFile>>,
    /// Files that were added, from the bottom to the top.
    pub(super) added: Vec<UpdatedFile>,
    /// Whether all files were listed.
    pub(super) is_listed: bool,
    /// Whether beginnings of names were replaced.
    pub(super) are_moved: bool,
}

/// Finds the files of an updated index.
pub(super) struct FileFinder<'a> {
    pub(super) index: &'a Path,
    pub(super) access: &'a FileAccess,
    pub(super) recorder: &'a Arc<SourceRecorder>,
    pub(super) update: &'a IndexUpdate,
}

impl FileFinder<'_> {
    /// Compares the sources with the files, and reads the headers of those that were changed or
    /// added.
    pub(super) fn find(
        &self,
        contents: &IndexContents,
        layers: &[Goblin],
        report: &mut UpdateReport,
    ) -> Result<UpdatedFiles> {
        if self.update.sources.as_ref().is_some_and(Vec::is_empty) {
            return Err(Error::invalid("sources", "none", "all files that the index has afterwards"));
        }
        let has = |prefix: &str| contents.sources.iter().any(|(source, _)| source.name.starts_with(prefix));
        if let Some((unused, _)) = self.update.prefixes.iter().find(|(old, _)| !has(old)) {
            let expected = "the beginning of a source's name (see `spinney info`)";
            return Err(Error::invalid("source prefix", format!("`{unused}`"), expected));
        }
        let names: Vec<String> =
            contents.sources.iter().map(|(source, _)| self.moved(&source.name)).collect();
        // (The last position of a file that is listed twice: there it covers the others.)
        let mut listed: HashMap<String, usize> = HashMap::new();
        let sources = self.update.sources.as_deref();
        for (position, path) in sources.unwrap_or_default().iter().enumerate() {
            listed.insert(name_in_index(self.index, path)?, position);
        }
        let path_of = |name: &String| match (sources, listed.get(name)) {
            (Some(sources), Some(position)) => Ok(sources[*position].clone()),
            _ => listed_path(self.index, name),
        };
        let paths = names.iter().map(path_of).collect::<Result<Vec<_>>>()?;
        let stats = self.access.stat(&paths.iter().map(|path| &**path).collect::<Vec<_>>())?;
        self.check_virtual_rasters(contents)?;
        let pages = pages(contents, layers);
        let mut page_counts: HashMap<&String, usize> = HashMap::new();
        names.iter().for_each(|name| *page_counts.entry(name).or_default() += 1);
        let mut kept = Vec::new();
        for (at, ((source, chunks), stat)) in contents.sources.iter().zip(stats).enumerate() {
            let (name, path) = (&names[at], &paths[at]);
            if sources.is_some() && !listed.contains_key(name) {
                report.removed += 1;
                kept.push(None);
                continue;
            }
            let stat = stat?.ok_or_else(|| {
                let doing = "find, a source of the index; `spinney index --update INDEX FILES` makes one of other files";
                Error::io(path, doing)(std::io::Error::new(std::io::ErrorKind::NotFound, "no such file"))
            })?;
            let (number, info) = if stat == source.stat() {
                report.unchanged += 1;
                (self.recorder.add(recorded(path, source, chunks, contents, stat)), None)
            } else {
                report.changed += 1;
                let count = page_counts[name];
                if count > 1 && source.page == 0 {
                    self.check_page_count(path, count)?;
                }
                let (number, info) = self.opened(path, pages[at])?;
                (number, Some(info))
            };
            let position = listed.get(name).copied().unwrap_or_default();
            kept.push(Some(UpdatedFile { number, path: path.clone(), page: pages[at], position, info }));
        }
        let known: HashSet<&String> = names.iter().collect();
        let mut new: Vec<usize> =
            listed.iter().filter(|(name, _)| !known.contains(name)).map(|(_, position)| *position).collect();
        new.sort_unstable();
        // A new index would read the page that the user chose of every file.
        let page = pages.first().copied().flatten();
        let add = |position: usize| {
            let path = sources.unwrap_or_default()[position].clone();
            let (number, info) = self.opened(&path, page)?;
            Ok(UpdatedFile { number, path, page, position, info: Some(info) })
        };
        let added = new.into_iter().map(add).collect::<Result<Vec<_>>>()?;
        report.added = added.len();
        let are_moved = !self.update.prefixes.is_empty();
        Ok(UpdatedFiles { kept, added, is_listed: sources.is_some(), are_moved })
    }

    /// Checks that virtual rasters still arrange the sources as before. (Those that are missing are
    /// not needed.)
    fn check_virtual_rasters(&self, contents: &IndexContents) -> Result<()> {
        let path = |file: &IndexedFile| listed_path(self.index, &self.moved(&file.name));
        let paths = contents.virtual_rasters.iter().map(path).collect::<Result<Vec<_>>>()?;
        let found = self.access.stat(&paths.iter().map(|path| &**path).collect::<Vec<_>>())?;
        for ((file, path), found) in contents.virtual_rasters.iter().zip(paths).zip(found) {
            if found?.is_some_and(|found| !found.agrees(&file.stat())) {
                return Err(refused(&path, "a virtual raster that was changed"));
            }
            self.recorder.record_virtual(&path, file.stat());
        }
        Ok(())
    }

    /// Returns the properties of a file, which is not recorded.
    pub(super) fn properties(&self, file: &UpdatedFile) -> Result<RasterInfo> {
        Ok(open(&file.path, &self.options(file.page))?.info().clone())
    }

    /// Records a file; returns its number and its properties.
    fn opened(&self, path: &Path, page: Option<usize>) -> Result<(usize, RasterInfo)> {
        let recorder = Some(self.recorder.clone());
        let raster = open(path, &RasterOptions { recorder, ..self.options(page) })?;
        check_pages(&*raster)?;
        match raster.source_windows().as_deref() {
            // (Virtual rasters have rules.)
            Ok([window]) if window.rule == PixelRule::default() => Ok((window.source, raster.info().clone())),
            _ => {
                let found = "a source that is not a TIFF file, or has a mask file,";
                let advice = "index it by itself, or build a tree (`spinney build`)";
                Err(Error::unsupported(path, found, advice))
            }
        }
    }

    /// Checks that a file whose pages are layers has as many pages as before.
    fn check_page_count(&self, path: &Path, before: usize) -> Result<()> {
        match open(path, &self.options(None))?.info().pages {
            pages if pages == before => Ok(()),
            pages => Err(refused(path, format!("a source of {pages} pages, which had {before} before"))),
        }
    }

    fn options(&self, page: Option<usize>) -> RasterOptions {
        // As in an import, half of the memory is for reading.
        let memory = self.update.memory / 2;
        RasterOptions { memory, page, access: self.access.clone(), ..RasterOptions::default() }
    }

    /// Returns the name of a source after the replacement of prefixes.
    fn moved(&self, name: &str) -> String {
        let prefixes = &self.update.prefixes;
        let found = prefixes.iter().find_map(|(old, new)| Some((new, name.strip_prefix(old.as_str())?)));
        found.map_or_else(|| name.to_string(), |(new, rest)| format!("{new}{rest}"))
    }
}

/// Returns the page of each source to open it with; `None` if the file must have only one.
fn pages(contents: &IndexContents, layers: &[Goblin]) -> Vec<Option<usize>> {
    let page = |source: &IndexedSource| source.page as usize;
    let mut pages: Vec<Option<usize>> =
        contents.sources.iter().map(|(source, _)| Some(page(source)).filter(|page| *page > 0)).collect();
    for (layer, placements) in layers.iter().zip(&contents.layers) {
        let has_page = ImportHistory::of(&layer.metadata().provenance).option("page").is_some();
        for placement in placements {
            // (A virtual raster takes the first page of its sources.)
            if has_page || is_of_virtual_raster(&contents.rules[placement.rule as usize]) {
                let source = placement.source as usize;
                pages[source] = Some(page(&contents.sources[source].0));
            }
        }
    }
    pages
}

/// Returns the record of a file that was not changed, from the index.
fn recorded(
    path: &Path,
    source: &IndexedSource,
    [chunks, mask]: &[Vec<Chunk>; 2],
    contents: &IndexContents,
    stat: FileStat,
) -> RecordedSource {
    let image = |image: &SourceImage, chunks: &[Chunk]| RecordedImage {
        format: contents.formats[image.format as usize].clone(),
        chunks: Arc::new(RecordedChunks::known(chunks)),
    };
    RecordedSource {
        path: path.to_path_buf(),
        stat,
        page: source.page,
        size: source.size,
        image: image(&source.image, chunks),
        mask: source.mask.as_ref().map(|of_mask| image(of_mask, mask)),
        hole: source.hole.clone(),
    }
}
