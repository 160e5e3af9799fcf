//! Questions about files that come in ranges from elsewhere, answered in rounds.
//!
//! A question is code that reads. Where bytes are far away, one read after the other costs a way there and back for each. So a
//! question is asked in *rounds*: what is not here yet is noted, the read fails with [`Error::NotFetched`], and the walk goes on
//! with other branches, which may lack something, too. Then all that was noted is fetched at once, and the question is asked again, until
//! it lacks nothing. A walk down a tree takes about as many rounds as it has steps that depend on each other, however wide it is.
//!
//! Nothing in here waits for a network: [`try_once`] is one pass, so that others, such as a browser, can do the fetching in their own way.
//! Files that are mapped, or read at positions, lack nothing, and their questions are asked once.

use std::cell::RefCell;
use std::cmp::Reverse;
use std::collections::{BTreeMap, HashSet};
use std::fmt;
use std::ops::Range;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::ranges::RangeFile;
use crate::{Error, Result, parallel};

/// Rounds of a question at most. A tree has 29 levels, and few of them depend on each other, but of very many points some are answered in each round;
/// what needs more is read range by range.
const MAX_ROUNDS: usize = 256;

/// Part of the cache that a round's ranges may take: while they arrive they are there twice.
const ROUND_SHARE: u64 = 4;

/// Whether there may be files that come in ranges.
static IS_NEEDED: AtomicBool = AtomicBool::new(false);

thread_local! {
    /// The round in which this thread is at work.
    static CURRENT: RefCell<Option<Round>> = const { RefCell::new(None) };
}

/// Ranges that a pass of a question has found missing, of all threads that are at work on it.
#[derive(Clone, Default)]
pub(crate) struct Round(Arc<Mutex<Vec<MissingRange>>>);

/// A range of a file that is to be fetched.
#[derive(Clone)]
pub struct MissingRange {
    /// The file.
    pub file: RangeFile,
    /// First byte, and the one behind the last.
    pub range: Range<u64>,
}

/// Work with files that come in ranges, of this process so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Times that something was waited for.
    pub rounds: u64,
    /// Requests.
    pub requests: u64,
    /// Bytes that came.
    pub bytes: u64,
}

impl fmt::Display for Traffic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Traffic { rounds, requests, bytes } = self;
        write!(f, "{rounds} rounds, {requests} requests, {bytes} bytes")
    }
}

static ROUNDS: AtomicU64 = AtomicU64::new(0);
static REQUESTS: AtomicU64 = AtomicU64::new(0);
static BYTES: AtomicU64 = AtomicU64::new(0);

/// Work with files that come in ranges, of this process so far.
pub fn traffic() -> Traffic {
    let [rounds, requests, bytes] =
        [&ROUNDS, &REQUESTS, &BYTES].map(|counter| counter.load(Ordering::Relaxed));
    Traffic { rounds, requests, bytes }
}

/// Counts a round of so many requests and bytes.
pub fn count_traffic(requests: u64, bytes: u64) {
    for (counter, count) in [(&ROUNDS, 1), (&REQUESTS, requests), (&BYTES, bytes)] {
        counter.fetch_add(count, Ordering::Relaxed);
    }
}

/// Says that there are files that come in ranges.
pub(super) fn need() {
    IS_NEEDED.store(true, Ordering::Relaxed);
}

/// The round that this thread is at work in.
pub(crate) fn current() -> Option<Round> {
    CURRENT.with_borrow(Clone::clone)
}

/// Does some work in a round, or in none.
pub(crate) fn with<R>(round: Option<Round>, work: impl FnOnce() -> R) -> R {
    /// The round that the thread goes back to, even if the work panics.
    struct Before(Option<Round>);
    impl Drop for Before {
        fn drop(&mut self) {
            CURRENT.set(self.0.take());
        }
    }
    let _before = Before(CURRENT.replace(round));
    work()
}

/// Does some work outside of the round that this thread is at work in: what it reads is waited for. For what a question opens on its way, which would
/// be opened anew in each round.
pub fn outside_batch<R>(work: impl FnOnce() -> R) -> R {
    with(None, work)
}

/// Notes a range that is not here, if this thread is in a round.
pub(super) fn note(file: &RangeFile, range: &Range<u64>) -> bool {
    CURRENT.with_borrow(|round| match round {
        Some(Round(missing)) => {
            let mut missing = missing.lock().unwrap_or_else(PoisonError::into_inner);
            missing.push(MissingRange { file: file.clone(), range: range.clone() });
            true
        }
        None => false,
    })
}

/// Lets a walk go on with other branches where one lacks bytes: gives `None` then, and sets `is_unread`. The walk must end with
/// [`finish_deferred`], since what it has found is not all.
///
/// # Errors
/// All others.
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

/// The end of a walk that has [gone on](defer_missing).
///
/// # Errors
/// [`Error::NotFetched`] if a branch lacked bytes.
#[inline]
pub fn finish_deferred(is_unread: bool) -> Result<()> {
    if is_unread { Err(Error::NotFetched) } else { Ok(()) }
}

