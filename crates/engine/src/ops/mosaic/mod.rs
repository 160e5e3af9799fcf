//! Many files as one tree, as a manifest tells them.

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

/// The tree that the files of a manifest are together: each where it lies, VOID between them, and where two overlap the cells of the later one
/// that are not VOID lie on top.
///
/// Opening it opens no file: a question opens those that it touches, of which 64 stay open. A file that is not what the manifest tells is an error.
/// Nodes of one file whose cells lie on theirs are handed on as they are. Levels above the cells: see [`Mosaic::is_approximate`].
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
    /// See [`Mosaic::is_approximate`]; found when somebody asks, since it looks at all files.
    approximate: OnceLock<bool>,
}

/// An INNER node of a mosaic.
#[derive(Clone, Copy, Debug)]
pub enum MosaicNode {
    /// Of several files, or of one whose cells do not lie on its own.
    Several(Code),
    /// Of the file of this number.
    File(u32, GoblinNode),
}

impl Mosaic {
    /// The tree of a manifest's text, which was read from a path.
    ///
    /// # Errors
    /// If the text is damaged.
    pub(super) fn from_bytes(path: &Path, bytes: &[u8], options: &OpenOptions) -> Result<Mosaic> {
        let Manifest { header, metadata, entries } = Manifest::from_bytes(path, bytes)?;
        let boxes = entries.iter().map(|entry| entry.bounds);
        let index = Index::new(boxes, header.form.dimension, header.depth());
        // (What stays in memory of files that are read at positions is what would stay of one.)
        let access = options.access.divided(files::MAX_OPEN as u64);
        let each = options.clone().access(access);
        // (What they were made of stands in each of them.)
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

    /// Whether numbers of some levels above the cells are approximate: where a file begins within a node of that level, they are made of nodes
    /// two levels finer; where files overlap in large nodes, cells that are hidden may count. By the rules that go by nodes instead of cells
    /// (dominant, nearest) a node of several files has what the topmost has there. All else is exact: means from sums, majorities from counts.
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

    /// Whether files overlap; of very many that are near each other it is taken for granted.
    fn has_overlaps(&self) -> bool {
        const MAX_CHECKED: usize = 1 << 22;
        let mut looked_at = 0;
        self.entries.iter().enumerate().any(|(number, entry)| {
            let near = self.index.near(&entry.bounds);
            looked_at += near.len();
            let meets = |other: &u32| !self.entry(*other).bounds.intersect(&entry.bounds).is_empty();
            looked_at > MAX_CHECKED || near.iter().any(|other| *other as usize != number && meets(other))
        })
    }

    /// The manifest's path.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// How its files are opened.
    pub(super) fn access(&self) -> &FileAccess {
        &self.options.access
    }

    /// Bytes of the manifest and of its files, as it tells them.
    pub(super) fn bytes(&self) -> u64 {
        self.entries.iter().map(|entry| entry.tag.length).fold(self.bytes, u64::saturating_add)
    }

    /// A number that another text of the manifest does not have: it tells the state of every file that is listed.
    pub fn state(&self) -> u128 {
        self.state
    }

    /// Form, rule and extent of all together.
    pub(super) fn header(&self) -> &Header {
        &self.header
    }

    /// Frame, names, colours and tags of all together.
    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The files, in the order in which they lie on each other.
    pub fn entries(&self) -> &[ListedFile] {
        &self.entries
    }

    /// Numbers of the files whose boxes meet a box of cells, the topmost last.
    fn meeting(&self, cells: &Bounds) -> Vec<u32> {
        let mut near = self.index.near(cells);
        near.retain(|number| !self.entry(*number).bounds.intersect(cells).is_empty());
        near
    }

    fn entry(&self, number: u32) -> &ListedFile {
        &self.entries[number as usize]
    }

    /// An open file.
    fn file(&self, number: u32) -> Result<Arc<Goblin>> {
        self.files.get(number, &|| open_listed(self.entry(number), (&self.path, &self.header), &self.options))
    }

    /// Makes sure that the files that are open still are what they were.
    pub(super) fn check_unchanged(&self) -> Result<()> {
        self.files.all().iter().try_for_each(|file| file.check_unchanged())
    }

    /// Checks every file, one after the other, and that each is what the manifest tells. A place of a finding names its file.
    ///
    /// # Errors
    /// If a file cannot be read, or is not what the manifest tells; or on interruption.
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
