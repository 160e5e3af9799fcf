//! Native module of the Python package `spinney`, as thin as the program's subcommands.
//! Conveniences are written in Python (`python/spinney/`).

#[cfg(target_endian = "big")]
compile_error!("samples are handed to NumPy as the library has them, which is little-endian");

mod buffers;
mod build;
mod contours;
mod edit;
mod error;
mod export;
mod features;
mod features_over;
mod files;
mod index;
mod indexes;
mod jobs;
mod labels;
mod lines;
mod meshes;
mod model;
mod model_faces;
mod model_rays;
mod model_shells;
mod numbers;
mod overlay;
mod packing;
mod page;
mod points;
mod queries;
mod read;
mod rebuild;
mod region;
mod remote;
mod samples;
mod save;
mod sections;
mod shards;
mod solids;
mod stack;
mod stored;
mod tree;
mod zonal;

use pyo3::prelude::*;

/// Native module of the package `spinney`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::build::build_files;
    #[pymodule_export]
    use super::edit::Editor;
    #[pymodule_export]
    use super::features_over::is_features;
    #[pymodule_export]
    use super::files::{
        add_layer, blame, combine, compact, convert, cross, diff, drop_layer, log, recover, reproject,
        transform, verify,
    };
    #[pymodule_export]
    use super::indexes::{build_index, expand_sources, update_index};
    #[pymodule_export]
    use super::jobs::refuse;
    #[pymodule_export]
    use super::lines::{Lines, build_line_file};
    #[pymodule_export]
    use super::model::{Model, build_brep};
    #[pymodule_export]
    use super::model_shells::object_contacts;
    #[pymodule_export]
    use super::overlay::combine_polygons;
    #[pymodule_export]
    use super::packing::set_cache_memory;
    #[pymodule_export]
    use super::page::{page_html, write_page};
    #[pymodule_export]
    use super::points::{Points, build_point_array, build_point_files, is_points};
    #[pymodule_export]
    use super::rebuild::is_tree;
    #[pymodule_export]
    use super::remote::shown;
    #[pymodule_export]
    use super::shards::{
        build_shard, is_job, job_counts, merge_shards, missing_shards, plan_combine, plan_shards,
        plan_transform, remove_job,
    };
    #[pymodule_export]
    use super::stack::{build_layers, build_layers_shard, plan_layers};
    #[pymodule_export]
    use super::tree::Tree;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        super::jobs::remember_process();
        spinney::raw::register();
        module.add("version", env!("CARGO_PKG_VERSION"))
    }
}
