//! Features in and out: points, lines, polygons with holes.

pub mod export;
pub mod import;
pub mod overlay;
pub mod zonal;
