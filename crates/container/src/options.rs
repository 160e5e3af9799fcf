//! Options of opening tree files.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use spinney_base::Result;
use spinney_base::io::{FileAccess, FileId, ReadBackend};

/// Options of reading a file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OpenOptions {
    /// How the file, and each one that it names, is read: mapped or at positions, its caches, and the client for remote files.
    pub access: FileAccess,
    /// Check each segment's checksum the first time it is used.
    pub check: bool,
    /// Options of the store of a file elsewhere, as its programs name them: `aws_region`, `aws_access_key_id`, `endpoint`, ...
    pub storage: Vec<(String, String)>,
    /// The way to the file's bytes, if they are not where its name says.
    pub source: Option<ByteSource>,
}

/// Opens the bytes of a file, whatever it is in.
#[derive(Clone)]
pub struct ByteSource(Arc<OpenBytes>);

type OpenBytes = dyn Fn(&Path) -> Result<Box<dyn ReadBackend>> + Send + Sync;

impl ByteSource {
    /// A source that is asked each time that the file is opened, with the name that it is opened by.
    pub fn new(open: impl Fn(&Path) -> Result<Box<dyn ReadBackend>> + Send + Sync + 'static) -> ByteSource {
        ByteSource(Arc::new(open))
    }
}

impl fmt::Debug for ByteSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ByteSource")
    }
}

impl Default for OpenOptions {
    fn default() -> Self {
        OpenOptions { access: FileAccess::default(), check: true, storage: Vec::new(), source: None }
    }
}

impl From<FileAccess> for OpenOptions {
    fn from(access: FileAccess) -> OpenOptions {
        OpenOptions { access, ..OpenOptions::default() }
    }
}

impl From<&FileAccess> for OpenOptions {
    fn from(access: &FileAccess) -> OpenOptions {
        access.clone().into()
    }
}

impl OpenOptions {
    /// The default: mapped, with checks, no remote files.
    pub fn new() -> OpenOptions {
        OpenOptions::default()
    }

    /// Sets how the file, and each one that it names, is read: see [`OpenOptions::access`](field@OpenOptions::access).
    #[must_use]
    pub fn access(self, access: FileAccess) -> OpenOptions {
        OpenOptions { access, ..self }
    }

    /// Reads at positions instead of mapping the file, with a cache of `cache` bytes for each file.
    #[must_use]
    pub fn positioned(self, cache: u64) -> OpenOptions {
        OpenOptions { access: self.access.positioned(cache), ..self }
    }

    /// Chooses whether checksums are checked the first time that something is used.
    #[must_use]
    pub fn check(self, check: bool) -> OpenOptions {
        OpenOptions { check, ..self }
    }

    /// Options of the store of a file elsewhere: see [`OpenOptions::storage`](field@OpenOptions::storage).
    #[must_use]
    pub fn storage(self, options: impl IntoIterator<Item = (String, String)>) -> OpenOptions {
        OpenOptions { storage: options.into_iter().collect(), ..self }
    }

    /// Reads bytes that are not where the file's name says: see [`OpenOptions::source`](field@OpenOptions::source).
    #[must_use]
    pub fn source(self, source: ByteSource) -> OpenOptions {
        OpenOptions { source: Some(source), ..self }
    }

    /// The file's bytes, the way that was asked for.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(&self, path: &Path) -> Result<Box<dyn ReadBackend>> {
        self.open_with_id(path).map(|(backend, _)| backend)
    }

    /// The file's bytes, the way that was asked for, and which file it is: two looks at a path may see two
    /// files.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open_with_id(&self, path: &Path) -> Result<(Box<dyn ReadBackend>, FileId)> {
        match &self.source {
            Some(ByteSource(open)) => Ok((self.access.cached(open(path)?), FileId::unique())),
            None => self.access.open(path, &self.storage),
        }
    }
}
