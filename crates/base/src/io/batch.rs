//! Restartable, batched queries of remote files (as in Haxl).
//!
//! A query is any code that reads files. Over a network, consecutive reads cost a round trip each.
//! So a query runs in *batches*: a read of bytes that are not cached records their range and fails
//! with [`Error::NotFetched`], and the query continues with other branches, which may miss bytes,
//! too. Then all recorded ranges are fetched at once, and the query is restarted. This repeats
//! until it misses no bytes. A tree traversal takes about as many batches as it has levels that
//! depend on each other, however wide it is.
//!
//! A query runs several times, and all passes but the last one are incomplete. Its code must not:
//!
//! - have effects outside of it, such as output or progress, unless they can be repeated;
//! - keep the result of an incomplete pass, or treat [`Error::NotFetched`] as missing data. Return
//!   the error, or use [`defer_missing`] and [`finish_deferred`];
//! - read files on threads that it starts itself. Threads of [`parallel`] and of
//!   [`map`] belong to the batch; each read of another thread waits for its bytes;
//! - open a file in each pass. Open it with [`outside_batch`] and keep it open.
//!
//! [`run_batched`] and [`map`] wait for the network, through [`Fetch`](super::Fetch). [`try_once`]
//! makes a single pass and never waits (except in [`outside_batch`]), so that a browser can fetch
//! in its own way. Files that are mapped or read at positions miss nothing, and their queries run
//! once.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};
use std::fmt;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::ranges::RangeFile;
use super::waiting::run_waiting;
use crate::{Error, Result, parallel};

/// Maximum number of batches of a query, after which it reads range by range.
///
/// A tree has at most 29 levels, and few of them depend on each other. Queries of very many points
/// may find new ranges in each batch.
const MAX_BATCHES: usize = 256;

/// A batch may take `1 / BATCH_SHARE` of the smallest limit of the caches concerned.
///
/// Its ranges are in memory twice while they arrive: in responses, and copied from them to the
/// cache. At least half of the cache then remains for the ranges of earlier batches, which the next
/// pass of the query reads again.
const BATCH_SHARE: u64 = 4;

/// Whether any file was opened that is read in ranges. A shortcut: a process with only local files
/// needs no batches.
static IS_NEEDED: AtomicBool = AtomicBool::new(false);

/// Ranges that a pass of a query has missed, in all its threads: the [context](parallel::context)
/// of their work.
#[derive(Clone, Default)]
struct Batch {
    missing: Arc<Mutex<Vec<MissingRange>>>,
    /// Number of the item of [`map`] that is made; 0 for other work.
    item: usize,
}

/// A range of a file that has to be fetched.
#[derive(Clone)]
pub struct MissingRange {
    /// The file.
    pub file: RangeFile,
    /// First byte, and the end: one past the last byte.
    pub range: Range<u64>,
    /// Number of the first item that misses it.
    item: usize,
}

/// Counters of requests for remote files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Number of waits for concurrent requests. Each file of a batch counts: a batch that fetches
    /// ranges of three files counts as three.
    pub batches: u64,
    /// Number of requests.
    pub requests: u64,
    /// Number of bytes received.
    pub bytes: u64,
}

impl fmt::Display for Traffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Traffic { batches, requests, bytes } = self;
        write!(f, "{batches} batches, {requests} requests, {bytes} bytes")
    }
}

/// Turns batches on for this process, since a file was opened that is read in ranges.
pub(super) fn enable() {
    IS_NEEDED.store(true, Ordering::Relaxed);
}

/// Returns the batch that this thread works on.
fn current_batch() -> Option<Arc<Batch>> {
    // All contexts are batches: only this module sets one.
    parallel::context().and_then(|context| context.downcast::<Batch>().ok())
}

/// Runs a function outside of the batch that this thread works on, so that its reads wait for their
/// bytes. For files that a query opens, since each batch would open them again.
pub fn outside_batch<R>(work: impl FnOnce() -> R) -> R {
    parallel::with_context(None, work)
}

/// Records a missing range. Returns false if this thread does not work on a batch.
pub(super) fn record_missing(file: &RangeFile, range: &Range<u64>) -> bool {
    let Some(batch) = current_batch() else { return false };
    let mut missing = batch.missing.lock().unwrap_or_else(PoisonError::into_inner);
    missing.push(MissingRange { file: file.clone(), range: range.clone(), item: batch.item });
    true
}

