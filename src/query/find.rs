//! Searches for blocks by value.

use crate::space::Bounds;

/// What to look for, in the first channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Condition {
    /// Values greater than this.
    Above(f64),
    /// Values less than this.
    Below(f64),
    /// Values equal to this.
    Equal(f64),
}

/// A block whose cells all meet a condition.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundBlock {
    /// The node's FD code as text: `/` and a digit per level.
    pub code: String,
    /// Its level.
    pub level: u8,
    /// Its cells, of the deepest level.
    pub bounds: Bounds,
    /// The value, if it is the same all over.
    pub value: Option<f64>,
}
