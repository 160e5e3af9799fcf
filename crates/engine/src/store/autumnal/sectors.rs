//! Set of a file's sectors that allocates memory only for regions with members.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use super::pages::SECTOR;

/// Sectors per bitmap: 16 MiB of the file.
const REGION: u64 = 1 << 15;
/// Regions per row: 128 GiB of the file.
const ROW: u64 = 1 << 13;

/// Maximum file size in bytes: 2^50.
pub(super) const MAX_BYTES: u64 = SECTOR * REGION * ROW * ROW;

/// Bitmap of a region.
type Region = Box<[AtomicU64]>;

/// A row of regions.
type Row = Box<[OnceLock<Region>]>;

/// Set of sectors that any number of threads may query and extend.
pub(super) struct Sectors {
    rows: Box<[OnceLock<Row>]>,
}

impl Sectors {
    /// Creates the empty set for files of up to `bytes` bytes, at most [`MAX_BYTES`].
    pub(super) fn new(bytes: u64) -> Sectors {
        let rows = bytes.min(MAX_BYTES).div_ceil(SECTOR * REGION * ROW);
        Sectors { rows: (0..rows).map(|_| OnceLock::new()).collect() }
    }

    /// Returns whether the set has a sector.
    #[inline]
    pub(super) fn contains(&self, sector: u64) -> bool {
        let row = self.rows.get((sector / (REGION * ROW)) as usize).and_then(OnceLock::get);
        let region = row.and_then(|row| row[(sector / REGION % ROW) as usize].get());
        // (The thread that sets a bit has checked the same bytes, so relaxed ordering suffices.)
        let word = region.map_or(0, |region| region[(sector % REGION / 64) as usize].load(Ordering::Relaxed));
        word >> (sector % 64) & 1 == 1
    }

    /// Adds a sector. Sectors beyond the file size given at creation are ignored.
    pub(super) fn insert(&self, sector: u64) {
        let Some(row) = self.rows.get((sector / (REGION * ROW)) as usize) else { return };
        let row = row.get_or_init(|| (0..ROW).map(|_| OnceLock::new()).collect());
        let region = row[(sector / REGION % ROW) as usize]
            .get_or_init(|| (0..REGION / 64).map(|_| AtomicU64::new(0)).collect());
        region[(sector % REGION / 64) as usize].fetch_or(1 << (sector % 64), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sectors_are_distinct_and_allocated_on_demand() {
        let sectors = Sectors::new(MAX_BYTES);
        let some = [0, 1, 63, 64, REGION - 1, REGION, REGION * ROW - 1, REGION * ROW, MAX_BYTES / SECTOR - 1];
        for (index, sector) in some.iter().enumerate() {
            assert!(some[index..].iter().all(|sector| !sectors.contains(*sector)), "{sector}");
            sectors.insert(*sector);
            assert!(some[..=index].iter().all(|sector| sectors.contains(*sector)), "{sector}");
        }
        let rows: Vec<&Row> = sectors.rows.iter().filter_map(OnceLock::get).collect();
        let regions: usize = rows.iter().map(|row| row.iter().filter_map(OnceLock::get).count()).sum();
        assert_eq!((rows.len(), regions), (3, 5));
        // Sectors beyond the end are never members.
        let small = Sectors::new(1000);
        small.insert(REGION * ROW);
        assert!(!small.contains(REGION * ROW) && !small.contains(u64::MAX));
    }
}
