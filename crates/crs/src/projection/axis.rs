//! Axes of coordinate systems.

/// An axis of a coordinate system.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) name: String,
    /// Direction, in lower case.
    pub(crate) direction: String,
    /// Longitude in degrees of the meridian along which the axis leaves a pole.
    pub(crate) meridian: Option<f64>,
}
