//! Remote files that are read in ranges of bytes.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};

use super::batch;
use super::cache::{CachedBytes, RangeCache};
use super::read::{FileBytes, ReadBackend};
use super::stat::FileStat;
use crate::{Error, Result};

/// Transport for the bytes of a remote file.
pub trait Fetch: Send + Sync {
    /// Fetches ranges, concurrently if possible, and returns their bytes in order.
    ///
    /// # Errors
    /// If a range cannot be fetched, or the file has changed.
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>>;

    /// Returns the bytes of a range from a persistent cache, for example on disk.
    fn load_cached(&self, _: &Range<u64>) -> Option<Vec<u8>> {
        None
    }

    /// Stores the bytes of a range in a persistent cache, if there is one.
    fn store_cached(&self, _: &Range<u64>, _: &[u8]) {}

    /// Returns the version of the file that is read, as its host reports it.
    fn version(&self) -> Option<FileStat> {
        None
    }

    /// Checks with the host that the file still has this version.
    ///
    /// # Errors
    /// If it has not, or the host does not respond.
    fn check_current(&self) -> Result<()> {
        self.fetch(&[Range { start: 0, end: 1 }]).map(drop)
    }
}

/// Default of the maximum gap, in bytes, between two ranges that are fetched with one request. So
/// many bytes cost less than a request.
pub const DEFAULT_GAP: u64 = 32 << 10;

/// Largest gap in files of which many small ranges are read: tiles of a TIFF file, and an index of
/// such files. Larger gaps would double the bytes, and save no time.
const SMALL_GAP: u64 = 4 << 10;

/// Maximum number of bytes per request, unless a single range is longer.
const MAX_JOINED: u64 = 8 << 20;

/// A file whose bytes are fetched in ranges and cached. Clones share the file.
#[derive(Clone)]
pub struct RangeFile(Arc<Shared>);

struct Shared {
    /// The file's number in the cache.
    number: u64,
    path: PathBuf,
    length: u64,
    fetch: Box<dyn Fetch>,
    cache: Arc<RangeCache>,
    gap: AtomicU64,
    /// Recent streams, the most recent one last.
    streams: Mutex<Vec<Stream>>,
    /// First bytes and ends of ranges that threads are fetching.
    under_way: Mutex<HashSet<(u64, u64)>>,
    /// Notified when ranges are removed from `under_way`.
    arrived: Condvar,
}

/// Consecutive reads outside of batches, as in a scan of the file. The bytes after them are read
/// ahead.
#[derive(Clone, Copy)]
struct Stream {
    /// End of the last read, with the bytes that were read ahead.
    end: u64,
    /// Length to which the last read was to be extended; 0 for a stream's first read, which is not
    /// extended. It doubles with each read, up to [`MAX_JOINED`].
    length: u64,
}

/// Maximum number of streams. A traversal reads a tree's segments in node order, but those of upper
/// levels are at other offsets than the rest.
const STREAMS: usize = 4;

/// Maximum number of bytes that a read may skip and still continue a stream.
const MAX_SKIPPED: u64 = 1 << 20;

/// Length to which a stream's second read is extended. (The maximum of later ones is
/// [`MAX_JOINED`], or an eighth of the cache.)
const FIRST_EXTENDED: u64 = 256 << 10;

impl RangeFile {
    /// Creates a file of `length` bytes with a number in a cache. The path is for messages.
    ///
    /// Ranges that are at most `gap` bytes apart are fetched with one request.
    pub fn new(
        path: &Path,
        length: u64,
        fetch: Box<dyn Fetch>,
        (cache, number): (Arc<RangeCache>, u64),
        gap: u64,
    ) -> RangeFile {
        batch::enable();
        let (streams, under_way, arrived) = (Mutex::default(), Mutex::default(), Condvar::new());
        RangeFile(Arc::new(Shared {
            number,
            path: path.to_path_buf(),
            length,
            fetch,
            cache,
            gap: gap.into(),
            streams,
            under_way,
            arrived,
        }))
    }

    /// Returns the file's number in its cache.
    pub fn number(&self) -> u64 {
        self.0.number
    }

    /// Whether its ranges are stored in this cache.
    pub fn uses(&self, cache: &Arc<RangeCache>) -> bool {
        Arc::ptr_eq(&self.0.cache, cache)
    }

