//! A manifest: what its files have in common, and the files.

use std::path::Path;

use super::document;
use super::listed_file::ListedFile;
use spinney_base::io::{FileAccess, LockFile, url_of, without_query};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, Header, Metadata};
use spinney_crs::Frame;

/// The first name in a manifest, which tells what it is, and the number of its version.
pub(super) const MARK: &str = "spinney_manifest";
/// The version that is written, and the newest that is read.
pub(super) const VERSION: u32 = 1;
/// Bytes of a manifest at most: a million files.
const MAX_BYTES: u64 = 256 << 20;
/// Files of a manifest at most.
pub(super) const MAX_FILES: usize = 1 << 20;

/// Many files on one grid of cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// Form, rule, kind, depth and extent of all of them together.
    pub header: Header,
    /// Frame, names, colours and tags that they share.
    pub metadata: Metadata,
    /// The files; where two overlap the later lies on top.
    pub entries: Vec<ListedFile>,
}

/// Whether the first bytes of a file are those of a manifest.
pub fn is_manifest(first: &[u8]) -> bool {
    let first = &first[..first.len().min(FIRST_BYTES)];
    let start = first.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(first.len());
    let rest = first[start..].strip_prefix(b"{").unwrap_or_default().trim_ascii_start();
    rest.strip_prefix(b"\"").is_some_and(|rest| rest.starts_with(MARK.as_bytes()))
}

/// Whether a file is a manifest, by its name and its first bytes.
///
/// # Errors
/// If the file system or the host of the file fails.
pub fn is_manifest_file(path: &Path, access: &FileAccess) -> Result<bool> {
    let extension = without_query(path).extension();
    if !extension.is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
        return Ok(false);
    }
    let Some(file) = access.probe(path)? else { return Ok(false) };
    let length = file.len().min(FIRST_BYTES as u64) as usize;
    Ok(is_manifest(&file.read(0, length)?))
}

impl Manifest {
    /// Reads a manifest's text, and checks all of its numbers: none of its files is opened.
    ///
    /// # Errors
    /// If it is damaged, or of a newer version.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Manifest> {
        Manifest::check_length(path, bytes.len() as u64)?;
        document::read(path, bytes)
    }

    /// Checks the length of a manifest, which must be done before anybody makes room for its bytes.
    ///
    /// # Errors
    /// If there are too many.
    pub fn check_length(path: &Path, length: u64) -> Result<()> {
        if length <= MAX_BYTES {
            return Ok(());
        }
        let expected = format!("at most {MAX_BYTES}");
        Err(Error::corrupt(path, "manifest", format!("{length} bytes"), expected))
    }

    /// Opens and reads a manifest.
    ///
    /// # Errors
    /// Those of [`Manifest::from_bytes`], and if the file cannot be read.
    pub fn open(path: &Path, access: &FileAccess) -> Result<Manifest> {
        let file = access.peek(path)?;
        Manifest::check_length(path, file.len())?;
        let bytes = file.read(0, file.len() as usize)?;
        if !is_manifest(&bytes) {
            let found = format!("`{}`", bytes[..bytes.len().min(16)].escape_ascii());
            return Err(Error::corrupt(path, "manifest", found, format!("a manifest: `{{\"{MARK}\": ...`")));
        }
        Manifest::from_bytes(path, &bytes)
    }

    /// The manifest's text.
    pub fn to_text(&self) -> String {
        document::write(self)
    }

    /// Changes a manifest, or makes it: `change` gets the one that is there, if `path` leads to one and `is_update` asks for it. It is replaced as a
    /// whole: readers see the old one or the new one, and a crash leaves either. A file beside it keeps others from changing it meanwhile.
    ///
    /// # Errors
    /// [`Error::Locked`] if somebody else is changing it; those of `change`, and of reading and writing.
    pub fn update(
        path: &Path,
        is_update: bool,
        access: &FileAccess,
        change: &mut dyn FnMut(Option<Manifest>) -> Result<Manifest>,
    ) -> Result<Manifest> {
        if url_of(path).is_some() {
            let advice = "change a copy on this machine, and put that there";
            return Err(Error::unsupported(path, "changing a manifest elsewhere", advice));
        }
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(".lock");
        let _lock = LockFile::take(&path.with_file_name(name), path)?;
        let before = if is_update { Some(Manifest::open(path, access)?) } else { None };
        let after = change(before)?.fitted(path)?;
        let mut output = access.create(path)?;
        let written = std::io::Write::write_all(&mut output, after.to_text().as_bytes());
        written.map_err(Error::io(path, "write the manifest"))?;
        output.commit()?;
        Ok(after)
    }

    /// The manifest in the smallest space that has all of its files: the first cell of one of them, along each axis, is the first of all.
    fn fitted(mut self, path: &Path) -> Result<Manifest> {
        let boxes = self.entries.iter().map(|entry| entry.bounds);
        let Some(hull) = boxes.reduce(|all, bounds| all.hull(&bounds)) else {
            let advice = "a manifest has one file at least";
            return Err(Error::unsupported(path, "a manifest without files", advice));
        };
        let moved = |at: [u64; 3]| std::array::from_fn(|axis| at[axis] - hull.min[axis]);
        for ListedFile { bounds, .. } in &mut self.entries {
            *bounds = Bounds { min: moved(bounds.min), max: moved(bounds.max) };
        }
        self.metadata.frame = moved_frame(&self.metadata.frame, hull.min.map(|cell| cell as f64));
        self.header.extent = hull.size();
        let longest = self.header.extent.into_iter().max().unwrap_or(1);
        let (depth, most) =
            (longest.next_power_of_two().ilog2() as u8, self.header.form.dimension.max_depth());
        if depth > most {
            let expected = format!("at most {} along each axis", 1u64 << most);
            return Err(Error::invalid("space of all files", format!("{longest} cells"), expected));
        }
        self.header.shape.depth = depth;
        Ok(self)
    }
}

/// A frame whose first cell is another one.
fn moved_frame(frame: &Frame, first: [f64; 3]) -> Frame {
    let origin = frame.to_world(first);
    let mut moved = frame.clone();
    for (row, origin) in moved.matrix.iter_mut().zip(origin) {
        row[3] = origin;
    }
    moved
}
