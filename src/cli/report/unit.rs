//! Units of the world, as people and programs are told them.

use spinney::dataset::Dataset;
use spinney::space::is_geographic;

/// The unit of a tree's world: that of the model, or of the coordinate system; cells where nothing places them. `None` if
/// nobody told.
pub(crate) fn unit(tree: &Dataset) -> Option<&str> {
    let (metadata, frame) = (tree.metadata(), &tree.metadata().frame);
    match frame.epsg {
        _ if metadata.tags.contains_key("unit") => metadata.tags.get("unit").map(String::as_str),
        Some(epsg) if is_geographic(u16::try_from(epsg).unwrap_or(0)) => Some("degrees"),
        Some(epsg) => Some(if counts_feet(epsg, frame.crs_name.as_deref()) { "ft" } else { "m" }),
        None => frame.is_identity().then_some("cells"),
    }
}

/// Whether a projected coordinate system counts in feet, by its number and name.
pub(crate) fn counts_feet(epsg: u32, name: Option<&str>) -> bool {
    let name = name.unwrap_or_default().to_lowercase();
    ["ft", "foot", "feet"].iter().any(|word| name.contains(word)) || (2222..=2289).contains(&epsg)
}

/// The unit behind a number, as in ` mm`, or ` mm3` with a power; nothing if it is not known or cells.
pub(crate) fn behind_number(tree: &Dataset, power: &str) -> String {
    unit(tree).filter(|unit| *unit != "cells").map_or(String::new(), |unit| format!(" {unit}{power}"))
}
