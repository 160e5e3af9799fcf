//! Records of the files that are read while an index is made.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use spinney_base::io::{FileAccess, FileStat, InputFile};
use spinney_base::{Error, Progress, Result};
use spinney_chunks::ChunkFormat;
use spinney_container::VersionedSection;
use spinney_references::Chunk;

/// Files that are statted at a time.
const STATTED: usize = 1024;

/// Bytes that are read at a time for checksums.
const READ_BYTES: u64 = 1 << 20;

/// Checksums that a shard of an index has recorded.
const CHECKSUMS: VersionedSection<{ 256 << 20 }> =
    VersionedSection { name: "checksums of sources", version: 1 };

/// A file, the offset of the page's directory, and checksums by number of the chunk: of its image
/// and its mask.
type SourceChecksums = (String, u64, [Vec<(u64, u32)>; 2]);

/// The files that are read while an index is made.
#[derive(Debug, Default)]
pub struct SourceRecorder(Mutex<Records>);

#[derive(Debug, Default)]
struct Records {
    all: Vec<Arc<RecordedSource>>,
    /// Numbers by path and offset of the page's directory.
    numbers: HashMap<(PathBuf, u64), usize>,
    /// Virtual rasters that arrange the files.
    virtual_rasters: BTreeMap<PathBuf, FileStat>,
}

/// A file, or a page of one.
#[derive(Debug)]
pub(crate) struct RecordedSource {
    pub(crate) path: PathBuf,
    pub(crate) stat: FileStat,
    /// Number of its page, from 0.
    pub(crate) page: u32,
    /// Columns and rows.
    pub(crate) size: [u64; 2],
    pub(crate) image: RecordedImage,
    pub(crate) mask: Option<RecordedImage>,
    /// The sample of chunks that were never written.
    pub(crate) hole: Vec<u8>,
}

impl RecordedSource {
    /// Returns its image, and its mask if it has one.
    pub(crate) fn images(&self) -> impl Iterator<Item = &RecordedImage> {
        [Some(&self.image), self.mask.as_ref()].into_iter().flatten()
    }
}

/// An image of a file: its pixels or its mask.
#[derive(Clone, Debug)]
pub(crate) struct RecordedImage {
    pub(crate) format: ChunkFormat,
    pub(crate) chunks: Arc<RecordedChunks>,
}

/// The chunks of an image, and the checksums of those that were read.
#[derive(Debug)]
pub(crate) struct RecordedChunks {
    /// Offsets and lengths; 0 bytes if a chunk was never written.
    locations: Vec<(u64, u64)>,
    /// Checksums, plus 2^32 if they are known.
    checksums: Vec<AtomicU64>,
}

impl RecordedChunks {
    /// Chunks of which none was read.
    pub(crate) fn new(locations: Vec<(u64, u64)>) -> RecordedChunks {
        let checksums = locations.iter().map(|_| AtomicU64::new(0)).collect();
        RecordedChunks { locations, checksums }
    }

    /// Chunks whose checksums are known.
    pub(crate) fn known(chunks: &[Chunk]) -> RecordedChunks {
        let recorded = RecordedChunks::new(chunks.iter().map(|chunk| (chunk.offset, chunk.length)).collect());
        chunks.iter().enumerate().for_each(|(number, chunk)| recorded.set(number, chunk.checksum));
        recorded
    }

    /// Records the stored bytes of a chunk, before bit order and compression: readers compare them
    /// before they decode. Chunks that come from a cache are not recorded here but completed later.
    pub(crate) fn record(&self, number: u64, bytes: &[u8]) {
        self.set(number as usize, crc32c::crc32c(bytes));
    }

    fn set(&self, number: usize, checksum: u32) {
        self.checksums[number].store(1 << 32 | u64::from(checksum), Ordering::Relaxed);
    }

    /// Returns the chunks, all of whose checksums are known.
    pub(crate) fn chunks(&self) -> Vec<Chunk> {
        let chunk = |((offset, length), checksum): (&(u64, u64), &AtomicU64)| Chunk {
            offset: if *length == 0 { 0 } else { *offset },
            length: *length,
            checksum: checksum.load(Ordering::Relaxed) as u32,
        };
        self.locations.iter().zip(&self.checksums).map(chunk).collect()
    }

    /// Reads the chunks that were not read, since others hide them.
    fn complete(&self, path: &Path, file: &InputFile, progress: &dyn Progress) -> Result<()> {
        let mut buffer = Vec::new();
        for (number, (offset, length)) in self.locations.iter().enumerate() {
            if *length == 0 || self.checksums[number].load(Ordering::Relaxed) != 0 {
                continue;
            }
            progress.check()?;
            let mut checksum = 0;
            for at in (0..*length).step_by(READ_BYTES as usize) {
                buffer.resize(READ_BYTES.min(length - at) as usize, 0);
                file.read_at(offset + at, &mut buffer).map_err(Error::io(path, "read"))?;
                checksum = crc32c::crc32c_append(checksum, &buffer);
            }
            self.set(number, checksum);
        }
        Ok(())
    }

    /// Returns the known checksums, by number of the chunk.
    fn known_checksums(&self) -> Vec<(u64, u32)> {
        let all = (0..).zip(&self.checksums).map(|(number, known)| (number, known.load(Ordering::Relaxed)));
        all.filter(|(_, known)| *known != 0).map(|(number, known)| (number, known as u32)).collect()
    }

    fn is_complete(&self) -> bool {
        let mut chunks = self.locations.iter().zip(&self.checksums);
        chunks.all(|((_, length), checksum)| *length == 0 || checksum.load(Ordering::Relaxed) != 0)
    }
}

