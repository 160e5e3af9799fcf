//! Units of length of formats that have metres, or the unit of a coordinate system.

use spinney_container::Unit;
use spinney_crs::Crs;

/// Returns the metres of a unit of length; `None` if the unit is unknown, or measures something
/// else.
pub(super) fn length(unit: Option<&str>) -> Option<f64> {
    unit.and_then(Unit::parse).and_then(Unit::metres)
}

/// Returns the metres of a unit of coordinates: the given one, or else that of the coordinate
/// system. Without a unit, coordinates are metres.
pub(super) fn metres_of_unit(unit: Option<&str>, crs: Option<&Crs>) -> f64 {
    length(unit).or_else(|| length(crs?.unit())).unwrap_or(1.0)
}

/// Returns the units of a coordinate system per given unit; 1 unless both are known.
pub(super) fn units_of_crs(unit: Option<&str>, crs: &Crs) -> f64 {
    length(unit).zip(length(crs.unit())).map_or(1.0, |(own, of_crs)| own / of_crs)
}
