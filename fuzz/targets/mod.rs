//! Fuzz targets: functions of untrusted bytes. Whatever the bytes are, a target ends soon, needs
//! little memory and does not panic; its results must be consistent.
//!
//! `fuzz/run` runs them under libFuzzer; `cargo test` replays `fuzz/corpus/`.

mod batches;
pub mod disk;
pub mod edits;
mod features;
mod files;
mod importers;
pub mod indexes;
pub mod layers;
pub mod lines;
pub mod models;
pub mod seal;
mod text_formats;
pub mod trees;

pub use batches::batches;
pub use edits::{autumnal_edit, autumnal_file};
pub use features::{feature_table, flatgeobuf, geojson, geopackage, shapefile, shapefile_table};
pub use importers::{
    bmp, cells, chain_code, cityjson, exr, gif, gltf, hdr, hgt, jpeg, npy, nrrd, obj, off, ply, png, pnm,
    qoi, sidecar, stl, tga, tiff, vrt, webp, world_file,
};
pub use indexes::index_sections;
pub use layers::{autumnal_layers, goblin_layers};
pub use lines::lines_read;
pub use models::model_read;
pub use text_formats::{bintree_text, calculation_text, crs_text, df_text, step_text};
pub use trees::{autumnal_read, goblin_read};

/// Function of bytes that is fuzzed.
pub type Target = fn(&[u8]);

/// All targets with their names, which are those of their directories in `fuzz/corpus/`.
pub const TARGETS: [(&str, Target); 46] = [
    ("autumnal_edit", autumnal_edit),
    ("autumnal_file", autumnal_file),
    ("autumnal_layers", autumnal_layers),
    ("autumnal_read", autumnal_read),
    ("batches", batches),
    ("bintree_text", bintree_text),
    ("bmp", bmp),
    ("calculation_text", calculation_text),
    ("cells", cells),
    ("chain_code", chain_code),
    ("cityjson", cityjson),
    ("crs_text", crs_text),
    ("df_text", df_text),
    ("exr", exr),
    ("feature_table", feature_table),
    ("flatgeobuf", flatgeobuf),
    ("geojson", geojson),
    ("geopackage", geopackage),
    ("gif", gif),
    ("gltf", gltf),
    ("goblin_layers", goblin_layers),
    ("goblin_read", goblin_read),
    ("hdr", hdr),
    ("hgt", hgt),
    ("index_sections", index_sections),
    ("jpeg", jpeg),
    ("lines_read", lines_read),
    ("model_read", model_read),
    ("npy", npy),
    ("nrrd", nrrd),
    ("obj", obj),
    ("off", off),
    ("ply", ply),
    ("png", png),
    ("pnm", pnm),
    ("qoi", qoi),
    ("shapefile", shapefile),
    ("shapefile_table", shapefile_table),
    ("sidecar", sidecar),
    ("step_text", step_text),
    ("stl", stl),
    ("tga", tga),
    ("tiff", tiff),
    ("vrt", vrt),
    ("webp", webp),
    ("world_file", world_file),
];
