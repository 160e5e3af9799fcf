//! Pages of the directory, and the index over them.
//!
//! The directory's entries stand in pages of so many. Each page begins with copies of the entries of its first node's ancestors, so
//! that one page tells all segments on the way to any node. Over the pages is an index: an entry for each, in pages again, until
//! one page, the *top*, has all that is left.

use std::sync::OnceLock;

use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

/// Entries of a page of the directory, but for the copies that it begins with. All pages but the last have as many.
pub(super) const PAGE_ENTRIES: u64 = 128;
/// Entries of a page of the index. All pages of a level but the last have as many.
pub(super) const INDEX_ENTRIES: u64 = 256;
/// Copies at a page's beginning at most: nodes that can own segments on the way down.
pub(super) const MAX_COPIES: usize = 31;

/// The beginning of a page of the directory. The numbers of the segments whose entries are copied follow, as `u64` each, then the
/// copies, then the page's own entries.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub(super) struct PageHead {
    pub(super) copies: U16,
    pub(super) entries: U16,
    zero: [u8; 4],
}

/// Bytes of a page's head.
pub(super) const HEAD_SIZE: usize = size_of::<PageHead>();

impl PageHead {
    pub(super) fn new(copies: usize, entries: usize) -> PageHead {
        PageHead { copies: (copies as u16).into(), entries: (entries as u16).into(), zero: [0; 4] }
    }
}

/// An entry of the index: where a page is, and the first code in it that is no copy.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned, Clone, Copy)]
#[repr(C)]
pub(super) struct IndexEntry {
    pub(super) first: U64,
    /// From the first byte of the layer's run on.
    pub(super) offset: U64,
    pub(super) length: U32,
    pub(super) checksum: U32,
}

/// Bytes of an entry of the index.
pub(super) const INDEX_SIZE: usize = size_of::<IndexEntry>();

/// The numbers of entries of the index's levels, the pages' own first; the last is that of the top. None without segments.
pub(super) fn index_levels(segments: u64) -> Vec<u64> {
    let mut levels = Vec::new();
    let mut entries = segments.div_ceil(PAGE_ENTRIES);
    while entries > 0 {
        levels.push(entries);
        entries = if entries > INDEX_ENTRIES { entries.div_ceil(INDEX_ENTRIES) } else { 0 };
    }
    levels
}

/// A page that was read and found to be good.
pub(super) struct CheckedPage {
    /// Where it starts in the file.
    pub(super) start: usize,
    pub(super) length: usize,
    /// Copies that it begins with.
    pub(super) copies: usize,
}

/// The pages of one level, each as it is read first.
pub(super) type PageSlots = Box<[OnceLock<CheckedPage>]>;

/// Pages that are not read yet.
pub(super) fn page_slots(pages: u64) -> PageSlots {
    (0..pages).map(|_| OnceLock::new()).collect()
}
