//! Units of the world, as people and programs are told them.

use spinney::Dataset;
use spinney::raw::store::Tag;

/// The unit of a tree's world: that of the model, or of the coordinate system; cells where nothing places them. `None` if
/// nobody told.
pub(crate) fn unit(tree: &Dataset) -> Option<&str> {
    let (metadata, frame) = (tree.metadata(), &tree.metadata().frame);
    metadata.tag(Tag::Unit).or_else(|| match &frame.crs {
        Some(crs) => crs.unit(),
        None => frame.is_identity().then_some("cells"),
    })
}

/// The unit behind a number, as in ` mm`, or ` mm3` with a power; nothing if it is not known or cells.
pub(crate) fn behind_number(tree: &Dataset, power: &str) -> String {
    unit(tree).filter(|unit| *unit != "cells").map_or(String::new(), |unit| format!(" {unit}{power}"))
}