    /// Returns the path for messages.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Returns the cache's limit in bytes.
    pub(super) fn cache_limit(&self) -> u64 {
        self.0.cache.limit()
    }

    /// Adds bytes that were fetched, from an offset on, to the cache.
    pub fn supply(&self, offset: u64, bytes: Vec<u8>) {
        self.0.cache.put(self.0.number, offset, Arc::new(bytes));
    }

    /// Fetches ranges, in ascending order of their first bytes, into the cache, and returns their
    /// bytes. Waits for ranges that another thread is fetching.
    ///
    /// A range is registered in `under_way` by exactly one thread. All others wait for it, but not
    /// before their own ranges have arrived, so that threads never wait for each other in a cycle.
    pub(super) fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Arc<Vec<u8>>>> {
        let key = |range: &Range<u64>| (range.start, range.end);
        let under_way = || self.0.under_way.lock().unwrap_or_else(PoisonError::into_inner);
        let (own, others): (Vec<Range<u64>>, Vec<Range<u64>>) = {
            let mut all = under_way();
            ranges.iter().cloned().partition(|range| all.insert(key(range)))
        };
        let cached =
            |range: &Range<u64>| self.0.cache.get(self.0.number, range).map(|bytes| Arc::new(bytes.to_vec()));
        let mut bytes_of: HashMap<(u64, u64), Arc<Vec<u8>>> = HashMap::new();
        {
            let _arriving = Arriving { file: &self.0, ranges: &own };
            // Another thread may have fetched some of them since the caller checked the cache.
            bytes_of.extend(own.iter().filter_map(|range| Some((key(range), cached(range)?))));
            let missing: Vec<_> =
                own.iter().filter(|range| !bytes_of.contains_key(&key(range))).cloned().collect();
            bytes_of.extend(missing.iter().map(key).zip(self.fetch_and_cache(&missing)?));
        }
        for range in &others {
            let waits = self.0.arrived.wait_while(under_way(), |all| all.contains(&key(range)));
            drop(waits.unwrap_or_else(PoisonError::into_inner));
            // The other thread may have failed, or its bytes may have been evicted. Then several
            // waiting threads may fetch the range twice, as it is not registered again. This is
            // rare, and the cache holds its bytes once.
            let bytes = match cached(range) {
                Some(bytes) => bytes,
                None => self.fetch_and_cache(std::slice::from_ref(range))?.swap_remove(0),
            };
            bytes_of.insert(key(range), bytes);
        }
        Ok(ranges.iter().filter_map(|range| bytes_of.get(&key(range)).cloned()).collect())
    }

    /// Fetches ranges into the cache, from the persistent cache or the host, and returns their
    /// bytes in order. Does not check whether another thread is fetching them.
    fn fetch_and_cache(&self, ranges: &[Range<u64>]) -> Result<Vec<Arc<Vec<u8>>>> {
        let Shared { fetch, cache, number, .. } = &*self.0;
        // Bytes per range; `None` while they are missing.
        let mut loaded: Vec<Option<Vec<u8>>> = ranges.iter().map(|range| fetch.load_cached(range)).collect();
        let missing = ranges.iter().zip(&loaded).filter(|(_, bytes)| bytes.is_none());
        let missing: Vec<Range<u64>> = missing.map(|(range, _)| range.clone()).collect();
        let mut fetched = self.fetch_joined(&missing)?.into_iter().zip(&missing);
        for slot in loaded.iter_mut().filter(|bytes| bytes.is_none()) {
            let (bytes, range) = fetched.next().expect("as many as were missing");
            fetch.store_cached(range, &bytes);
            *slot = Some(bytes);
        }
        let all = loaded.into_iter().flatten().zip(ranges).map(|(bytes, range)| {
            let bytes = Arc::new(bytes);
            cache.put(*number, range.start, bytes.clone());
            bytes
        });
        Ok(all.collect())
    }

