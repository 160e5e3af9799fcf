//! Bytes of a model's file, and errors that name the file.

use std::fs;
use std::io::{self, Seek as _};
use std::path::{Path, PathBuf};

use spinney_base::io::{FileAccess, Mapped, ReadBackend};
use spinney_base::{Error, Result};

/// Byte order mark that some programs write before UTF-8 text. It is not content.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Mapped file that is not empty.
pub(super) struct ModelFile {
    path: PathBuf,
    map: Mapped,
    /// Bytes before the model's first byte.
    skipped: usize,
}

impl ModelFile {
    /// Opens a file. If files are read at positions instead of mapped, this is a copy in an unnamed
    /// temporary file, which no other process can truncate.
    pub(super) fn open(path: &Path, access: &FileAccess) -> Result<ModelFile> {
        let about = fs::metadata(path).map_err(Error::io(path, "open"))?;
        if about.is_dir() {
            return Err(Error::io(path, "open")(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        if !about.is_file() {
            return Err(Error::unsupported(
                path,
                "a mesh from a pipe or device",
                "write it to a file first; meshes are read several times",
            ));
        }
        if about.len() == 0 {
            return Err(Error::corrupt(path, "file", "no bytes", "a mesh"));
        }
        let map = match access.is_positioned() {
            true => copy(path, access)?,
            false => Mapped::open(path)?,
        };
        access.count_opened();
        Ok(ModelFile { path: path.to_path_buf(), map, skipped: 0 })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn bytes(&self) -> &[u8] {
        self.map.bytes().and_then(|bytes| bytes.get(self.skipped..)).unwrap_or_default()
    }

    /// Skips a byte order mark, if there is one.
    pub(super) fn skip_byte_order_mark(&mut self) {
        if self.bytes().starts_with(BYTE_ORDER_MARK) {
            self.skipped = BYTE_ORDER_MARK.len();
        }
    }

    /// Reports each line, vertex or face that is read, in order. The mapping releases its pages
    /// periodically so that the file does not fill the memory.
    #[inline]
    pub(super) fn passed(&self, number: u64) {
        const OFTEN: u64 = 1 << 17;
        if number.is_multiple_of(OFTEN) && number > 0 {
            self.map.release_pages();
        }
    }

    /// Error at a location in the file.
    pub(super) fn corrupt(
        &self,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Error {
        Error::corrupt(&self.path, place, found, expected)
    }

    /// Error for a file without any vertex.
    pub(super) fn no_vertices(&self) -> Error {
        self.corrupt("file", "no vertices", "a mesh")
    }
}

/// Mapped copy of a file.
fn copy(path: &Path, access: &FileAccess) -> Result<Mapped> {
    let failed = || Error::io(path, "copy to a temporary file");
    let mut file = tempfile::tempfile().map_err(failed())?;
    io::copy(&mut access.input(path)?, &mut file).and_then(|_| file.rewind()).map_err(failed())?;
    Mapped::of(&file, path)
}
