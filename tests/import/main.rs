//! Rasters, meshes and features: import from and export to files of other programs.

#[path = "../common/mod.rs"]
mod common;

#[cfg(feature = "raster")]
mod arrays;
#[cfg(feature = "raster")]
mod bands;
#[cfg(feature = "mesh")]
mod city_geometry;
#[cfg(feature = "raster")]
mod cog;
mod descriptions;
#[cfg(feature = "mesh")]
mod exact_attributes;
#[cfg(feature = "mesh")]
mod exact_build;
#[cfg(feature = "mesh")]
mod exact_contacts;
#[cfg(all(feature = "mesh", feature = "meshopt"))]
mod exact_gltf;
#[cfg(all(feature = "mesh", feature = "vector"))]
mod exact_interrupts;
#[cfg(all(feature = "mesh", feature = "meshopt"))]
mod exact_levels;
#[cfg(feature = "mesh")]
mod exact_materials;
#[cfg(feature = "mesh")]
mod exact_objects;
#[cfg(feature = "mesh")]
mod exact_queries;
#[cfg(feature = "mesh")]
mod exact_repair;
#[cfg(feature = "mesh")]
mod exact_round_trips;
#[cfg(feature = "mesh")]
mod exact_searches;
#[cfg(feature = "mesh")]
mod exact_semantics;
mod exact_views;
#[cfg(all(feature = "flatgeobuf", feature = "mbtiles"))]
mod features;
#[cfg(all(feature = "flatgeobuf", feature = "mbtiles"))]
mod features_corrupt;
mod features_losses;
#[cfg(feature = "vector")]
mod features_over;
mod features_written;
mod gltf;
#[cfg(feature = "raster")]
mod images;
mod import;
#[cfg(feature = "vector")]
mod line_widths;
#[cfg(feature = "mesh")]
mod mesh_exact;
mod mesh_export;
mod mesh_far;
mod mesh_interrupts;
#[cfg(feature = "mesh")]
mod mesh_losses;
mod mesh_open;
#[cfg(feature = "mesh")]
mod mesh_patches;
mod mesh_polygon;
mod mesh_prisms;
#[cfg(feature = "mesh")]
mod mesh_readers;
mod mesh_real;
mod mesh_solids;
#[cfg(feature = "vector")]
mod polygons;
mod raster_tiff;
mod raster_tiff_corrupt;
#[cfg(feature = "vector")]
mod rasterize;
#[cfg(feature = "vector")]
mod rasterize_odd;
mod real_rasters;
#[cfg(feature = "raster")]
mod sidecars;
#[cfg(feature = "raster")]
mod stacks;
#[cfg(feature = "raster")]
mod tile_updates;
mod tiles;
#[cfg(feature = "raster")]
mod void_numbers;
#[cfg(feature = "raster")]
mod volumes;
#[cfg(feature = "raster")]
mod vrt;
mod warped_tiles;
#[cfg(feature = "raster")]
mod whole_images;