/// Lets a traversal continue with other branches if one misses bytes: then returns `None` and sets
/// `is_unread`.
///
/// The traversal must end with [`finish_deferred`], since its result is incomplete.
///
/// # Errors
/// All errors except [`Error::NotFetched`].
#[inline]
pub fn defer_missing<T>(result: Result<T>, is_unread: &mut bool) -> Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(Error::NotFetched) => {
            *is_unread = true;
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Ends a traversal that used [`defer_missing`].
///
/// # Errors
/// [`Error::NotFetched`] if a branch missed bytes.
#[inline]
pub fn finish_deferred(is_unread: bool) -> Result<()> {
    if is_unread { Err(Error::NotFetched) } else { Ok(()) }
}

/// Runs a query once, with the cached bytes only. Returns its result and the missing ranges.
///
/// The result is valid only if no ranges are missing. Otherwise [supply](RangeFile::supply) them
/// and run the query again.
pub fn try_once(query: &mut dyn FnMut() -> Result<()>) -> (Result<()>, Vec<MissingRange>) {
    let batch = Arc::new(Batch::default());
    let result = parallel::with_context(Some(batch.clone()), query);
    let mut missing = std::mem::take(&mut *batch.missing.lock().unwrap_or_else(PoisonError::into_inner));
    let order =
        |missing: &MissingRange| (missing.file.number(), missing.range.start, Reverse(missing.range.end));
    crate::sort::by(&mut missing, &mut |a, b| order(a).cmp(&order(b)));
    // A range within another one arrives with it.
    missing.dedup_by(|next, kept| {
        let is_within = next.file.number() == kept.file.number() && next.range.end <= kept.range.end;
        kept.item = if is_within { kept.item.min(next.item) } else { kept.item };
        is_within
    });
    (result, missing)
}

/// Runs a query in batches, until it misses no bytes. The query must be repeatable: see the
/// [module](self).
///
/// Within another batch the query runs once, and the outer query is restarted. If no file is read
/// in ranges, it also runs once.
///
/// ```
/// # use std::{ops::Range, path::Path, sync::Arc};
/// use spinney::raw::io::batch::{defer_missing, finish_deferred, run_batched};
/// use spinney::raw::io::{Fetch, RangeCache, RangeFile, ReadBackend};
///
/// // A remote host.
/// struct Host;
///
/// impl Fetch for Host {
///     fn fetch(&self, ranges: &[Range<u64>]) -> spinney::Result<Vec<Vec<u8>>> {
///         Ok(ranges.iter().map(|range| range.clone().map(|at| at as u8).collect()).collect())
///     }
/// }
///
/// let cache = (Arc::new(RangeCache::new(1 << 20)), RangeCache::file_number());
/// let file = RangeFile::new(Path::new("https://host/file"), 200, Box::new(Host), cache, 0);
/// // The four bytes are fetched at the same time.
/// let sum = run_batched(|| {
///     let (mut sum, mut is_unread) = (0, false);
///     for at in [10, 70, 130, 190] {
///         let byte = defer_missing(file.read(at, 1), &mut is_unread)?;
///         sum += byte.map_or(0, |byte| u32::from(byte[0]));
///     }
///     finish_deferred(is_unread).map(|()| sum)
/// })?;
/// assert_eq!(sum, 400);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of the query and of fetching.
pub fn run_batched<T>(mut query: impl FnMut() -> Result<T>) -> Result<T> {
    if !IS_NEEDED.load(Ordering::Relaxed) {
        return query();
    }
    let mut result = None;
    run_again(&mut || {
        result = Some(query()?);
        Ok(())
    })?;
    Ok(result.expect("a query without an error has a result"))
}

/// Applies a function to each item on all threads, in batches. The results have the order of the
/// items.
///
/// Finished results are kept, and not computed again if other items miss bytes. So `make` must
/// return each [`Error::NotFetched`], or end with [`finish_deferred`]: a result that it computes
/// without the missing bytes is kept, and never corrected.
///
/// Within another batch all results are dropped if one item misses bytes: the outer query is
/// restarted, and calls `make` for all items again.
///
/// # Errors
/// That of the first item whose function fails.
pub fn map<T: Sync, R: Send>(items: &[T], make: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    // Plain loops: this is compiled for very many types.
    let mut done: Vec<Option<R>> = Vec::with_capacity(items.len());
    let mut left = Vec::with_capacity(items.len());
    for index in 0..items.len() {
        done.push(None);
        left.push(index);
    }
    run_batched(|| {
        left.retain(|index| done[*index].is_none());
        let mut is_unread = false;
        // (Ranges are fetched in the order of the items that miss them.)
        let batch = current_batch();
        let make_one = |index: &usize| match &batch {
            None => make(&items[*index]),
            Some(batch) => {
                let batch = Batch { item: batch.item + *index, ..Batch::clone(batch) };
                parallel::with_context(Some(Arc::new(batch)), || make(&items[*index]))
            }
        };
        for (index, made) in left.iter().zip(parallel::map(&left, make_one)) {
            done[*index] = defer_missing(made, &mut is_unread)?;
        }
        finish_deferred(is_unread)
    })?;
    let mut results = Vec::with_capacity(items.len());
    for result in done {
        results.push(result.expect("a query without an error misses nothing"));
    }
    Ok(results)
}

fn run_again(query: &mut dyn FnMut() -> Result<()>) -> Result<()> {
    if current_batch().is_some() {
        return query();
    }
    let mut fetched = Fetched::new();
    for _ in 0..MAX_BATCHES {
        // Invariant: a read in a batch either has its bytes, or is recorded. So a result or an
        // error is valid if and only if no range is recorded: a query that ignored a failed read
        // has ignored bytes that exist.
        let (result, missing) = try_once(query);
        match result {
            Err(Error::Interrupted) => return result,
            // No read of this pass missed bytes in the batch. Either a transport that cannot wait
            // failed in [`outside_batch`], as in browsers, or the query returned an error of an
            // earlier pass, which it must not keep. Neither is a reason for another batch.
            Err(Error::NotFetched) if missing.is_empty() => break,
            result if missing.is_empty() => return result,
            _ => {}
        }
        if fetch(missing, &mut fetched)? == 0 {
            break;
        }
    }
    // The cache is too small for all bytes that the query needs at once, or the query makes no
    // progress. If it reads range by range it terminates, just as with a mapped file.
    query()
}

/// Ranges that were fetched for the first of the items that were left then: their maximum end by
/// number of the item, number of the file and first byte.
type Fetched = HashMap<(usize, u64, u64), u64>;

/// Fetches as many of the ranges as fit into the caches, at least one, those of all files at the
/// same time. Returns their number.
///
/// The ranges of the first item that misses some come first. So a query of many items, which
/// together need more than the caches hold, finishes item by item.
///
/// Returns 0, and fetches nothing, if a range was already fetched for the first item: it is missing
/// again, so it was evicted, and more batches would only replace each other's ranges. The caller
/// must not continue with `fetched` then, which may name ranges that were not fetched.
fn fetch(mut missing: Vec<MissingRange>, fetched: &mut Fetched) -> Result<usize> {
    // (The sort is stable: the ranges of an item are in order.)
    crate::sort::by_key(&mut missing, |missing| missing.item as u64);
    let first_item = missing.first().map_or(0, |missing| missing.item);
    let mut files: BTreeMap<u64, (RangeFile, Vec<Range<u64>>)> = BTreeMap::new();
    let mut capacity =
        missing.iter().map(|missing| missing.file.cache_limit()).min().unwrap_or(0) / BATCH_SHARE;
    let mut count = 0;
    for MissingRange { file, range, item } in missing {
        let length = range.end - range.start;
        if count > 0 && length > capacity {
            break;
        }
        if item == first_item {
            let fetched_end = fetched.entry((item, file.number(), range.start)).or_insert(0);
            if range.end <= *fetched_end {
                return Ok(0);
            }
            *fetched_end = range.end;
        }
        capacity = capacity.saturating_sub(length);
        count += 1;
        files.entry(file.number()).or_insert_with(|| (file, Vec::new())).1.push(range);
    }
    let mut files: Vec<_> = files.into_values().collect();
    // (Near ranges of different items are merged.)
    files.iter_mut().for_each(|(_, ranges)| crate::sort::by_key(ranges, |range| range.start));
    run_waiting(files.len(), &|index| {
        let (file, ranges) = &files[index];
        file.fetch(ranges).map(drop)
    })?;
    Ok(count)
}
