//! The places at which parts of a file may begin.

/// Extents start at multiples of this: a sector, which disks write whole or not at all.
pub(super) const SECTOR: u64 = 512;
/// Commits start at multiples of this, so that no page with older bytes is written again.
pub(super) const PAGE: u64 = 4096;
/// Offset of the first extent: behind the header's page and those of the two meta slots.
pub(super) const FIRST_EXTENT: u64 = 3 * PAGE;

const _: () = assert!(FIRST_EXTENT.is_multiple_of(PAGE));
