//! Many files as one tree, as listed in a manifest.

mod files;
mod index;
mod level;
mod list;
mod source;
mod tallies;

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use self::files::{OpenFiles, open_listed};
use self::index::Index;
use self::tallies::Tallies;
use super::blocks::Blocks;
use super::tree_file::TreeFile;
use crate::store::goblin::{Goblin, GoblinNode};
use spinney_base::io::FileAccess;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::Rule;
use spinney_base::{Progress, Result};
use spinney_container::{Finding, Header, MAX_FINDINGS, Metadata, OpenOptions};
use spinney_manifest::{ListedFile, Manifest};
use xxhash_rust::xxh3::xxh3_128;

pub use self::list::list_files;

/// Tree of all files of a manifest: each at its position, with VOID between them. Where files
/// overlap, the cells of the later one that are not VOID are on top.
///
/// Opening a mosaic opens no file. A query opens the files that it touches, of which 64 stay open.
/// A file that does not match the manifest is an error. Nodes of a file that coincide with nodes of
/// the mosaic are returned unchanged. Levels above the cells: see [`Mosaic::is_approximate`].
pub struct Mosaic {
    path: PathBuf,
    bytes: u64,
    state: u128,
    header: Header,
    metadata: Metadata,
    entries: Vec<ListedFile>,
    index: Index,
    options: OpenOptions,
    files: OpenFiles,
    tallies: Tallies,
    blocks: Blocks,
    /// See [`Mosaic::is_approximate`]; computed on request, since it checks all files.
    approximate: OnceLock<bool>,
}

/// INNER node of a mosaic.
#[derive(Clone, Copy, Debug)]
pub enum MosaicNode {
    /// Node of several files, or of one whose nodes do not coincide with the mosaic's.
    Several(Code),
    /// Node of the file with this index.
    File(u32, GoblinNode),
}

impl Mosaic {
    /// Parses a manifest that was read from a path.
    ///
    /// # Errors
    /// If the manifest is corrupt.
    pub(super) fn from_bytes(path: &Path, bytes: &[u8], options: &OpenOptions) -> Result<Mosaic> {
        let Manifest { header, metadata, entries } = Manifest::from_bytes(path, bytes)?;
        let boxes = entries.iter().map(|entry| entry.bounds);
        let index = Index::new(boxes, header.form.dimension, header.depth());
        // (The read cache of one file is divided among the open files.)
        let access = options.access.divided(files::MAX_OPEN as u64);
        let each = options.clone().access(access);
        // (Each file stores its own provenance.)
        let count = entries.len();
        let files = if count == 1 { "file" } else { "files" };
        let listed = format!("{count} {files} that {} lists", path.display());
        let metadata = Metadata { provenance: vec![listed], ..metadata };
        Ok(Mosaic {
            path: path.into(),
            bytes: bytes.len() as u64,
            state: xxh3_128(bytes),
            options: each,
            header,
            metadata,
            entries,
            index,
            files: OpenFiles::default(),
            tallies: Tallies::default(),
            blocks: Blocks::default(),
            approximate: OnceLock::new(),
        })
    }

    /// Whether values of some levels above the cells are approximate. Where a file begins within a
    /// node of that level, values are computed from nodes two levels finer. Where files overlap in
    /// large nodes, hidden cells may count. By the rules that depend on nodes instead of cells
    /// (dominant, nearest), a node of several files has the value of the topmost file there. All
    /// else is exact: means from sums, majorities from counts.
    pub(super) fn is_approximate(&self) -> bool {
        *self.approximate.get_or_init(|| self.has_approximate_levels())
    }

    fn has_approximate_levels(&self) -> bool {
        let axes = self.header.form.axes();
        let begins_within = |entry: &ListedFile| {
            let levels = entry.depth.min(self.header.depth());
            entry.bounds.min[..axes].iter().any(|cell| cell & ((1 << levels) - 1) != 0)
        };
        matches!(self.header.rule, Rule::Dominant | Rule::Nearest)
            || self.entries.iter().any(begins_within)
            || self.has_overlaps()
    }

    /// Whether files overlap; assumed if there are very many close to each other.
    fn has_overlaps(&self) -> bool {
        const MAX_CHECKED: usize = 1 << 22;
        let mut checked = 0;
        self.entries.iter().enumerate().any(|(number, entry)| {
            let near = self.index.near(&entry.bounds);
            checked += near.len();
            let meets = |other: &u32| !self.entry(*other).bounds.intersect(&entry.bounds).is_empty();
            checked > MAX_CHECKED || near.iter().any(|other| *other as usize != number && meets(other))
        })
    }

    /// Path of the manifest.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// How its files are opened.
    pub(super) fn access(&self) -> &FileAccess {
        &self.options.access
    }

    /// Bytes of the manifest and of its files, as it lists them.
    pub(super) fn bytes(&self) -> u64 {
        self.entries.iter().map(|entry| entry.tag.length).fold(self.bytes, u64::saturating_add)
    }

    /// Hash of the manifest, which records the state of every listed file.
    pub fn state(&self) -> u128 {
        self.state
    }

    /// Tree type, rule and extent of the whole.
    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// Frame, names, colours and tags of the whole.
    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The files, from bottom to top.
    pub fn entries(&self) -> &[ListedFile] {
        &self.entries
    }

    /// Indices of the files whose boxes intersect a box of cells, the topmost last.
    fn meeting(&self, cells: &Bounds) -> Vec<u32> {
        let mut near = self.index.near(cells);
        near.retain(|number| !self.entry(*number).bounds.intersect(cells).is_empty());
        near
    }

    fn entry(&self, number: u32) -> &ListedFile {
        &self.entries[number as usize]
    }

    /// Opens a file, or returns it if it is open.
    fn file(&self, number: u32) -> Result<Arc<Goblin>> {
        self.files.get(number, &|| open_listed(self.entry(number), (&self.path, &self.header), &self.options))
    }

    /// Checks that the open files have not changed.
    pub(super) fn check_unchanged(&self) -> Result<()> {
        self.files.all().iter().try_for_each(|file| file.check_unchanged())
    }

    /// Verifies every file, and that each matches the manifest. The place of a finding names its
    /// file.
    ///
    /// # Errors
    /// If a file cannot be read, or does not match the manifest; or on cancellation.
    pub(super) fn verify(&self, memory: u64, progress: &dyn Progress) -> Result<Vec<Finding>> {
        let mut findings = Vec::new();
        for number in 0..self.entries.len() {
            let file = TreeFile::Goblin(self.file(number as u32)?);
            for Finding { place, problem } in file.verify(memory, progress)? {
                findings.push(Finding { place: format!("{}: {place}", file.path().display()), problem });
            }
            if findings.len() >= MAX_FINDINGS {
                break;
            }
        }
        findings.truncate(MAX_FINDINGS);
        Ok(findings)
    }
}
