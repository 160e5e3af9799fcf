//! Opening a file: header, trailer, metadata, and where the directory is.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use super::directory::entry_size;
use super::reader::Goblin;
use crate::store::records::{RecordLayout, descend_in};
use crate::tree::Child;
use spinney_base::io::ReadBackend;
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_container::{
    HEADER_SIZE, Header, LEAF, Metadata, OpenOptions, Section, SegmentCache, TAIL, Trailer, TreeFormat, VOID,
};

impl Goblin {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be read, is no Goblin file, or is damaged.
    pub fn open(path: &Path, options: &OpenOptions) -> Result<Goblin> {
        Goblin::from_backend(path, options.open(path)?, options)
    }

    /// Opens a file that is in memory.
    ///
    /// # Errors
    /// As [`Goblin::open`].
    pub fn from_bytes(bytes: Vec<u8>) -> Result<Goblin> {
        Goblin::from_backend(Path::new("(memory)"), Box::new(bytes), &OpenOptions::default())
    }

    /// Opens whatever a backend reads; `path` is for messages.
    ///
    /// # Errors
    /// As [`Goblin::open`].
    pub fn from_backend(path: &Path, backend: Box<dyn ReadBackend>, options: &OpenOptions) -> Result<Goblin> {
        // Before anything is read.
        let stamp = backend.stamp()?;
        let (format, header) = Header::read(path, &*backend)?;
        if format != TreeFormat::Goblin {
            return Err(Error::corrupt(path, "header", "an Autumnal file", "a Goblin file"));
        }
        let length = backend.len();
        let tail = length.min(TAIL as u64);
        let trailer = Trailer::from_bytes(path, &backend.read(length - tail, tail as usize)?, length)?;
        let entry_size = entry_size(header.form.value);
        let Section { offset, length, .. } = trailer.directory;
        // Whatever is read later of the directory relies on this: it lies in the file (the trailer's sections
        // all do) and has an entry for each segment; the segments lie before it.
        if trailer.segments.checked_mul(entry_size as u64) != Some(length) || offset < HEADER_SIZE as u64 {
            let found = format!("{length} bytes for {} segments", trailer.segments);
            return Err(Error::corrupt(path, "directory", found, format!("{entry_size} bytes per segment")));
        }
        Metadata::check_length(path, trailer.metadata.length)?;
        let metadata = Metadata::from_bytes(path, &trailer.metadata.read(path, &*backend, "metadata")?)?;
        // Where the directory is mapped, each entry's own checksum is looked at when the entry is used: a
        // checksum of all of it would read it all to open a file.
        let directory = match backend.bytes() {
            Some(_) => None,
            None => Some(trailer.directory.read(path, &*backend, "directory")?.into_owned()),
        };
        let checked = (0..trailer.segments.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let layout = RecordLayout::new(header.form);
        Ok(Goblin {
            path: path.to_path_buf(),
            backend,
            stamp,
            layout,
            descend: descend_in(layout),
            root: root(&trailer, layout.width),
            header,
            trailer,
            metadata,
            directory,
            entry_size,
            checked,
            checked_bytes: AtomicU64::new(0),
            check: options.check,
            cache: Mutex::new(SegmentCache::new(options.cache)),
        })
    }
}

/// The tree's root, with a value of so many bytes.
fn root(trailer: &Trailer, width: usize) -> Child<()> {
    let value = Value::from_bytes(&trailer.root_value[..width]);
    match trailer.root_state {
        VOID => Child::Void,
        LEAF => Child::Leaf(value),
        _ => Child::Inner { representative: value, node: () },
    }
}
