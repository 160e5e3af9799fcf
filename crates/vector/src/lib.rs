//! Features in and out: points, lines, polygons with holes.

pub mod export;
pub mod import;
pub mod objects;
pub mod overlay;
pub mod zonal;
