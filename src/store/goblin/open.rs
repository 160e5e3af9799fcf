//! Opening a file: header, trailer, metadata, and where the directory is.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use super::cache::SegmentCache;
use super::directory::entry_size;
use super::reader::Goblin;
use super::trailer::{Section, TAIL, Trailer};
use crate::io::ReadBackend;
use crate::store::container::{HEADER_SIZE, Header, Metadata, OpenOptions, TreeFormat, descend_in};
use crate::{Error, Result};

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
        let metadata =
            Metadata::from_bytes(path, &read_section(path, &*backend, trailer.metadata, "metadata")?)?;
        // Where the directory is mapped, each entry's own checksum is looked at when the entry is used: a
        // checksum of all of it would read it all to open a file.
        let directory = match backend.bytes() {
            Some(_) => None,
            None => Some(read_section(path, &*backend, trailer.directory, "directory")?.into_owned()),
        };
        let checked = (0..trailer.segments.div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let layout = header.record_layout();
        Ok(Goblin {
            path: path.to_path_buf(),
            backend,
            stamp,
            layout,
            descend: descend_in(layout),
            root: trailer.root(layout.width),
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

/// The bytes of a section, which the trailer's checks have found to lie inside the file, with the right
/// checksum.
fn read_section<'f>(
    path: &Path,
    backend: &'f dyn ReadBackend,
    section: Section,
    name: &str,
) -> Result<Cow<'f, [u8]>> {
    let bytes = backend.read(section.offset, section.length as usize)?;
    let checksum = crc32c::crc32c(&bytes);
    if checksum != section.checksum {
        let found = format!("checksum {checksum:08x}");
        return Err(Error::corrupt(path, name, found, format!("{:08x}", section.checksum)));
    }
    Ok(bytes)
}
