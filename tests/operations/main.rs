//! Operations on trees and queries, against arrays of cells.

#[path = "../common/mod.rs"]
mod common;

mod blame;
#[cfg(feature = "mesh")]
mod brep_topology;
mod calculations;
mod composites;
mod contours;
mod coverage;
mod crops;
mod deviations;
#[cfg(feature = "mesh")]
mod exact_bodies;
#[cfg(feature = "mesh")]
mod exact_grids;
mod exact_motions;
#[cfg(feature = "mesh")]
mod exact_operands;
#[cfg(feature = "mesh")]
mod exact_owners;
#[cfg(feature = "mesh")]
mod exact_sections;
mod exact_sets;
mod exact_triangles;
#[cfg(feature = "mesh")]
mod exact_views;
#[cfg(feature = "mesh")]
mod isosurfaces;
mod levels;
mod manifests;
mod operations;
mod overlay;
mod pixels;
mod polygons;
mod queries;
mod set_operations;
mod shares;
mod solid_measures;
mod solid_resampling;
mod solids;
#[cfg(feature = "mesh")]
mod surface_intersections;
mod symmetries;
mod zonal;
mod zonal_invalid;
