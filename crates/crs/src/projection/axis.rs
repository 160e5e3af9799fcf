//! Axes of coordinate systems.

/// An axis.
#[derive(Debug)]
pub(super) struct Axis {
    pub(super) name: String,
    /// Where it goes, in small letters.
    pub(super) direction: String,
    /// Degrees of longitude along which it leaves a pole.
    pub(super) meridian: Option<f64>,
}
