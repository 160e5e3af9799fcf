//! Reading in rounds: walks that are told by the bytes, through a file that comes in ranges and a cache that is too small, against the same
//! walks in memory.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use spinney::Result;
use spinney::raw::io::batch::{defer_missing, finish_deferred, run_batched};
use spinney::raw::io::{Fetch, RangeCache, RangeFile, ReadBackend};

/// Bytes in memory that come in ranges.
pub struct Far(pub Arc<Vec<u8>>);

impl Fetch for Far {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        Ok(ranges.iter().map(|range| self.0[range.start as usize..range.end as usize].to_vec()).collect())
    }
}

/// A file of bytes, with a cache of so many, and ranges joined that are so near each other.
pub fn far(bytes: Arc<Vec<u8>>, cache: u64, gap: u64) -> RangeFile {
    let length = bytes.len() as u64;
    let cache = (Arc::new(RangeCache::new(cache)), RangeCache::file_number());
    RangeFile::new(Path::new("(far)"), length, Box::new(Far(bytes)), cache, gap)
}

/// Steps of a walk at most: it may go round in circles.
const MAX_STEPS: u32 = 200;

/// A node of a walk: reads some bytes that `at` tells, and goes on where these lead.
fn walk(file: &dyn ReadBackend, at: u64, depth: u8, steps: &mut u32) -> Result<u64> {
    *steps += 1;
    let room = file.len() - 1;
    let (start, length) = (at % room, (at >> 8) % 97 + 1);
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
        let below = defer_missing(walk(file, next, depth - 1, steps), &mut is_unread)?;
        sum = sum.wrapping_add(below.unwrap_or(0));
    }
    finish_deferred(is_unread).map(|()| sum)
}

/// Walks from places that the bytes tell, in rounds and outside of them.
pub fn rounds(bytes: &[u8]) {
    let Some((&[cache, gap, depth], rest)) = bytes.split_first_chunk() else { return };
    if rest.len() < 16 {
        return;
    }
    let memory = rest.repeat(8);
    let file = far(Arc::new(memory.clone()), 1 << (cache % 14), 1 << (gap % 12));
    for (number, start) in rest.chunks_exact(8).take(4).enumerate() {
        let at = u64::from_le_bytes(start.try_into().expect("8 bytes"));
        let question = |file: &dyn ReadBackend| walk(file, at, depth % 5, &mut 0);
        let expected = question(&memory).expect("what is in memory can be read");
        let found = if number == 3 { question(&file) } else { run_batched(|| question(&file)) };
        assert_eq!(found.expect("all of it can be fetched"), expected);
    }
}
