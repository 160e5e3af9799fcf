//! The state of a file: which one it is, and when it was changed.

use std::fs::Metadata;
use std::hash::{Hash as _, Hasher as _};
use std::path::Path;
use std::time::{Duration, SystemTime};

use spinney_base::io::FileId;
use spinney_base::{Error, Result};
use xxhash_rust::xxh3::Xxh3Default;

/// The state of a file: equal states are equal bytes.
///
/// Systems count the time of changes in steps of some milliseconds: of a file that was changed a moment ago nobody knows whether it
/// will change once more at the same time. So whoever looks at such a file waits until that is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct FileVersion {
    /// (Nothing where the system has no such numbers.)
    id: Option<FileId>,
    pub(crate) length: u64,
    modified: SystemTime,
}

/// Time within which a file may be changed without another time of its change.
const STEP: Duration = Duration::from_millis(20);

impl FileVersion {
    /// The state of a file that the system tells this of.
    ///
    /// # Errors
    /// If the system does not know when files are changed.
    pub(crate) fn of(metadata: &Metadata, path: &Path) -> Result<FileVersion> {
        let id = Some(FileId::from_metadata(metadata)).filter(|id| !id.is_unique());
        let modified = metadata.modified().map_err(Error::io(path, "look at"))?;
        Ok(FileVersion { id, length: metadata.len(), modified })
    }

    /// The present state of a path's file, which may change without being seen to.
    ///
    /// # Errors
    /// If there is no file, or the system cannot tell.
    pub(crate) fn at(path: &Path) -> Result<FileVersion> {
        let metadata = std::fs::metadata(path).map_err(Error::io(path, "look at"))?;
        FileVersion::of(&metadata, path)
    }

    /// The state of a path's file, which the system tells of by `look`; waits while it may change without being seen to. Whether that is over is told,
    /// too: it is not where somebody writes all the time.
    ///
    /// # Errors
    /// If there is no file, or the system cannot tell.
    pub(crate) fn settled(
        path: &Path,
        look: impl Fn() -> std::io::Result<Metadata>,
    ) -> Result<(FileVersion, bool)> {
        let now = || FileVersion::of(&look().map_err(Error::io(path, "look at"))?, path);
        const TIMES: usize = 5;
        let mut version = now()?;
        for _ in 0..TIMES {
            let age = SystemTime::now().duration_since(version.modified).unwrap_or(STEP);
            let Some(left) = STEP.checked_sub(age).filter(|left| !left.is_zero()) else {
                return Ok((version, true));
            };
            std::thread::sleep(left);
            version = now()?;
        }
        Ok((version, false))
    }

    /// A strong entity tag of what a version of this program makes of the file for a question.
    pub(crate) fn tag(&self, question: &str) -> String {
        let mut hasher = Xxh3Default::new();
        self.hash(&mut hasher);
        env!("CARGO_PKG_VERSION").hash(&mut hasher);
        question.hash(&mut hasher);
        format!("\"{:016x}\"", hasher.finish())
    }
}