impl SourceRecorder {
    fn records(&self) -> std::sync::MutexGuard<'_, Records> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Records a file that was opened, or finds its record; returns its number and the record.
    ///
    /// # Errors
    /// If the file has changed since it was opened for the first time.
    pub(crate) fn record(
        &self,
        (path, directory): (&Path, u64),
        stat: FileStat,
        describe: &dyn Fn(FileStat) -> RecordedSource,
    ) -> Result<(usize, Arc<RecordedSource>)> {
        let key = (path.to_path_buf(), directory);
        let known = {
            let records = self.records();
            records.numbers.get(&key).map(|number| (*number, records.all[*number].clone()))
        };
        if let Some((number, known)) = known {
            return match known.stat == stat {
                true => Ok((number, known)),
                false => Err(Error::Changed { path: path.into(), what: "was overwritten" }),
            };
        }
        let described = Arc::new(describe(stat));
        let mut records = self.records();
        // (Another thread may have recorded the same file meanwhile.)
        let Records { all, numbers, .. } = &mut *records;
        let number = *numbers.entry(key).or_insert_with(|| {
            all.push(described);
            all.len() - 1
        });
        Ok((number, all[number].clone()))
    }

    /// Returns the checksums of all chunks that were read, for [`SourceRecorder::restore`].
    ///
    /// # Errors
    /// If they are too many. `path` is for messages.
    pub fn checksums(&self, path: &Path) -> Result<Vec<u8>> {
        let records = self.records();
        let of_source = |((source, directory), number): (&(PathBuf, u64), &usize)| {
            let recorded = &records.all[*number];
            let images = [Some(&recorded.image), recorded.mask.as_ref()];
            let known = images.map(|image| image.map_or(Vec::new(), |image| image.chunks.known_checksums()));
            (source.to_string_lossy().into_owned(), *directory, known)
        };
        let mut all: Vec<SourceChecksums> = records.numbers.iter().map(of_source).collect();
        spinney_base::sort::by(&mut all, &mut |a, b| (&a.0, a.1).cmp(&(&b.0, b.1)));
        CHECKSUMS.encode(&all).ok_or_else(|| {
            Error::unsupported(path, "a shard with checksums of more than 256 MiB", "plan more shards")
        })
    }

    /// Adds checksums that another process has recorded of the same files. `path` is for messages.
    ///
    /// # Errors
    /// If they are corrupt.
    pub fn restore(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let (all, _): (Vec<SourceChecksums>, usize) = CHECKSUMS.decode(path, bytes)?;
        let records = self.records();
        for (source, directory, known) in all {
            let Some(number) = records.numbers.get(&(PathBuf::from(source), directory)) else { continue };
            let recorded = &records.all[*number];
            let images = [Some(&recorded.image), recorded.mask.as_ref()];
            for (image, known) in images.into_iter().zip(known) {
                let Some(image) = image else { continue };
                for (number, checksum) in known {
                    if number >= image.chunks.locations.len() as u64 {
                        let found = format!("chunk {number} of {}", recorded.path.display());
                        return Err(Error::corrupt(path, CHECKSUMS.name, found, "one of its chunks"));
                    }
                    image.chunks.set(number as usize, checksum);
                }
            }
        }
        Ok(())
    }

    /// Records a virtual raster that arranges files.
    pub(crate) fn record_virtual(&self, path: &Path, stat: FileStat) {
        self.records().virtual_rasters.insert(path.to_path_buf(), stat);
    }

    /// Returns the virtual rasters, sorted by path.
    pub(crate) fn virtual_rasters(&self) -> BTreeMap<PathBuf, FileStat> {
        self.records().virtual_rasters.clone()
    }

    /// Adds the record of a file that is not opened; returns its number.
    pub(crate) fn add(&self, source: RecordedSource) -> usize {
        let mut records = self.records();
        records.all.push(Arc::new(source));
        records.all.len() - 1
    }

    /// Returns a record by number.
    pub(crate) fn get(&self, number: usize) -> Arc<RecordedSource> {
        self.records().all[number].clone()
    }

    /// Completes the checksums of files, and checks that none was changed while it was read.
    pub(crate) fn complete(
        &self,
        numbers: &[usize],
        access: &FileAccess,
        progress: &dyn Progress,
    ) -> Result<()> {
        let sources: Vec<Arc<RecordedSource>> = numbers.iter().map(|number| self.get(*number)).collect();
        for source in &sources {
            progress.check()?;
            let left: Vec<&RecordedImage> =
                source.images().filter(|image| !image.chunks.is_complete()).collect();
            if !left.is_empty() {
                let file = access.input(&source.path)?;
                left.iter().try_for_each(|image| image.chunks.complete(&source.path, &file, progress))?;
            }
        }
        for some in sources.chunks(STATTED) {
            progress.check()?;
            let paths: Vec<&Path> = some.iter().map(|source| &*source.path).collect();
            for (source, found) in some.iter().zip(access.stat(&paths)?) {
                if found? != Some(source.stat.clone()) {
                    return Err(Error::Changed { path: source.path.clone(), what: "was overwritten" });
                }
            }
        }
        Ok(())
    }
}

/// Returns length and version of a file.
///
/// # Errors
/// If it is missing, or cannot be statted.
pub(crate) fn stat(path: &Path, access: &FileAccess) -> Result<FileStat> {
    let found = access.stat(&[path])?.pop().transpose()?.flatten();
    let missing = || std::io::Error::new(std::io::ErrorKind::NotFound, "no such file");
    found.ok_or_else(|| Error::io(path, "open")(missing()))
}