    /// Fetches ranges, in ascending order of their first bytes. Those near each other share a
    /// request.
    fn fetch_joined(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        if ranges.is_empty() {
            return Ok(Vec::new());
        }
        let joined = join(ranges, self.0.gap.load(Ordering::Relaxed));
        let requests: Vec<Range<u64>> = joined.iter().map(|(whole, _)| whole.clone()).collect();
        let responses = self.0.fetch.fetch(&requests)?;
        if responses.len() != requests.len() {
            let (found, expected) = (format!("{} ranges", responses.len()), format!("{}", requests.len()));
            return Err(Error::corrupt(self.path(), "response of the host", found, expected));
        }
        let received = responses.iter().map(|bytes| bytes.len() as u64).sum();
        self.0.cache.count_traffic(requests.len() as u64, received);
        let mut fetched = Vec::with_capacity(ranges.len());
        for ((whole, count), bytes) in joined.into_iter().zip(responses) {
            let length = whole.end - whole.start;
            if bytes.len() as u64 != length {
                let location = format!("bytes {} to {}", whole.start, whole.end);
                let found = format!("{} bytes", bytes.len());
                return Err(Error::corrupt(self.path(), location, found, format!("{length}")));
            }
            if count == 1 {
                fetched.push(bytes);
                continue;
            }
            let contained = &ranges[fetched.len()..fetched.len() + count];
            let index = |offset: u64| (offset - whole.start) as usize;
            fetched
                .extend(contained.iter().map(|range| bytes[index(range.start)..index(range.end)].to_vec()));
        }
        Ok(fetched)
    }

    /// Extends a range that is read outside of batches by bytes to read ahead, if it continues a
    /// stream and is shorter than a read of the stream should be.
    fn with_read_ahead(&self, range: &Range<u64>) -> Range<u64> {
        let mut streams = self.0.streams.lock().unwrap_or_else(PoisonError::into_inner);
        let follows = |stream: &Stream| (stream.end..=stream.end + MAX_SKIPPED).contains(&range.start);
        let known = streams.iter().position(follows).map(|at| streams.remove(at));
        let length = known.map_or(0, |stream| (2 * stream.length).clamp(FIRST_EXTENDED, MAX_JOINED));
        let extended = range.start + length.min(self.0.cache.limit() / 8);
        let end = range.end.max(extended).min(self.0.length);
        streams.push(Stream { end, length });
        if streams.len() > STREAMS {
            streams.remove(0);
        }
        range.start..end
    }
}

/// Ranges that a thread is fetching. Dropping it, also on failure or panic, lets other threads
/// continue.
struct Arriving<'a> {
    file: &'a Shared,
    ranges: &'a [Range<u64>],
}

impl Drop for Arriving<'_> {
    fn drop(&mut self) {
        let mut all = self.file.under_way.lock().unwrap_or_else(PoisonError::into_inner);
        for range in self.ranges {
            all.remove(&(range.start, range.end));
        }
        self.file.arrived.notify_all();
    }
}

/// Joins ranges near each other. The input is in ascending order of first bytes. Returns the joined
/// ranges, and how many ranges each contains.
fn join(ranges: &[Range<u64>], gap: u64) -> Vec<(Range<u64>, usize)> {
    let mut joined: Vec<(Range<u64>, usize)> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some((whole, count))
                if range.start <= whole.end.saturating_add(gap)
                    && range.end.saturating_sub(whole.start) <= MAX_JOINED =>
            {
                whole.end = whole.end.max(range.end);
                *count += 1;
            }
            _ => joined.push((range.clone(), 1)),
        }
    }
    joined
}

impl ReadBackend for RangeFile {
    fn reads_small_ranges(&self) {
        // (The user's choice is kept.)
        let _ = self.0.gap.compare_exchange(DEFAULT_GAP, SMALL_GAP, Ordering::Relaxed, Ordering::Relaxed);
    }

    fn len(&self) -> u64 {
        self.0.length
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn version(&self) -> Result<Option<FileStat>> {
        Ok(self.0.fetch.version())
    }

    fn check_remote(&self) -> Result<()> {
        self.0.cache.count_traffic(1, 1);
        self.0.fetch.check_current()
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        Ok(Cow::Owned(self.share(offset, length)?.to_vec()))
    }

    fn share(&self, offset: u64, length: usize) -> Result<FileBytes<'_>> {
        let range = offset..offset + length as u64;
        if range.is_empty() {
            return Ok(FileBytes::Mapped(&[]));
        }
        if let Some(cached) = self.0.cache.get(self.0.number, &range) {
            return Ok(FileBytes::Cached(cached));
        }
        if batch::record_missing(self, &range) {
            return Err(Error::NotFetched);
        }
        let extended = self.with_read_ahead(&range);
        let bytes = self.fetch(std::slice::from_ref(&extended))?.pop().expect("as many as were requested");
        Ok(FileBytes::Cached(CachedBytes::from(bytes).part(0..length)))
    }

