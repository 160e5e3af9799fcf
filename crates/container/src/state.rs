//! States of the children of an inner node, as files have them.

/// Nothing there.
pub const VOID: u8 = 0;
/// One value all over.
pub const LEAF: u8 = 1;
/// More detail below, whose record is in this segment.
pub const INNER: u8 = 2;
/// More detail below, whose record is in another segment.
pub const CUT: u8 = 3;
