//! Options for opening tree files.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use spinney_base::Result;
use spinney_base::io::{FileAccess, FileId, ReadBackend};

/// Options for reading a file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OpenOptions {
    /// How this file and the files that it refers to are read: mapping or positioned reads, caches,
    /// and the client for remote files.
    pub access: FileAccess,
    /// Verify each segment's checksum on first use.
    pub check: bool,
    /// Options of a remote store, by the names that its tools use: `aws_region`,
    /// `aws_access_key_id`, `endpoint`, ...
    pub storage: Vec<(String, String)>,
    /// Source of the file's bytes, if they are not at its path.
    pub source: Option<ByteSource>,
}

/// A callback that opens a file's bytes.
#[derive(Clone)]
pub struct ByteSource(Arc<OpenBytes>);

type OpenBytes = dyn Fn(&Path) -> Result<Box<dyn ReadBackend>> + Send + Sync;

impl ByteSource {
    /// Creates a source. The callback runs each time that the file is opened, and gets its path.
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
    /// The default options: mapped, with checks, no remote files.
    pub fn new() -> OpenOptions {
        OpenOptions::default()
    }

    /// Sets how this file and the files that it refers to are read: see
    /// [`OpenOptions::access`](field@OpenOptions::access).
    #[must_use]
    pub fn access(self, access: FileAccess) -> OpenOptions {
        OpenOptions { access, ..self }
    }

    /// Uses positioned reads instead of mapping, with a cache of `cache` bytes per file.
    #[must_use]
    pub fn positioned(self, cache: u64) -> OpenOptions {
        OpenOptions { access: self.access.positioned(cache), ..self }
    }

    /// Sets whether checksums are verified on first use.
    #[must_use]
    pub fn check(self, check: bool) -> OpenOptions {
        OpenOptions { check, ..self }
    }

    /// Sets options of a remote store: see [`OpenOptions::storage`](field@OpenOptions::storage).
    #[must_use]
    pub fn storage(self, options: impl IntoIterator<Item = (String, String)>) -> OpenOptions {
        OpenOptions { storage: options.into_iter().collect(), ..self }
    }

    /// Sets a source of the file's bytes: see [`OpenOptions::source`](field@OpenOptions::source).
    #[must_use]
    pub fn source(self, source: ByteSource) -> OpenOptions {
        OpenOptions { source: Some(source), ..self }
    }

    /// Opens the file with these options.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn open(&self, path: &Path) -> Result<Box<dyn ReadBackend>> {
        self.open_with_id(path).map(|(backend, _)| backend)
    }

    /// Opens the file with these options and returns its identity. One call does both, because two
    /// opens of a path may see two files.
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
