//! Sources: their descriptions, and their chunks, which are read, checked and decoded on demand.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::list::SourceList;
use super::pages::{IndexedSource, Location, MAX_PAGE, SOURCE_PAGE, SourceImage, Table};
use super::table::{self, Chunk, MAX_TABLE, PAGE_CHUNKS};
use spinney_base::io::{CachedBytes, FileAccess, FileStat, ReadBackend, Unpacked, listed_path, url_of};
use spinney_base::{Error, Result};
use spinney_chunks::{ChunkFormat, DecoderStates};
use spinney_container::Section;

/// Maximum number of sources that are kept open.
const MAX_OPEN: usize = 128;
/// Decoded chunks are `2^CHUNK_BITS` bytes apart in the cache: more than a chunk has. Numbers of
/// chunks are below 2^35, since a page of 2^24 bytes has at most 2^23 tables of 1024 chunks.
const CHUNK_BITS: u32 = 29;
/// Number of locks for decoding of an image.
const LOCKS: usize = 8;
/// Maximum size in bytes of a pixel of a mask.
const MAX_MASK_PIXEL: usize = 16;

/// The sources of an index.
pub(crate) struct Sources {
    /// The index.
    pub(crate) path: PathBuf,
    pub(crate) list: SourceList,
    pub(crate) access: FileAccess,
    /// The section with the pages.
    pages: Section,
    /// First source of each page.
    firsts: Vec<u32>,
    /// Descriptions of sources that were used recently, the last one at the end.
    open: Mutex<Vec<(u32, Arc<OpenSource>)>>,
    /// Decoders and buffers that no thread uses.
    decoders: Mutex<Vec<Decoder>>,
}

#[derive(Default)]
pub(crate) struct Decoder {
    pub(crate) states: DecoderStates,
    raw: Vec<u8>,
}

/// A source that is in use.
pub(crate) struct OpenSource {
    pub(crate) source: IndexedSource,
    /// Its file; opened when a chunk is read.
    file: OnceLock<Box<dyn ReadBackend>>,
    /// Its image and its mask.
    images: [OpenImage; 2],
}

struct OpenImage {
    /// Decoded pages of its table.
    table: Vec<OnceLock<Vec<Chunk>>>,
    decoded: Unpacked,
    /// Held while a chunk is decoded, by its number: another thread that needs it waits.
    locks: [Mutex<()>; LOCKS],
}

/// A chunk of a source: number of the image (0, or 1 for the mask), and position.
#[derive(Clone, Copy)]
pub(crate) struct ChunkPosition {
    pub(crate) image: usize,
    pub(crate) plane: u64,
    pub(crate) across: u64,
    pub(crate) down: u64,
}

impl Sources {
    pub(crate) fn new(path: &Path, list: SourceList, pages: Section, access: &FileAccess) -> Sources {
        let mut first = 0;
        let firsts = list.pages.iter().map(|page| {
            first += page.sources;
            first - page.sources
        });
        let firsts = firsts.collect();
        let (open, decoders) = Default::default();
        Sources { path: path.into(), list, access: access.clone(), pages, firsts, open, decoders }
    }

    /// Returns the path or URL of a file by its name in the index.
    pub(crate) fn path_of(&self, name: &str) -> Result<PathBuf> {
        let path = listed_path(&self.path, name)?;
        self.access.check_external(&self.path, &path)?;
        Ok(path)
    }

    /// Reads a page of the section.
    fn page(&self, bytes: &dyn ReadBackend, at: Location, name: &str, max: usize) -> Result<Vec<u8>> {
        let corrupt = |found: String, expected: &str| Error::corrupt(&self.path, name, found, expected);
        if at.within(self.pages.length, max).is_none() {
            let found = format!("{} bytes at {}", at.length, at.offset);
            return Err(corrupt(found, "a page within the section"));
        }
        let page = bytes.share(self.pages.offset + at.offset, at.length as usize)?;
        let checksum = crc32c::crc32c(&page);
        match checksum == at.checksum {
            true => Ok(page.to_vec()),
            false => Err(corrupt(format!("checksum {checksum:08x}"), &format!("{:08x}", at.checksum))),
        }
    }

