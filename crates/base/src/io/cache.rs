//! Caches of bytes that were read recently, for files that are not mapped.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::{Deref, Range};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::batch::Traffic;
use super::read::{FileBytes, ReadBackend};
use super::stat::FileStat;
use crate::Result;

/// Least-recently-used cache of file ranges, limited in bytes. Any number of threads and files may
/// share one.
///
/// A range is also found within a longer cached range.
pub struct RangeCache {
    /// Maximum number of bytes.
    limit: AtomicU64,
    state: Mutex<State>,
    /// Batches, requests and bytes that were fetched for the cache.
    traffic: [AtomicU64; 3],
}

/// Number of a file in a cache, and the first byte of a range.
type RangeKey = (u64, u64);

#[derive(Default)]
struct State {
    /// Bytes that are cached, and their maximum so far.
    held: u64,
    most: u64,
    /// Number of uses so far, which is the time of the next use.
    time: u64,
    /// No range lies within another one of the same file. So only the last range that starts at or
    /// before an offset can contain it.
    ranges: BTreeMap<RangeKey, Cached>,
    /// Ranges by the time of their last use. A linear search for the oldest range would take
    /// quadratic time if an untrusted file has very many small ranges.
    by_time: BTreeMap<u64, RangeKey>,
}

struct Cached {
    last_use: u64,
    bytes: Arc<Vec<u8>>,
}

impl RangeCache {
    /// Creates a cache of at most `limit` bytes. It always holds the range that was added last.
    pub fn new(limit: u64) -> RangeCache {
        RangeCache { limit: limit.into(), state: Mutex::default(), traffic: Default::default() }
    }

    /// Returns the maximum number of bytes.
    pub fn limit(&self) -> u64 {
        self.limit.load(Ordering::Relaxed)
    }

    /// Changes the maximum number of bytes. It takes effect when the next range is added.
    pub fn set_limit(&self, limit: u64) {
        self.limit.store(limit, Ordering::Relaxed);
    }

    /// Returns a unique number for a file.
    pub fn file_number() -> u64 {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        NEXT.fetch_add(1, Ordering::Relaxed)
    }

    /// Returns the requests so far for files whose ranges are cached here.
    pub fn traffic(&self) -> Traffic {
        let [batches, requests, bytes] = self.traffic.each_ref().map(|count| count.load(Ordering::Relaxed));
        Traffic { batches, requests, bytes }
    }

