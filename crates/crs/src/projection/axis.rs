//! Axes of coordinate systems.

/// An axis.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) name: String,
    /// Where it goes, in small letters.
    pub(crate) direction: String,
    /// Degrees of longitude along which it leaves a pole.
    pub(crate) meridian: Option<f64>,
}