    /// Reads the descriptions of a page of sources, with the number of the first.
    pub(crate) fn read_page(
        &self,
        bytes: &dyn ReadBackend,
        page: usize,
    ) -> Result<(u32, Vec<IndexedSource>)> {
        let entry = self.list.pages[page];
        let stored = self.page(bytes, entry.location, SOURCE_PAGE.name, MAX_PAGE)?;
        let (sources, used): (Vec<IndexedSource>, usize) = SOURCE_PAGE.decode(&self.path, &stored)?;
        if sources.len() != entry.sources as usize || used != stored.len() {
            let found = format!("{} sources and {} other bytes", sources.len(), stored.len() - used);
            return Err(Error::corrupt(&self.path, SOURCE_PAGE.name, found, entry.sources.to_string()));
        }
        sources.iter().try_for_each(|source| self.check(source))?;
        Ok((self.firsts[page], sources))
    }

    /// Checks the description of a source.
    fn check(&self, source: &IndexedSource) -> Result<()> {
        let is_whole = |image: &SourceImage| {
            let Some(format) = self.list.formats.get(image.format as usize) else { return false };
            let plane = across(format, source).checked_mul(down(format, source));
            let chunks = plane.and_then(|chunks| chunks.checked_mul(format.planes as u64));
            chunks == Some(image.chunks)
                && image.table.len() as u64 == image.chunks.div_ceil(PAGE_CHUNKS as u64)
        };
        let mask = source.mask.as_ref().and_then(|mask| self.list.formats.get(mask.format as usize));
        let sample = self.list.formats.get(source.image.format as usize).map(|format| format.sample_format);
        let is_good = source.size.iter().all(|side| (1..1 << 31).contains(side))
            && is_whole(&source.image)
            && source.mask.as_ref().is_none_or(is_whole)
            && mask.is_none_or(|format| format.pixel_bytes() <= MAX_MASK_PIXEL)
            && sample.is_some_and(|sample| sample.sample().size() == source.hole.len());
        is_good.then_some(()).ok_or_else(|| {
            let found = format!("source {} with tables of other sizes than its chunks", source.name);
            Error::corrupt(&self.path, SOURCE_PAGE.name, found, "tables of all chunks")
        })
    }

    fn open_sources(&self) -> MutexGuard<'_, Vec<(u32, Arc<OpenSource>)>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a source by number. Its file is not opened.
    pub(crate) fn source(&self, bytes: &dyn ReadBackend, number: u32) -> Result<Arc<OpenSource>> {
        let known = || {
            let mut open = self.open_sources();
            let at = open.iter().rposition(|(known, _)| *known == number)?;
            let found = open.remove(at);
            open.push(found);
            open.last().map(|(_, source)| source.clone())
        };
        if let Some(source) = known() {
            return Ok(source);
        }
        // (The first page begins with source 0, and placements name only sources of the list.)
        let page = self.firsts.partition_point(|first| *first <= number) - 1;
        let (first, mut sources) = self.read_page(bytes, page)?;
        let source = Arc::new(self.opened(sources.swap_remove((number - first) as usize)));
        // (Another thread may have opened it meanwhile.)
        let mut open = self.open_sources();
        if let Some((_, source)) = open.iter().find(|(known, _)| *known == number) {
            return Ok(source.clone());
        }
        open.push((number, source.clone()));
        if open.len() > MAX_OPEN {
            open.remove(0);
        }
        Ok(source)
    }

    pub(crate) fn opened(&self, source: IndexedSource) -> OpenSource {
        let image = |image: Option<&SourceImage>| OpenImage {
            table: (0..image.map_or(0, |image| image.table.len())).map(|_| OnceLock::new()).collect(),
            decoded: Unpacked::new(&self.access, CHUNK_BITS),
            locks: std::array::from_fn(|_| Mutex::default()),
        };
        let images = [0, 1].map(|number| image(source.image(number)));
        OpenSource { source, file: OnceLock::new(), images }
    }

    /// Returns the format of an image of a source.
    pub(crate) fn format(&self, source: &IndexedSource, image: usize) -> &ChunkFormat {
        &self.list.formats[source.image(image).expect(IMAGE_EXISTS).format as usize]
    }