    /// Counts a batch of requests and the bytes received.
    pub fn count_traffic(&self, requests: u64, bytes: u64) {
        for (counter, count) in self.traffic.iter().zip([1, requests, bytes]) {
            counter.fetch_add(count, Ordering::Relaxed);
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the bytes of a file's range, if they are cached.
    pub fn get(&self, file: u64, range: &Range<u64>) -> Option<CachedBytes> {
        let mut state = self.state();
        let State { time, ranges, by_time, .. } = &mut *state;
        let (key, cached) = ranges.range_mut((file, 0)..=(file, range.start)).next_back()?;
        let [start, end] = [range.start, range.end].map(|at| at - key.1);
        if end > cached.bytes.len() as u64 {
            return None;
        }
        let (start, end) = (start as usize, end as usize);
        by_time.remove(&cached.last_use);
        by_time.insert(*time, *key);
        cached.last_use = *time;
        *time += 1;
        Some(CachedBytes { bytes: cached.bytes.clone(), range: start..end })
    }

    /// Returns the number of cached bytes.
    pub fn held(&self) -> u64 {
        self.state().held
    }

    /// Returns the maximum number of bytes that were cached at a time.
    pub fn max_held(&self) -> u64 {
        self.state().most
    }

    /// Evicts all ranges of a file.
    pub fn forget(&self, file: u64) {
        let mut state = self.state();
        let keys: Vec<RangeKey> =
            state.ranges.range((file, 0)..=(file, u64::MAX)).map(|(key, _)| *key).collect();
        keys.into_iter().for_each(|key| state.remove(key));
    }

    /// Adds bytes of a file from an offset on. They may be cached already if two threads have read
    /// them at the same time.
    pub fn put(&self, file: u64, offset: u64, bytes: Arc<Vec<u8>>) {
        let mut state = self.state();
        let key = (file, offset);
        // A range that starts before and ends later contains these bytes.
        let end = offset.saturating_add(bytes.len() as u64);
        let before = state.ranges.range((file, 0)..=key).next_back();
        let reaches = |(at, cached): (&RangeKey, &Cached)| {
            let reached = at.1 + cached.bytes.len() as u64;
            reached > end || reached == end && at.1 < offset
        };
        if before.is_some_and(reaches) {
            return;
        }
        // Ranges within the new one are found in it. They would hide it, since they start later.
        let is_within =
            |(key, cached): (&RangeKey, &Cached)| (key.1 + cached.bytes.len() as u64 <= end).then_some(*key);
        let within: Vec<RangeKey> = state.ranges.range(key..(file, end)).filter_map(is_within).collect();
        within.into_iter().for_each(|key| state.remove(key));
        state.remove(key);
        state.held += bytes.len() as u64;
        let last_use = state.time;
        state.ranges.insert(key, Cached { last_use, bytes });
        state.by_time.insert(last_use, key);
        state.time += 1;
        // The new range has the latest time, so it is never evicted here.
        while state.held > self.limit() && state.ranges.len() > 1 {
            let Some((_, oldest)) = state.by_time.pop_first() else { return };
            state.remove(oldest);
        }
        state.most = state.most.max(state.held);
    }
}

impl State {
    fn remove(&mut self, key: RangeKey) {
        if let Some(Cached { last_use, bytes }) = self.ranges.remove(&key) {
            self.by_time.remove(&last_use);
            self.held -= bytes.len() as u64;
        }
    }
}

/// Bytes of a cache. They stay in memory as long as any handle exists, even after eviction.
#[derive(Clone)]
pub struct CachedBytes {
    bytes: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl CachedBytes {
    /// Returns all bytes of the cached range.
    pub fn whole(&self) -> &Arc<Vec<u8>> {
        &self.bytes
    }

    /// Returns a slice of the bytes, which must lie within them.
    #[must_use]
    pub fn part(self, part: Range<usize>) -> CachedBytes {
        let start = self.range.start;
        debug_assert!(start + part.end <= self.range.end);
        CachedBytes { bytes: self.bytes, range: start + part.start..start + part.end }
    }
}

impl From<Arc<Vec<u8>>> for CachedBytes {
    fn from(bytes: Arc<Vec<u8>>) -> CachedBytes {
        let range = 0..bytes.len();
        CachedBytes { bytes, range }
    }
}

impl Deref for CachedBytes {
    type Target = [u8];

    #[inline]
    fn deref(&self) -> &[u8] {
        &self.bytes[self.range.clone()]
    }
}

/// A backend with a cache for [shared](ReadBackend::share) reads.
struct CachedReads {
    backend: Box<dyn ReadBackend>,
    cache: RangeCache,
}

/// File number in a cache with only one file.
const ONLY: u64 = 0;

/// Adds a cache of at most `limit` bytes to a backend, unless its bytes are mapped or it has a
/// cache.
pub(super) fn with_cache(backend: Box<dyn ReadBackend>, limit: u64) -> Box<dyn ReadBackend> {
    if backend.bytes().is_some() || backend.has_cache() {
        return backend;
    }
    Box::new(CachedReads { backend, cache: RangeCache::new(limit) })
}

impl ReadBackend for CachedReads {
    fn len(&self) -> u64 {
        self.backend.len()
    }

    fn bytes(&self) -> Option<&[u8]> {
        None
    }

    fn stat(&self) -> Result<Option<FileStat>> {
        self.backend.stat()
    }

    fn version(&self) -> Result<Option<FileStat>> {
        self.backend.version()
    }

    fn check_remote(&self) -> Result<()> {
        self.backend.check_remote()
    }

    fn read(&self, offset: u64, length: usize) -> Result<Cow<'_, [u8]>> {
        self.backend.read(offset, length)
    }

    fn share(&self, offset: u64, length: usize) -> Result<FileBytes<'_>> {
        if let Some(held) = self.cache.get(ONLY, &(offset..offset + length as u64)) {
            return Ok(FileBytes::Cached(held));
        }
        // Threads do not wait for each other: two may read the same bytes, which are then cached
        // once.
        let bytes = Arc::new(self.backend.read(offset, length)?.into_owned());
        self.cache.put(ONLY, offset, bytes.clone());
        Ok(FileBytes::Cached(bytes.into()))
    }

    fn has_cache(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(length: usize) -> Arc<Vec<u8>> {
        Arc::new((0..length as u8).collect())
    }

    #[test]
    fn least_recently_used_ranges_are_evicted() {
        let cache = RangeCache::new(10);
        let is_held = |offset: u64| cache.get(0, &(offset..offset + 3)).is_some();
        (0..3).for_each(|index| cache.put(0, index * 10, bytes(3)));
        assert!(is_held(0));
        cache.put(0, 30, bytes(3));
        assert_eq!([0, 10, 20, 30].map(is_held), [true, false, true, true]);
        // Adding the same range again replaces its bytes.
        cache.put(0, 30, bytes(4));
        let counts = |cache: &RangeCache| {
            let state = cache.state();
            (state.held, state.ranges.len(), state.by_time.len())
        };
        assert_eq!(counts(&cache), (10, 3, 3));
        // A shorter range does not replace a longer one.
        cache.put(0, 30, bytes(2));
        assert_eq!(counts(&cache), (10, 3, 3));
        // A range above the limit is held alone.
        cache.put(0, 40, bytes(20));
        assert_eq!(counts(&cache), (20, 1, 1));
    }

    #[test]
    fn subranges_are_found_in_their_own_file() {
        let cache = RangeCache::new(100);
        cache.put(7, 100, bytes(50));
        assert_eq!(&*cache.get(7, &(110..113)).unwrap(), [10, 11, 12]);
        assert_eq!(cache.get(7, &(100..150)).unwrap().len(), 50);
        for (file, range) in [(7, 100..151), (7, 99..101), (6, 110..113), (8, 110..113)] {
            assert!(cache.get(file, &range).is_none(), "{file} {range:?}");
        }
        // A new range replaces those within it, and none hides a longer one.
        cache.put(7, 90, bytes(70));
        cache.put(7, 120, bytes(5));
        assert_eq!((cache.held(), cache.get(7, &(121..155)).unwrap()[0]), (70, 31));
        cache.put(8, 0, bytes(3));
        cache.forget(7);
        assert_eq!((cache.held(), cache.get(7, &(110..113)).is_none()), (3, true));
        assert!(cache.get(8, &(0..3)).is_some());
    }

    #[test]
    fn threads_share_one_limit() {
        let cache = RangeCache::new(1000);
        std::thread::scope(|scope| {
            for thread in 0..8u64 {
                let cache = &cache;
                scope.spawn(move || {
                    for step in 0..2000u64 {
                        let offset = (step * 7919 + thread * 31) % 97 * 100;
                        match cache.get(step % 3, &(offset..offset + 64)) {
                            Some(held) => assert_eq!(held[63], 63),
                            None => cache.put(step % 3, offset, bytes(64)),
                        }
                    }
                });
            }
        });
        let state = cache.state();
        assert!(state.held <= 1000 && state.held == 64 * state.ranges.len() as u64);
        assert_eq!(state.ranges.len(), state.by_time.len());
    }
}
