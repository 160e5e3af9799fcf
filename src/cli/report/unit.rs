//! Units of the world, in text and JSON.

use spinney::Dataset;
pub(crate) use spinney::raw::report::world_unit as unit;

/// Returns the suffix of a number with the tree's unit, as in ` mm`, or ` mm3` with a power; empty
/// if the unit is unknown or cells.
pub(crate) fn suffix(tree: &Dataset, power: &str) -> String {
    unit(tree).filter(|unit| *unit != "cells").map_or(String::new(), |unit| format!(" {unit}{power}"))
}