    /// Returns a decoder, which [`Sources::put_back`] takes back.
    pub(crate) fn decoder(&self) -> Decoder {
        self.decoders.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub(crate) fn put_back(&self, decoder: Decoder) {
        self.decoders.lock().unwrap_or_else(PoisonError::into_inner).push(decoder);
    }

    /// Returns where a chunk's compressed bytes are, according to the index.
    pub(crate) fn chunk_of(
        &self,
        bytes: &dyn ReadBackend,
        open: &OpenSource,
        at: ChunkPosition,
    ) -> Result<(u64, Chunk)> {
        let format = self.format(&open.source, at.image);
        let (across, down) = (across(format, &open.source), down(format, &open.source));
        let number = (at.plane * down + at.down) * across + at.across;
        let (page, within) = (number as usize / PAGE_CHUNKS, number as usize % PAGE_CHUNKS);
        let slot = &open.images[at.image].table[page];
        if let Some(table) = slot.get() {
            return Ok((number, table[within]));
        }
        let image = open.source.image(at.image).expect(IMAGE_EXISTS);
        let what = "table of chunks";
        let read;
        let stored = match &image.table[page] {
            Table::Here(table) => table,
            Table::At(location) => {
                read = self.page(bytes, *location, what, MAX_TABLE)?;
                &read
            }
        };
        let count = (image.chunks - (page * PAGE_CHUNKS) as u64).min(PAGE_CHUNKS as u64) as usize;
        let table = table::decode(stored, count).ok_or_else(|| {
            let found = format!("{} invalid bytes for {}", stored.len(), open.source.name);
            Error::corrupt(&self.path, what, found, format!("{count} chunks"))
        })?;
        Ok((number, slot.get_or_init(|| table)[within]))
    }

    /// Reads all tables of a source.
    pub(crate) fn check_tables(&self, bytes: &dyn ReadBackend, source: IndexedSource) -> Result<()> {
        let open = self.opened(source);
        for image in 0..2 {
            let Some(of_image) = open.source.image(image) else { continue };
            for number in (0..of_image.chunks).step_by(PAGE_CHUNKS) {
                self.chunk_of(bytes, &open, self.position(&open.source, image, number))?;
            }
        }
        Ok(())
    }

    /// Returns the position of a chunk by number.
    pub(crate) fn position(&self, source: &IndexedSource, image: usize, number: u64) -> ChunkPosition {
        let format = self.format(source, image);
        let (across, down) = (across(format, source), down(format, source));
        let (plane, rest) = (number / (across * down), number % (across * down));
        ChunkPosition { image, plane, across: rest % across, down: rest / across }
    }

    /// Returns a decoded chunk; `None` if it was never written.
    pub(crate) fn decoded(
        &self,
        bytes: &dyn ReadBackend,
        open: &OpenSource,
        at: ChunkPosition,
        decoder: &mut Decoder,
    ) -> Result<Option<CachedBytes>> {
        let (number, chunk) = self.chunk_of(bytes, open, at)?;
        if chunk.length == 0 {
            return Ok(None);
        }
        let decoded = &open.images[at.image].decoded;
        if let Some(known) = decoded.get(number) {
            return Ok(Some(known));
        }
        // Invariant: one thread decodes a chunk, the others wait and find it in the cache. A thread
        // holds at most one of these locks, and no thread that holds the lock of a cache or of a
        // file waits for one of them. So there is no deadlock.
        let lock = open.images[at.image].locks[number as usize % LOCKS].lock();
        let _lock = lock.unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = decoded.get(number) {
            return Ok(Some(known));
        }
        let made = self.decode(open, at, chunk, decoder)?;
        Ok(Some(decoded.put(number, Arc::new(made))))
    }

    /// Reads the compressed bytes of a chunk, checks and decodes them.
    fn decode(
        &self,
        open: &OpenSource,
        at: ChunkPosition,
        chunk: Chunk,
        decoder: &mut Decoder,
    ) -> Result<Vec<u8>> {
        let format = self.format(&open.source, at.image);
        let path = self.path_of(&open.source.name)?;
        if let Some(name) = format.unsupported() {
            let advice = "use the program, or a copy of the source with DEFLATE, LZW or ZSTD";
            return Err(Error::unsupported(
                &path,
                format!("{name} compression, which this build cannot decode"),
                advice,
            ));
        }
        let [x, y] = [at.across * format.chunk_width, at.down * format.chunk_height];
        let place = || format!("tile or strip at column {x}, row {y}");
        let expected = || {
            let index = spinney_container::shell_word(&self.path);
            format!(
                "the bytes that were indexed (`spinney index --update {index}` reads it again if its length \
                 or time has changed; otherwise make the index again)"
            )
        };
        let differs = |found: String| Error::corrupt(&path, place(), found, expected());
        let file = match self.file(open, &path) {
            // (An empty file.)
            Err(Error::Corrupt { found, .. }) => return Err(differs(found)),
            file => file?,
        };
        let most = format.max_stored_bytes();
        if chunk.length > most {
            return Err(Error::corrupt(
                &self.path,
                "table of chunks",
                format!("{} bytes for {}", chunk.length, place()),
                format!("at most {most}"),
            ));
        }
        if chunk.offset.checked_add(chunk.length).is_none_or(|end| end > file.len()) {
            return Err(differs(format!("a file of {} bytes", file.len())));
        }
        {
            let stored = file.share(chunk.offset, chunk.length as usize)?;
            let checksum = crc32c::crc32c(&stored);
            if checksum != chunk.checksum {
                return Err(differs(format!("checksum {checksum:08x}")));
            }
            decoder.raw.clear();
            decoder.raw.extend_from_slice(&stored);
        }
        let rows = format.chunk_height.min(open.source.size[1] - y) as usize;
        let mut decoded = Vec::new();
        format.decode(&mut decoder.states, &mut decoder.raw, rows, &mut decoded).map_err(|found| {
            let found = match &open.source.decoder {
                Some(decoder) => format!("{found}; {decoder} decoded it when it was indexed"),
                None => found,
            };
            Error::corrupt(&path, place(), found, "bytes of samples")
        })?;
        Ok(decoded)
    }

    /// Returns the file of a source. A remote one takes no request.
    fn file<'s>(&self, open: &'s OpenSource, path: &Path) -> Result<&'s dyn ReadBackend> {
        if let Some(file) = open.file.get() {
            return Ok(&**file);
        }
        let known = open.source.stat();
        // (Browsers have no local files: the client opens all.)
        let file = match url_of(path).is_some() || cfg!(target_family = "wasm") {
            true => self.access.open_known(path, &known)?,
            false => {
                // (Other programs may write to it while it is read, so it is not mapped.)
                let opened = self.access.peek(path).map_err(|error| match error {
                    Error::Io { cause, .. } => {
                        let doing =
                            "open, a source of an index (`spinney index --update` makes one of other files)";
                        Error::io(path, doing)(cause)
                    }
                    error => error,
                });
                let file = opened?;
                if file.stat()?.is_some_and(|found| !found.agrees(&known)) {
                    let text = "has another length or modification time than when it was indexed; \
                                its tiles are compared with the checksums in the index";
                    self.access.warn(path, text);
                }
                file
            }
        };
        Ok(&**open.file.get_or_init(|| file))
    }
}

/// Callers request only what [`IndexedSource::image`] has.
const IMAGE_EXISTS: &str = "an image of the source";

impl IndexedSource {
    /// Returns the image with a number: 0 for its pixels, 1 for its mask.
    pub(crate) fn image(&self, number: usize) -> Option<&SourceImage> {
        if number == 0 { Some(&self.image) } else { self.mask.as_ref() }
    }

    /// Returns length and version when it was indexed.
    pub fn stat(&self) -> FileStat {
        FileStat { length: self.length, version: self.version.clone() }
    }
}

/// Chunks in a row of a source.
fn across(format: &ChunkFormat, source: &IndexedSource) -> u64 {
    source.size[0].div_ceil(format.chunk_width)
}

/// Chunks in a column of a source.
fn down(format: &ChunkFormat, source: &IndexedSource) -> u64 {
    source.size[1].div_ceil(format.chunk_height)
}