    fn has_cache(&self) -> bool {
        true
    }

    fn prefetch(&self, ranges: &[Range<u64>]) -> Result<()> {
        let is_cached = |range: &Range<u64>| self.0.cache.get(self.0.number, range).is_some();
        let missing = ranges.iter().filter(|range| !range.is_empty() && !is_cached(range));
        let mut missing: Vec<Range<u64>> = missing.cloned().collect();
        crate::sort::by_key(&mut missing, |range| range.start);
        if missing.is_empty() {
            return Ok(());
        }
        // (`any` would stop at the first range, and leave the others to later batches.)
        if missing.iter().filter(|range| batch::record_missing(self, range)).count() > 0 {
            return Err(Error::NotFetched);
        }
        self.fetch(&missing).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::batch::{defer_missing, finish_deferred, run_batched};
    use crate::parallel;
    use std::sync::Mutex;

    /// Bytes in memory, and the ranges of each fetch.
    struct Counted {
        bytes: Vec<u8>,
        batches: Arc<Mutex<Vec<Vec<Range<u64>>>>>,
    }

    impl Fetch for Counted {
        fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
            self.batches.lock().unwrap().push(ranges.to_vec());
            let part = |range: &Range<u64>| self.bytes[range.start as usize..range.end as usize].to_vec();
            Ok(ranges.iter().map(part).collect())
        }
    }

    type Batches = Arc<Mutex<Vec<Vec<Range<u64>>>>>;

    fn file(limit: u64) -> (RangeFile, Batches) {
        let batches = Batches::default();
        let bytes = (0..100_000u32).map(|at| (at % 251) as u8).collect();
        let fetch = Box::new(Counted { bytes, batches: batches.clone() });
        let cache = (Arc::new(RangeCache::new(limit)), RangeCache::file_number());
        (RangeFile::new(Path::new("x"), 100_000, fetch, cache, 10), batches)
    }

    #[test]
    fn checks_query_the_host_even_if_bytes_are_cached() {
        let (far, batches) = file(1 << 20);
        far.read(0, 1000).unwrap();
        far.check_remote().unwrap();
        far.check_remote().unwrap();
        let first_byte = Range { start: 0, end: 1 };
        assert_eq!(batches.lock().unwrap()[1..], [vec![first_byte.clone()], vec![first_byte]]);
        // Reads check each response, so that no further request is needed.
        assert!(matches!((far.stat(), far.version()), (Ok(None), Ok(None))));
    }

    /// Sums bytes at offsets that are read from the file: many branches, two dependent reads each.
    fn query_two_reads(file: &RangeFile) -> Result<u64> {
        let mut is_unread = false;
        let mut sum = 0;
        for branch in 0..50u64 {
            let first = defer_missing(file.share(branch * 1000, 4), &mut is_unread)?;
            let Some(first) = first else { continue };
            let next = u64::from(first[0]) * 300 + 7;
            let bytes = defer_missing(file.share(next, 100), &mut is_unread)?;
            sum += bytes.map_or(0, |bytes| bytes.iter().map(|byte| u64::from(*byte)).sum());
        }
        finish_deferred(is_unread).map(|()| sum)
    }

    #[test]
    fn dependent_reads_take_one_batch_each() {
        let (far, batches) = file(1 << 20);
        let expected = query_two_reads(&far).unwrap();
        // Outside of batches every read waits.
        assert!(batches.lock().unwrap().len() >= 2);
        let (far, batches) = file(1 << 20);
        assert_eq!(run_batched(|| query_two_reads(&far)).unwrap(), expected);
        assert_eq!(batches.lock().unwrap().len(), 2);
        assert_eq!(batches.lock().unwrap()[0].len(), 50);
        // Cached bytes are not fetched again.
        assert_eq!(run_batched(|| query_two_reads(&far)).unwrap(), expected);
        assert_eq!(batches.lock().unwrap().len(), 2);
        // If the cache is too small, the query takes more batches.
        let (far, batches) = file(600);
        assert_eq!(run_batched(|| query_two_reads(&far)).unwrap(), expected);
        assert!(batches.lock().unwrap().len() >= 2);
    }

