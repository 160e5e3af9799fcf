//! Pages of the segment index, and the page index over them.
//!
//! The entries of segments are stored in pages of [`PAGE_ENTRIES`]. Each page begins with copies of
//! the entries of its first node's ancestors, so one page is enough to find all segments on the way
//! to any node. The page index has an entry per page, in pages again, until all entries fit into
//! one page, the *top*.

use std::sync::OnceLock;

use spinney_container::{Codec, Header};
use zerocopy::little_endian::{U16, U32, U64};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout, Unaligned};

/// Number of a page's own entries, without the copies at its beginning. Only the last page may have
/// fewer.
pub(super) const PAGE_ENTRIES: u64 = 128;
/// Number of entries of a page of the page index. Only the last page of a level may have fewer.
pub(super) const INDEX_ENTRIES: u64 = 256;
/// Maximum number of copies at a page's beginning: the nodes on a path that can own segments.
pub(super) const MAX_COPIES: usize = 31;

/// The head of a page of entries. The indices of the copied entries' segments follow, as `u64`
/// each, then the copies, then the page's own entries (which may be packed: see
/// [`has_packed_entries`]).
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned)]
#[repr(C)]
pub(super) struct PageHead {
    pub(super) copies: U16,
    pub(super) entries: U16,
    zero: [u8; 4],
}

/// Size of a page's head in bytes.
pub(super) const HEAD_SIZE: usize = size_of::<PageHead>();

impl PageHead {
    pub(super) fn new(copies: usize, entries: usize) -> PageHead {
        PageHead { copies: (copies as u16).into(), entries: (entries as u16).into(), zero: [0; 4] }
    }
}

/// An entry of the page index: the location of a page, and its first code that is not a copy.
#[derive(FromBytes, IntoBytes, Immutable, KnownLayout, Unaligned, Clone, Copy)]
#[repr(C)]
pub(super) struct IndexEntry {
    pub(super) first: U64,
    /// Relative to the start of the layer's run.
    pub(super) offset: U64,
    pub(super) length: U32,
    pub(super) checksum: U32,
}

/// Size of a page index entry in bytes.
pub(super) const INDEX_SIZE: usize = size_of::<IndexEntry>();

/// Returns whether the entries in a page, copies and own ones, are packed. That is so in an index,
/// where entries take as much space as segments.
pub(super) fn has_packed_entries(header: &Header) -> bool {
    header.codec == Codec::Reference
}

/// Returns the number of entries of each level of the page index, from the one directly above the
/// pages to the top. Empty without segments.
pub(super) fn index_levels(segments: u64) -> Vec<u64> {
    let mut levels = Vec::new();
    let mut entries = segments.div_ceil(PAGE_ENTRIES);
    while entries > 0 {
        levels.push(entries);
        entries = if entries > INDEX_ENTRIES { entries.div_ceil(INDEX_ENTRIES) } else { 0 };
    }
    levels
}

/// A page that was read and found valid.
pub(super) struct CheckedPage {
    /// Offset in the file.
    pub(super) start: usize,
    pub(super) length: usize,
    /// Number of copies at its beginning.
    pub(super) copies: usize,
}

/// The pages of one level, each set when it is first read.
pub(super) type PageSlots = Box<[OnceLock<CheckedPage>]>;

/// Returns slots for pages that have not been read yet.
pub(super) fn page_slots(pages: u64) -> PageSlots {
    (0..pages).map(|_| OnceLock::new()).collect()
}
