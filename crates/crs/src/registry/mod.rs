//! The EPSG registry: definitions, datums, axes and vertical systems, for definitions that refer to
//! it by code or name.

mod definitions;
mod geodetic;
mod geographic;
mod geographic_table;
mod projected;
mod vertical;

pub(crate) use definitions::definition_of;
pub(crate) use geodetic::{Ellipsoid, esri_name, meridian_at, meridian_numbered};
pub(crate) use geographic::Geographic;
pub(crate) use projected::{Axes, base_of};
pub(crate) use vertical::VerticalSystem;
