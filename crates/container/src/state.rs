//! States of an INNER node's children, as encoded in files.

/// No data.
pub const VOID: u8 = 0;
/// One value throughout.
pub const LEAF: u8 = 1;
/// More detail below; the record is in this segment.
pub const INNER: u8 = 2;
/// More detail below; the record is in another segment.
pub const CUT: u8 = 3;
