//! How a region covers a box of cells.

/// How a region covers a box of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cover {
    /// All of it.
    Whole,
    /// Nothing of it.
    Nothing,
    /// A part of it, or that is not known.
    Part,
}