    #[test]
    fn threads_belong_to_the_batch_of_their_query() {
        let (far, batches) = file(1 << 20);
        let offsets: Vec<u64> = (0..64).map(|at| at * 1500).collect();
        let sum = run_batched(|| {
            let found =
                parallel::map(&offsets, |offset| far.share(*offset, 1).map(|bytes| u64::from(bytes[0])));
            found.into_iter().sum::<Result<u64>>()
        });
        assert_eq!(sum.unwrap(), offsets.iter().map(|offset| offset % 251).sum());
        let batches = batches.lock().unwrap();
        assert_eq!(batches.iter().map(Vec::len).collect::<Vec<_>>(), [64]);
    }

    #[test]
    fn ranges_that_are_being_fetched_are_not_requested_twice() {
        let (far, batches) = file(1 << 20);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| assert_eq!(query_two_reads(&far).unwrap(), query_two_reads(&far).unwrap()));
                scope.spawn(|| run_batched(|| query_two_reads(&far)).unwrap());
            }
        });
        let batches = batches.lock().unwrap();
        let mut all: Vec<&Range<u64>> = batches.iter().flatten().collect();
        let count = all.len();
        crate::sort::by(&mut all, &mut |a, b| (a.start, a.end).cmp(&(b.start, b.end)));
        all.dedup();
        // A thread that has joined ranges has requested a different range.
        assert!(count <= all.len() + 8, "{count} of {}", all.len());
    }

    #[test]
    fn ranges_that_another_thread_has_fetched_are_not_fetched_again() {
        let (far, batches) = file(1 << 20);
        let mut other = Some(|| run_batched(|| query_two_reads(&far)).unwrap());
        run_batched(|| {
            let missing = query_two_reads(&far);
            // Between the detection of missing ranges and their fetch.
            if let Some(other) = other.take() {
                std::thread::scope(|scope| scope.spawn(other).join()).unwrap();
            }
            missing
        })
        .unwrap();
        assert_eq!(batches.lock().unwrap().len(), 2);
    }

    #[test]
    fn adjacent_ranges_share_a_request() {
        let (far, batches) = file(1 << 20);
        far.prefetch(&[500..510, 0..20, 25..40, 520..530, 600..600]).unwrap();
        assert_eq!(batches.lock().unwrap()[..], [vec![0..40, 500..530]]);
        assert_eq!(&*far.read(26, 3).unwrap(), [26, 27, 28]);
        far.prefetch(&[500..510, 600..600]).unwrap();
        assert_eq!(batches.lock().unwrap().len(), 1);
        assert_eq!(&*far.read(0, 20).unwrap(), (0..20).collect::<Vec<u8>>());
    }

    #[test]
    fn sequential_reads_read_ahead() {
        let (far, batches) = file(1 << 20);
        let read: Vec<u8> =
            (0..100u64).flat_map(|part| far.read(part * 1000, 1000).unwrap().to_vec()).collect();
        assert!(
            read.iter().zip(0u32..).all(|(byte, at)| u32::from(*byte) == at % 251) && read.len() == 100_000
        );
        assert_eq!(
            batches.lock().unwrap()[..],
            [vec![Range { start: 0, end: 1000 }], vec![Range { start: 1000, end: 100_000 }]]
        );
    }

    #[test]
    fn longer_ranges_from_the_same_byte_do_not_count_as_evicted() {
        let (far, batches) = file(1 << 20);
        let query = || {
            far.share(0, 64)?;
            far.share(0, 4096)?;
            let mut is_unread = false;
            for offset in [10_000, 20_000, 30_000] {
                defer_missing(far.share(offset, 1), &mut is_unread)?;
            }
            finish_deferred(is_unread)
        };
        run_batched(query).unwrap();
        assert_eq!(batches.lock().unwrap().iter().map(Vec::len).collect::<Vec<_>>(), [1, 1, 3]);
    }

    #[test]
    fn queries_without_progress_end() {
        // Each pass reads a new offset.
        let (far, _) = file(1 << 20);
        let mut offset = 0;
        let end = run_batched(|| {
            offset += 100;
            far.share(offset, 1).map(|bytes| bytes[0])
        });
        assert_eq!(end.unwrap(), ((257 * 100) % 251) as u8);
    }
}
