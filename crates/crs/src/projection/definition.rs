//! Definitions in PROJ's words: `+proj=utm +zone=32 +ellps=GRS80`.

use super::datum::Datum;

/// A system in PROJ's words.
#[derive(Debug, PartialEq)]
pub(super) struct Definition {
    /// The projection with its ellipsoid and units, without a datum shift.
    pub(super) words: String,
    /// The shift to WGS 84.
    pub(super) datum: Datum,
}
