//! Units of the world, as people and programs are told them.

use spinney::Dataset;
pub(crate) use spinney::raw::report::world_unit as unit;

/// The unit behind a number, as in ` mm`, or ` mm3` with a power; nothing if it is not known or cells.
pub(crate) fn behind_number(tree: &Dataset, power: &str) -> String {
    unit(tree).filter(|unit| *unit != "cells").map_or(String::new(), |unit| format!(" {unit}{power}"))
}
