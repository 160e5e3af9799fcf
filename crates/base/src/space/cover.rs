//! Coverage of a box by a region.

/// How a region covers a box of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// It covers the whole box.
    Whole,
    /// It is disjoint from the box.
    Nothing,
    /// It covers some of the box, or the coverage is unknown.
    Partial,
}
