//! Alignment of a file's pages and extents.

/// Alignment of extents in bytes: a sector, which disks write entirely or not at all.
pub(super) const SECTOR: u64 = 512;
/// Alignment of commits in bytes. A page with older bytes is therefore never written again.
pub(super) const PAGE: u64 = 4096;
/// Offset of the first extent: after the header page and the two meta slots.
pub(super) const FIRST_EXTENT: u64 = 3 * PAGE;

const _: () = assert!(FIRST_EXTENT.is_multiple_of(PAGE));
