//! A manifest: common properties, and the list of files.

use std::path::Path;

use super::document;
use super::listed_file::ListedFile;
use spinney_base::io::{FileAccess, LockFile, url_of, without_query};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, Header, Metadata};
use spinney_crs::Frame;

/// First key of a manifest, which identifies the format. Its value is the version.
pub(super) const MARK: &str = "spinney_manifest";
/// The version that is written, and the only one that is read.
pub(super) const VERSION: u32 = 1;
/// Maximum bytes of a manifest: 256 for each of a million files.
const MAX_BYTES: u64 = 256 << 20;
/// Maximum number of files in a manifest.
pub(super) const MAX_FILES: usize = 1 << 20;

/// Many files on one grid of cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// Tree type, rule, kind, depth and extent of the common space.
    pub header: Header,
    /// Frame, names, colours and tags that all files share.
    pub metadata: Metadata,
    /// The files. If two overlap, the later one is on top.
    pub entries: Vec<ListedFile>,
}

/// Returns whether the first bytes of a file are those of a manifest.
pub fn is_manifest(first: &[u8]) -> bool {
    let first = &first[..first.len().min(FIRST_BYTES)];
    let start = first.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(first.len());
    let rest = first[start..].strip_prefix(b"{").unwrap_or_default().trim_ascii_start();
    rest.strip_prefix(b"\"").is_some_and(|rest| rest.starts_with(MARK.as_bytes()))
}

/// Returns whether a file is a manifest, by its name and first bytes.
///
/// # Errors
/// If the file system or the remote host fails.
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
    /// Parses and validates a manifest without opening its files.
    ///
    /// # Errors
    /// If it is corrupt, or of another version.
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Manifest> {
        Manifest::check_length(path, bytes.len() as u64)?;
        document::read(path, bytes)
    }

    /// Checks the length of a manifest. Callers must do so before they allocate a buffer for its
    /// bytes.
    ///
    /// # Errors
    /// If it is too long.
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

    /// Formats the manifest as JSON.
    pub fn to_text(&self) -> String {
        document::write(self)
    }

    /// Creates or updates a local manifest.
    ///
    /// `change` receives the existing manifest if `is_update`, else `None`. The file is replaced
    /// atomically: readers see the old or the new manifest, also after a crash. A lock file next to
    /// it excludes concurrent updates.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process is changing it; those of `change`, of reading and of
    /// writing. A remote manifest is unsupported.
    pub fn update(
        path: &Path,
        is_update: bool,
        access: &FileAccess,
        change: &mut dyn FnMut(Option<Manifest>) -> Result<Manifest>,
    ) -> Result<Manifest> {
        if url_of(path).is_some() {
            let advice = "change a local copy, and upload it";
            return Err(Error::unsupported(path, "changing a remote manifest", advice));
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

    /// Shrinks the space to the files' bounding box, and moves the frame accordingly.
    fn fitted(mut self, path: &Path) -> Result<Manifest> {
        let boxes = self.entries.iter().map(|entry| entry.bounds);
        let Some(hull) = boxes.reduce(|all, bounds| all.hull(&bounds)) else {
            let advice = "a manifest needs at least one file";
            return Err(Error::unsupported(path, "a manifest without files", advice));
        };
        let moved = |at: [u64; 3]| std::array::from_fn(|axis| at[axis] - hull.min[axis]);
        for ListedFile { bounds, .. } in &mut self.entries {
            *bounds = Bounds { min: moved(bounds.min), max: moved(bounds.max) };
        }
        self.metadata.frame = moved_frame(&self.metadata.frame, hull.min.map(|cell| cell as f64));
        self.header.extent = hull.size();
        let longest = self.header.extent.into_iter().max().unwrap_or(1);
        let (depth, max_depth) =
            (longest.next_power_of_two().ilog2() as u8, self.header.form.dimension.max_depth());
        if depth > max_depth {
            let expected = format!("at most {} cells along each axis", 1u64 << max_depth);
            return Err(Error::invalid("bounding box of all files", format!("{longest} cells"), expected));
        }
        self.header.shape.depth = depth;
        Ok(self)
    }
}

/// Moves a frame so that its first cell is at `first`.
fn moved_frame(frame: &Frame, first: [f64; 3]) -> Frame {
    let origin = frame.to_world(first);
    let mut moved = frame.clone();
    for (row, origin) in moved.matrix.iter_mut().zip(origin) {
        row[3] = origin;
    }
    moved
}