/// Asks a question once, with what is here. Its answer counts only if nothing is missing; else it is to be asked again when those ranges were
/// [supplied](RangeFile::supply).
pub fn try_once(question: &mut dyn FnMut() -> Result<()>) -> (Result<()>, Vec<MissingRange>) {
    let round = Round::default();
    let result = with(Some(round.clone()), question);
    let mut missing = std::mem::take(&mut *round.0.lock().unwrap_or_else(PoisonError::into_inner));
    let order =
        |missing: &MissingRange| (missing.file.number(), missing.range.start, Reverse(missing.range.end));
    crate::sort::by(&mut missing, &mut |a, b| order(a).cmp(&order(b)));
    // (What lies in another range comes with it.)
    missing
        .dedup_by(|next, kept| next.file.number() == kept.file.number() && next.range.end <= kept.range.end);
    (result, missing)
}

/// Asks a question in rounds, until it lacks nothing; within a round, and where no file comes in ranges, once. It must not do twice what may be
/// done only once.
///
/// ```
/// # use std::{ops::Range, path::Path, sync::Arc};
/// use spinney::raw::io::batch::{defer_missing, finish_deferred, run_batched};
/// use spinney::raw::io::{Fetch, RangeCache, RangeFile, ReadBackend};
///
/// /// A host that is far away.
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
/// Those of the question, and of fetching.
pub fn run_batched<T>(mut question: impl FnMut() -> Result<T>) -> Result<T> {
    if !IS_NEEDED.load(Ordering::Relaxed) {
        return question();
    }
    let mut answer = None;
    run_again(&mut || {
        answer = Some(question()?);
        Ok(())
    })?;
    Ok(answer.expect("a question without an error has an answer"))
}

/// Applies a function to each item with all threads, in rounds: what is done is kept, and not asked again where others lack bytes. The results have
/// the items' order.
///
/// # Errors
/// That of the first item whose function fails.
pub fn map<T: Sync, R: Send>(items: &[T], make: impl Fn(&T) -> Result<R> + Sync) -> Result<Vec<R>> {
    let mut done: Vec<Option<R>> = items.iter().map(|_| None).collect();
    run_batched(|| {
        let left: Vec<usize> = (0..items.len()).filter(|index| done[*index].is_none()).collect();
        let mut is_unread = false;
        for (index, made) in left.iter().zip(parallel::map(&left, |index| make(&items[*index]))) {
            done[*index] = defer_missing(made, &mut is_unread)?;
        }
        finish_deferred(is_unread)
    })?;
    Ok(done.into_iter().flatten().collect())
}

fn run_again(question: &mut dyn FnMut() -> Result<()>) -> Result<()> {
    if current().is_some() {
        return question();
    }
    let mut fetched = HashSet::new();
    for _ in 0..MAX_ROUNDS {
        // Invariant: a read in a round either has its bytes, or is noted. So an answer, or an error, counts if nothing is noted, and only then:
        // whoever has passed over a failed read has passed over bytes that were there to be had.
        let (result, missing) = try_once(question);
        match result {
            Err(Error::Interrupted) => return result,
            Err(Error::NotFetched) if missing.is_empty() => break,
            result if missing.is_empty() => return result,
            _ => {}
        }
        if fetch(missing, &mut fetched)? == 0 {
            break;
        }
    }
    // There is not enough room for all that the question needs at once, or something lets it go round in circles: range by range it comes to
    // an end, as it would if the file were mapped.
    question()
}

/// Ranges that a question has got: number of the file, and first byte.
type Fetched = HashSet<(u64, u64)>;

/// Fetches ranges, as many as caches have room for, those of all files at the same time; returns how many. None if one was fetched for the same question
/// before, and has given way since.
fn fetch(missing: Vec<MissingRange>, fetched: &mut Fetched) -> Result<usize> {
    let mut files: BTreeMap<u64, (RangeFile, Vec<Range<u64>>)> = BTreeMap::new();
    let mut room = missing.iter().map(|missing| missing.file.cache_limit()).min().unwrap_or(0) / ROUND_SHARE;
    let mut count = 0;
    for MissingRange { file, range } in missing {
        let length = range.end - range.start;
        if count > 0 && length > room {
            break;
        }
        if !fetched.insert((file.number(), range.start)) {
            return Ok(0);
        }
        room = room.saturating_sub(length);
        count += 1;
        files.entry(file.number()).or_insert_with(|| (file, Vec::new())).1.push(range);
    }
    let mut files = files.into_values();
    let first = files.next();
    std::thread::scope(|scope| {
        let others: Vec<_> =
            files.map(|(file, ranges)| scope.spawn(move || file.fetch(&ranges).map(drop))).collect();
        let first = first.map_or(Ok(()), |(file, ranges)| file.fetch(&ranges).map(drop));
        // (A panic goes on in the thread that asks.)
        let others =
            others.into_iter().map(|other| other.join().unwrap_or_else(|panic| resume_unwind(panic)));
        others.fold(first, Result::and)
    })?;
    Ok(count)
}
