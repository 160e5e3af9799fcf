//! The `spinney` program, from the user's side.

#[path = "../common/mod.rs"]
mod common;

mod cli;
mod cli_bintrees;
#[cfg(feature = "cli")]
mod cli_body_values;
#[cfg(all(unix, feature = "cli"))]
mod cli_boreholes;
mod cli_build;
#[cfg(feature = "mbtiles")]
mod cli_chain_codes;
mod cli_contours;
mod cli_coordinates;
#[cfg(feature = "raster")]
mod cli_crs;
mod cli_edits;
mod cli_euler;
mod cli_exact;
mod cli_exact_memory;
mod cli_exact_motions;
mod cli_exact_sets;
mod cli_export_again;
#[cfg(feature = "cli")]
mod cli_features;
mod cli_gltf;
mod cli_images;
#[cfg(feature = "cli")]
mod cli_index_sources;
mod cli_info;
#[cfg(feature = "cli")]
mod cli_isosurfaces;
#[cfg(feature = "cli")]
mod cli_labels;
#[cfg(feature = "cli")]
mod cli_layers;
#[cfg(feature = "cli")]
mod cli_levels;
#[cfg(feature = "cli")]
mod cli_lines;
#[cfg(feature = "cli")]
mod cli_lines_space;
mod cli_meshes;
#[cfg(all(unix, feature = "cli"))]
mod cli_objects;
mod cli_octree_combine;
mod cli_octree_transform;
mod cli_operations;
mod cli_options;
mod cli_overlay;
mod cli_packed;
#[cfg(feature = "cli")]
mod cli_points;
#[cfg(feature = "cli")]
mod cli_reconstruction;
mod cli_results;
#[cfg(unix)]
mod cli_safety;
mod cli_section;
mod cli_shards;
mod cli_shards_merge;
mod cli_shards_octrees;
mod cli_shards_points;
mod cli_shards_trees;
mod cli_solid_cells;
mod cli_solids;
mod cli_solids_again;
#[cfg(feature = "cli")]
mod cli_sources;
#[cfg(feature = "cli")]
mod cli_stacks;
mod cli_structures;
mod cli_styles;
mod cli_surfaces;
#[cfg(feature = "cli")]
mod cli_tin;
mod cli_together;
#[cfg(feature = "cli")]
mod cli_volumes;
mod cli_warp;
#[cfg(feature = "cli")]
mod cli_wide;
#[cfg(feature = "cli")]
mod cli_zones;
#[cfg(all(unix, feature = "cli"))]
mod docs;
mod reviewed_images;
