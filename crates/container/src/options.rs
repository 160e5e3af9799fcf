//! Options of opening tree files.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use spinney_base::Result;
use spinney_base::io::{FileId, ReadBackend, open_file, positioned_reads_are_preferred, with_cache};

/// Options of reading a file.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Read with positioned reads instead of mapping the file: for network folders and files that somebody
    /// may truncate meanwhile.
    pub positioned: bool,
    /// Bytes of segments kept in memory when reading with positioned reads. (Files elsewhere share one cache.)
    pub cache: u64,
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
        OpenOptions {
            positioned: positioned_reads_are_preferred(),
            cache: 64 << 20,
            check: true,
            storage: Vec::new(),
            source: None,
        }
    }
}

impl OpenOptions {
    /// The usual way: mapped, with checks; or what [`prefer_positioned_reads`](spinney_base::io::prefer_positioned_reads)
    /// has chosen.
    pub fn new() -> OpenOptions {
        OpenOptions::default()
    }

    /// Chooses positioned reads instead of mapping the file, and the bytes that are kept in memory.
    #[must_use]
    pub fn positioned(self, cache: u64) -> OpenOptions {
        OpenOptions { positioned: true, cache, ..self }
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
        let (backend, id) = match &self.source {
            Some(ByteSource(open)) => (open(path)?, FileId::unique()),
            None => open_file(path, self.positioned, &self.storage)?,
        };
        Ok((with_cache(backend, self.cache), id))
    }
}
