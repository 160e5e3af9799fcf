//! Identity and modification time of a file.

use std::fs::Metadata;
use std::hash::{Hash as _, Hasher as _};
use std::path::Path;
use std::time::{Duration, SystemTime};

use spinney_base::io::FileId;
use spinney_base::{Error, Result};
use xxhash_rust::xxh3::Xxh3Default;

/// Identity of a file version: equal values imply equal contents.
///
/// File systems have modification times with a granularity of some milliseconds. A file that was
/// modified very recently may be modified again without a new time, so readers of such a file wait
/// for that interval ([`FileVersion::settled`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct FileVersion {
    /// `None` if the file system has no file numbers.
    id: Option<FileId>,
    pub(crate) length: u64,
    modified: SystemTime,
}

/// Interval within which a file may be modified twice with the same modification time.
const GRANULARITY: Duration = Duration::from_millis(20);

impl FileVersion {
    /// Version with the given metadata.
    ///
    /// # Errors
    /// If the system has no modification times.
    pub(crate) fn of(metadata: &Metadata, path: &Path) -> Result<FileVersion> {
        let id = Some(FileId::from_metadata(metadata)).filter(|id| !id.is_unique());
        let modified = metadata.modified().map_err(Error::io(path, "stat"))?;
        Ok(FileVersion { id, length: metadata.len(), modified })
    }

    /// Current version of a path's file. It may be modified again with the same version.
    ///
    /// # Errors
    /// If there is no file, or the system has no modification times.
    pub(crate) fn at(path: &Path) -> Result<FileVersion> {
        let metadata = std::fs::metadata(path).map_err(Error::io(path, "stat"))?;
        FileVersion::of(&metadata, path)
    }

    /// Current version of a path's file, whose metadata `stat` returns. Waits while a modification
    /// could go unnoticed. The flag is `false` if the file is still being modified after several
    /// attempts.
    ///
    /// # Errors
    /// If there is no file, or the system has no modification times.
    pub(crate) fn settled(
        path: &Path,
        stat: impl Fn() -> std::io::Result<Metadata>,
    ) -> Result<(FileVersion, bool)> {
        let now = || FileVersion::of(&stat().map_err(Error::io(path, "stat"))?, path);
        const TIMES: usize = 5;
        let mut version = now()?;
        for _ in 0..TIMES {
            let age = SystemTime::now().duration_since(version.modified).unwrap_or(GRANULARITY);
            let Some(left) = GRANULARITY.checked_sub(age).filter(|left| !left.is_zero()) else {
                return Ok((version, true));
            };
            std::thread::sleep(left);
            version = now()?;
        }
        Ok((version, false))
    }

    /// Strong entity tag of the response to a query, from the file version, the program version and
    /// the query.
    pub(crate) fn tag(&self, request: &str) -> String {
        let mut hasher = Xxh3Default::new();
        self.hash(&mut hasher);
        env!("CARGO_PKG_VERSION").hash(&mut hasher);
        request.hash(&mut hasher);
        format!("\"{:016x}\"", hasher.finish())
    }
}
