//! Files of a manifest.

use std::path::{Path, PathBuf};

use spinney_base::io::{ReadBackend, url_of};
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};
use spinney_container::TAIL;

/// A file of a manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct ListedFile {
    /// The file: a path, relative to the manifest's folder unless it is absolute, or a URL.
    pub path: String,
    /// The layer; the first if none is named.
    pub layer: Option<String>,
    /// The cells of the common space that the file's picture covers.
    pub bounds: Bounds,
    /// Levels of the file's tree below its root.
    pub depth: u8,
    /// The state that the file had when it was listed.
    pub tag: FileTag,
}

/// State of a file, told by its length and its last bytes: these have checksums of all that stands before them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileTag {
    /// Bytes of the file.
    pub length: u64,
    /// CRC-32C of its last bytes, as many as are sure to hold a Goblin file's trailer.
    pub checksum: u32,
}

impl FileTag {
    /// The state of an open file. Reads its last 4 KiB.
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
    /// The place of the file, for a manifest at a path.
    ///
    /// # Errors
    /// If a manifest that came from elsewhere names a file of this machine.
    pub fn file(&self, manifest: &Path) -> Result<PathBuf> {
        let own = Path::new(&self.path);
        if url_of(own).is_some() {
            return Ok(own.into());
        }
        let Some(url) = url_of(manifest) else {
            return Ok(manifest.parent().unwrap_or(Path::new("")).join(own));
        };
        // (What somebody else has written must not choose files here.)
        if own.is_absolute() || self.path.starts_with("file:") {
            let found = format!("the file {}, which is none of its server,", self.path);
            return Err(Error::unsupported(manifest, found, "name files beside it, or URLs"));
        }
        let (place, query) = spinney_base::io::split_query(url);
        let folder = place.rsplit_once('/').map_or(place, |(folder, _)| folder);
        Ok(format!("{folder}/{}{query}", self.path).into())
    }
}
