//! Batched reads: traversals determined by the input bytes, through a file that is fetched in
//! ranges with a cache that is too small, compared with the same traversals in memory.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use spinney::Result;
use spinney::raw::io::batch::{defer_missing, finish_deferred, run_batched};
use spinney::raw::io::{Fetch, RangeCache, RangeFile, ReadBackend};

/// Bytes in memory that are fetched in ranges.
pub struct MemoryFetch(pub Arc<Vec<u8>>);

impl Fetch for MemoryFetch {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        Ok(ranges.iter().map(|range| self.0[range.start as usize..range.end as usize].to_vec()).collect())
    }
}

/// Returns a file of bytes, with a cache of `cache` bytes; ranges are joined if their gap is at
/// most `gap` bytes.
pub fn range_file(bytes: Arc<Vec<u8>>, cache: u64, gap: u64) -> RangeFile {
    let length = bytes.len() as u64;
    let cache = (Arc::new(RangeCache::new(cache)), RangeCache::file_number());
    RangeFile::new(Path::new("(remote)"), length, Box::new(MemoryFetch(bytes)), cache, gap)
}

/// Maximum number of nodes of a traversal, which may be cyclic.
const MAX_STEPS: u32 = 200;

/// Visits a node of a traversal: reads some bytes at `at`, and continues where these lead.
fn visit(file: &dyn ReadBackend, at: u64, depth: u8, steps: &mut u32) -> Result<u64> {
    *steps += 1;
    let max_start = file.len() - 1;
    let (start, length) = (at % max_start, (at >> 8) % 97 + 1);
    let length = length.min(file.len() - start) as usize;
    let bytes =
        if at & 1 == 0 { file.read(start, length)?.to_vec() } else { file.share(start, length)?.to_vec() };
    if at.is_multiple_of(5) {
        let end = (start + 300).min(file.len());
        file.prefetch(&[start..end, start / 2..start / 2 + 1, end..end])?;
    }
    let mut sum = bytes.iter().fold(at, |sum, byte| sum.wrapping_mul(31).wrapping_add(u64::from(*byte)));
    let mut is_unread = false;
    for child in 0..if depth > 0 && *steps < MAX_STEPS { 3 } else { 0 } {
        let next = sum.rotate_left(child * 21) >> 7;
        let below = defer_missing(visit(file, next, depth - 1, steps), &mut is_unread)?;
        sum = sum.wrapping_add(below.unwrap_or(0));
    }
    finish_deferred(is_unread).map(|()| sum)
}

/// Traverses from positions in the input bytes, in a batch and outside of it.
pub fn batches(bytes: &[u8]) {
    let Some((&[cache, gap, depth], rest)) = bytes.split_first_chunk() else { return };
    if rest.len() < 16 {
        return;
    }
    let memory = rest.repeat(8);
    let file = range_file(Arc::new(memory.clone()), 1 << (cache % 14), 1 << (gap % 12));
    for (number, start) in rest.chunks_exact(8).take(4).enumerate() {
        let at = u64::from_le_bytes(start.try_into().expect("8 bytes"));
        let traversal = |file: &dyn ReadBackend| visit(file, at, depth % 5, &mut 0);
        let expected = traversal(&memory).expect("files in memory can be read");
        let found = if number == 3 { traversal(&file) } else { run_batched(|| traversal(&file)) };
        assert_eq!(found.expect("all ranges can be fetched"), expected);
    }
}
