//! Files of a manifest.

use std::path::{Path, PathBuf};

use spinney_base::Result;
use spinney_base::io::{ReadBackend, listed_path};
use spinney_base::space::Bounds;
use spinney_container::TAIL;

/// A file of a manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedFile {
    /// The file: an absolute path, a path relative to the manifest's directory, or a URL.
    pub path: String,
    /// The layer; `None` is the first layer.
    pub layer: Option<String>,
    /// The cells of the common space that the file's raster covers.
    pub bounds: Bounds,
    /// Depth of the file's tree.
    pub depth: u8,
    /// The version of the file when it was listed.
    pub tag: FileTag,
}

/// Identity of a file version: its length and a checksum of its last bytes. Those contain checksums
/// of all other data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileTag {
    /// File size in bytes.
    pub length: u64,
    /// CRC-32C of the last bytes, as many as always contain a Goblin file's trailer.
    pub checksum: u32,
}

impl FileTag {
    /// Returns the tag of an open file. Reads its last 4 KiB.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn of(file: &dyn ReadBackend) -> Result<FileTag> {
        let length = file.len();
        let tail = length.min(TAIL as u64);
        let bytes = file.read(length - tail, tail as usize)?;
        Ok(FileTag { length, checksum: crc32c::crc32c(&bytes) })
    }
}

impl ListedFile {
    /// Returns the path or URL of the file, given that of the manifest.
    ///
    /// # Errors
    /// If a remote manifest names a file of this machine.
    pub fn file(&self, manifest: &Path) -> Result<PathBuf> {
        listed_path(manifest, &self.path)
    }
}
