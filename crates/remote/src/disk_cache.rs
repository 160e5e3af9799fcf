//! On-disk cache of file ranges, kept between runs.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use spinney_base::io::open_regular;
use spinney_base::{Error, Result, sort};
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// A cache directory, with a subdirectory for each version of a file.
pub(super) struct DiskCache {
    directory: PathBuf,
}

/// The cached ranges of one version of a file.
pub(super) struct CachedFile {
    directory: PathBuf,
}

/// Name of the cache inside the directory that the user chose. Only files in it are ever removed.
const NAME: &str = "spinney-ranges";

impl DiskCache {
    /// Opens the cache in a directory, which is created if missing. Removes the oldest ranges until
    /// at most `most` bytes remain.
    ///
    /// # Errors
    /// If the directory cannot be created or read.
    pub(super) fn new(directory: &Path, most: u64) -> Result<DiskCache> {
        let directory = directory.join(NAME);
        fs::create_dir_all(&directory).map_err(Error::io(&directory, "create the directory"))?;
        trim(&directory, most).map_err(Error::io(&directory, "list the directory"))?;
        Ok(DiskCache { directory })
    }

    /// The ranges of a file version, which `key` identifies.
    pub(super) fn file(&self, key: &str) -> CachedFile {
        CachedFile { directory: self.directory.join(format!("{:032x}", xxh3_128(key.as_bytes()))) }
    }
}

/// Removes the oldest ranges until at most `most` bytes remain.
fn trim(directory: &Path, most: u64) -> std::io::Result<()> {
    let mut all: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
    for file in fs::read_dir(directory)? {
        let file = file?.path();
        // Another process may have removed it.
        let Ok(ranges) = fs::read_dir(&file) else { continue };
        for range in ranges.flatten() {
            let Ok(metadata) = range.metadata() else { continue };
            all.push((metadata.modified()?, metadata.len(), range.path()));
        }
    }
    let mut bytes: u64 = all.iter().map(|(_, length, _)| length).sum();
    sort::by(&mut all, &mut Ord::cmp);
    for (_, length, path) in all {
        if bytes <= most {
            break;
        }
        bytes -= length;
        let _ = fs::remove_file(&path);
        // Removes the directory if it is empty now; fails otherwise.
        let _ = path.parent().map(fs::remove_dir);
    }
    Ok(())
}

impl CachedFile {
    fn path(&self, range: &Range<u64>) -> PathBuf {
        self.directory.join(format!("{}-{}", range.start, range.end))
    }

    /// Returns the bytes of a range if they are cached and match their checksum.
    pub(super) fn get(&self, range: &Range<u64>) -> Option<Vec<u8>> {
        // Other programs may write to this directory. Reading a pipe or a link to a device would
        // never end.
        let mut file = open_regular(File::options().read(true), &self.path(range)).ok()?;
        let length = range.end.checked_sub(range.start)?.checked_add(8)?;
        if file.metadata().ok()?.len() != length {
            return None;
        }
        let mut bytes = Vec::new();
        (&mut file).take(length).read_to_end(&mut bytes).ok()?;
        let sum = bytes.split_off(bytes.len().checked_sub(8)?);
        let is_whole = bytes.len() as u64 == range.end - range.start && sum == xxh3_64(&bytes).to_le_bytes();
        is_whole.then_some(bytes)
    }

    /// Caches the bytes of a range. Errors are ignored: the range is fetched again next time.
    pub(super) fn put(&self, range: &Range<u64>, bytes: &[u8]) {
        let _ = self.write(range, bytes);
    }

    fn write(&self, range: &Range<u64>, bytes: &[u8]) -> std::io::Result<()> {
        fs::create_dir_all(&self.directory)?;
        // Publish atomically: other processes may read at the same time.
        let mut file = tempfile::NamedTempFile::new_in(&self.directory)?;
        file.write_all(bytes)?;
        file.write_all(&xxh3_64(bytes).to_le_bytes())?;
        file.persist(self.path(range))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cached_ranges_are_returned_unchanged_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let cache = DiskCache::new(directory.path(), 1 << 20).unwrap();
        let file = cache.file("https://host/x\ntag");
        assert_eq!(file.get(&(3..6)), None);
        file.put(&(3..6), b"abc");
        assert_eq!(file.get(&(3..6)), Some(b"abc".to_vec()));
        assert_eq!(cache.file("https://host/x\nother").get(&(3..6)), None);
        fs::write(file.path(&(3..6)), b"abd\0\0\0\0\0\0\0\0").unwrap();
        assert_eq!(file.get(&(3..6)), None);
        fs::write(file.path(&(3..6)), b"ab").unwrap();
        assert_eq!(file.get(&(3..6)), None);
        // Ranges over the limit are removed.
        file.put(&(3..6), b"abc");
        file.put(&(10..13), b"abc");
        DiskCache::new(directory.path(), 11).unwrap();
        assert_eq!([3..6, 10..13].iter().filter(|range| file.get(range).is_some()).count(), 1);
        DiskCache::new(directory.path(), 0).unwrap();
        assert_eq!(fs::read_dir(directory.path().join(NAME)).unwrap().count(), 0);
    }
}
