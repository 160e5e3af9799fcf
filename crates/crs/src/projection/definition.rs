//! Definitions of coordinate systems in PROJ's words: `+proj=utm +zone=32 +ellps=GRS80`.

use super::datum::Datum;

/// A system in PROJ's words.
#[derive(Debug, PartialEq)]
pub(super) struct Definition {
    /// The projection, its ellipsoid and its units, without a shift of the datum.
    pub(super) words: String,
    /// The way to WGS 84.
    pub(super) datum: Datum,
}
