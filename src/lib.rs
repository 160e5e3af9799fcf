//! Stores rasters, elevation models, volumes and 3D models that are larger than memory as quadtrees
//! and octrees: one file with every level of detail, queried directly from disk.
//!
//! A quadtree splits a raster in half along both axes until each block has a single value; an
//! octree does the same with three axes. A block with more detail stores one value that represents
//! it, its *representative*, so that coarse views are read from the upper levels and never touch
//! the cells.
//!
//! # A tour
//!
//! A GeoTIFF becomes a tree, which returns windows of any size at any level, and exact statistics
//! of any region:
//!
//! ```
//! # #[cfg(feature = "raster")]
//! # fn main() -> spinney::Result<()> {
//! use spinney::{Bounds, build, open};
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("island.goblin");
//!
//! build("fixtures/island_classes.tif", &path)?;
//! let map = open(&path)?;
//!
//! // Cells of 8 x 8 pixels: the majority class of each.
//! let level = map.depth() - 3;
//! let mut classes = [0; 4 * 3];
//! map.window(level, &Bounds { min: [20, 20, 0], max: [24, 23, 1] }, 0.0, &mut classes, None)?;
//!
//! // Exact statistics, without reading the cells.
//! let statistics = map.statistics(None, &())?;
//! assert_eq!(statistics.classes.iter().map(|(_, cells)| cells).sum::<u64>(), statistics.channels[0].cells);
//! # assert!(classes.iter().all(|class| statistics.classes.iter().any(|(known, _)| *known == spinney::Number::from(*class))));
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "raster"))]
//! # fn main() {}
//! ```
//!
//! # Overview
//!
//! | to | use |
//! | --- | --- |
//! | open and query a file, or a view of one | [`open()`], [`Dataset`], [`query`] |
//! | build a tree from another file | [`build()`]; with options and progress `import` |
//! | build a tree from blocks of samples | [`tree::Slabs`] |
//! | build a tree from a hierarchical source | [`tree::Source`] |
//! | write a tree in another format, draw it | `export`, `style` |
//! | crop, scale, rotate, reproject, calculate | [`transform`], [`ViewOperation`], [`Dataset::view`] |
//! | merge or compare trees | [`combine`], [`SetOperation`], [`CombineOperation`] |
//! | edit a file, and read its history | [`edit`](mod@edit), [`convert`] |
//! | query and combine exact models | `ExactModel`, `brep` |
//! | query points and lines | `points`, `lines` |
//! | read and write files on web servers and in buckets | `remote` |
//! | serve files and tiles | `serve` |
//!
//! [`raw`] exposes the building blocks of this API. They may change with any version.
//!
//! # The two formats
//!
//! - Goblin: compact and read-only. Fixed-size records are stored in preorder in segments. An index
//!   locates the segments, and each segment has statistics of its cells.
//! - Autumnal: records with pointers, editable. Files are append-only; a commit is durable when it
//!   returns, and every commit stays readable. Outputs whose names end with `.autumn` get this
//!   format.
//!
//! Both are specified in `formats.md`, and [`open()`] opens both. A Goblin file may hold an exact
//! model instead of a tree of cells: `ExactModel` opens it.
//!
//! # Features
//!
//! Without any feature, the library has only the trees of cells and their two formats.
//!
//! | feature | what it adds |
//! | --- | --- |
//! | `raster` | rasters, volumes, lists of cells; styles, tiles, cloud-optimized GeoTIFF |
//! | `indexes` | reader of indexes, whose cells are in TIFF files (part of `raster`) |
//! | `brep` | exact models, bintrees and BSP trees |
//! | `mesh` | readers and writers of meshes, solids, glTF and 3D Tiles (with `brep`) |
//! | `shards` | trees that many processes build (with `mesh` and `raster`) |
//! | `reconstruction` | solids of images and of outlines (with `mesh`, `raster` and `vector`) |
//! | `render` | images of solids (with `mesh` and `raster`) |
//! | `lines` | trees of lines |
//! | `points` | trees of points; readers and writers of LAS and LAZ |
//! | `vector` | readers and writers of features (with `brep`, `lines` and `points`) |
//! | `mbtiles` | MBTiles and GeoPackage: SQLite needs a C compiler (with `raster`, `vector`) |
//! | `meshopt` | compressed glTF (with `mesh`) |
//! | `flatgeobuf` | features in FlatGeobuf (with `vector`) |
//! | `site` | pages that show files in a browser |
//! | `remote` | files on web servers and in buckets: read in ranges, uploaded |
//! | `report` | results as JSON (with `vector`) |
//! | `serve` | a server of files and query results (with `raster` and `report`) |
//! | `libwebp` | lossy WebP tiles by libwebp: needs a C compiler (with `raster`) |
//! | `cli` | the program `spinney`, with all of these but `libwebp`; the default |

pub mod raw;

pub use spinney_base::io::FileAccess;
pub use spinney_base::io::Output;
pub use spinney_base::space::{Bounds, Code, Dimension, Region};
pub use spinney_base::value::{DataKind, Number, Rule, SampleType, Value, ValueType};
pub use spinney_base::{Error, Progress, Result, SetOperation, TreeType};
#[cfg(feature = "brep")]
pub use spinney_brep::ExactModel;
pub use spinney_container::{Codec, Header, Metadata, OpenOptions};
pub use spinney_crs::{CellLocator, Coordinates, Crs, Frame, WorldLocator};
pub use spinney_engine::dataset::Dataset;
pub use spinney_engine::ops::{
    CombineOperation, CombineOptions, FileView, Resampling, Universe, ViewOperation, WarpOptions, combine,
    convert, transform,
};
pub use spinney_engine::store::{BuildOptions, WriteOptions};

/// Requests to a [`Dataset`], and their results.
pub mod query {
    pub use spinney_base::space::EdgeRule;
    pub use spinney_engine::query::{
        ChannelStatistics, ClassRegion, Condition, Contour, ContourLevels, ContourRequest, FoundBlock,
        PointSamples, PolygonRequest, Ray, Rays, Statistics, SurfaceHit, ZonalRequest, ZoneMeasure,
        ZoneStatistics,
    };
    pub use spinney_overlay::Polygon;
}

/// Trees of data that is not in a file: sources that are traversed from the root down, blocks of
/// samples, and the in-memory tree.
pub mod tree {
    pub use spinney_engine::store::{Slab, Slabs, build_slabs, build_source};
    pub use spinney_engine::tree::{Child, Children, MemTree, NodeState, Source};
}

/// Edits and history of Autumnal files.
pub mod edit {
    pub use spinney_engine::ops::{CellValue, Edit, FillRegion, edit};
    pub use spinney_engine::store::autumnal::{Commit, Editor, Note};
}

/// Readers of other formats. Each has a function that plans the import; the plan builds the tree.
pub mod import {
    /// Rasters: GeoTIFF, PNG, JPEG, WebP, EXR, HGT, VRT.
    #[cfg(feature = "raster")]
    pub mod raster {
        pub use spinney_raster::import::{
            ImportOptions, RasterImport, Stack, StackOptions, plan, plan_stack,
        };
    }

    /// Volumes: NPY and NRRD arrays, samples without a header, stacks of sections.
    #[cfg(feature = "raster")]
    pub mod volume {
        pub use spinney_raster::volume::{VolumeImport, VolumeOptions, plan};
    }

    /// Meshes: solids of cells, and exact models.
    #[cfg(feature = "mesh")]
    pub mod mesh {
        pub use spinney_mesh::import::{
            ExactOptions, Resolution, SolidImport, SolidOptions, import_exact, open_all, plan_models,
        };
    }

    /// Features (points, lines and polygons with attributes), rasterized.
    #[cfg(feature = "vector")]
    pub mod feature {
        pub use spinney_vector::import::feature::FeatureOptions;
        pub use spinney_vector::import::filter::FeatureFilter;
        pub use spinney_vector::import::rasterize::{
            FeatureImport, FeatureValue, RasterizeOptions, plan_features,
        };
    }
}

/// Writers of other formats.
pub mod export {
    #[cfg(feature = "mesh")]
    pub use spinney_mesh::export::{
        GltfOptions, MeshFormat, MeshRequest, export_exact, export_glb, export_mesh, export_model_glb,
        export_model_tileset, export_tileset,
    };
    #[cfg(feature = "raster")]
    pub use spinney_raster::tile_archives::{
        TileEncoding, TileFormat, TileRequest, export_pmtiles, export_tiles,
    };
    #[cfg(feature = "raster")]
    pub use spinney_raster::{
        ArrayRequest, CogCompression, CogRequest, Detail, WindowRequest, export_array, export_cog,
        export_window,
    };
    #[cfg(feature = "render")]
    pub use spinney_render::{RenderRequest, render, render_exact};
    #[cfg(feature = "site")]
    pub use spinney_site::{PageFile, PageRequest, export_page};
    #[cfg(feature = "vector")]
    pub use spinney_vector::export::{VectorFormat, export_contours, export_polygons};
}

/// Colours of values, and legends.
#[cfg(feature = "raster")]
pub mod style {
    pub use spinney_style::{Legend, Style};
}

/// Exact models: boundary representations on an integer grid, not cells.
#[cfg(feature = "brep")]
pub mod brep {
    pub use spinney_brep::query::{
        BoxLocation, CuttingPlane, Hit, Location, MassProperties, ModelSurface, SurfaceDetail, SurfacePoint,
        Viewpoint,
    };
    pub use spinney_brep::{
        DetailLevel, Face, FaceBuffer, Faces, Grid, Motion, TransformOptions, combine, transform,
    };
    #[cfg(feature = "meshopt")]
    pub use spinney_mesh::{add_levels, with_levels};
}

/// Trees of points with attributes, and LAS and LAZ files.
#[cfg(feature = "points")]
pub mod points {
    pub use spinney_points::{
        PointImport, PointImportOptions, PointRegion, PointTree, Selection, plan_files,
    };
}

/// Trees of lines with attributes.
#[cfg(feature = "lines")]
pub mod lines {
    pub use spinney_lines::{LineBuildOptions, LineFeature, LineTree, LinesInMemory, build};
}

/// Files on web servers and in buckets.
#[cfg(feature = "remote")]
pub mod remote {
    pub use spinney_remote::{RemoteOptions, client};
}

/// A server of files, tiles and queries.
#[cfg(feature = "serve")]
pub mod serve {
    pub use spinney_serve::{ServeOptions, Server};
}

use std::path::Path;

/// Builds a tree from a raster file, a volume, or another tree.
///
/// The output's name selects the format: `.goblin`, or `.autumn`, which can be edited. Bands that
/// cannot form one value become layers. Data that do not fit into memory go to a temporary file
/// next to the output. The output appears when it is complete.
///
/// [`import::raster::plan`] and [`import::volume::plan`] take options, and report in advance what
/// will be built. `import::mesh::plan_models` builds solids from meshes,
/// `import::mesh::import_exact` exact models.
///
/// ```
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("island.goblin");
/// spinney::build("fixtures/island_elevation.tif", &path)?;
/// assert_eq!(spinney::open(&path)?.header().form.to_string(), "a quadtree of f32");
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the input cannot be read, has an unknown format, is corrupt or uses an unsupported feature,
/// or if the output cannot be written.
#[cfg(feature = "raster")]
pub fn build(input: impl AsRef<Path>, output: impl AsRef<Path>) -> Result<()> {
    build_tree(input.as_ref(), output.as_ref())
}

/// Implements [`build`], instantiated once for all path types.
#[cfg(feature = "raster")]
fn build_tree(input: &Path, output: &Path) -> Result<()> {
    use spinney_container::{create_tree_file, file_is_tree};
    if file_is_tree(input, &FileAccess::default())? {
        let tree = open(input)?;
        return tree.build(
            &tree.build_options(spinney_raster::import::DEFAULT_MEMORY),
            create_tree_file(output, &FileAccess::default())?,
            &(),
        );
    }
    if spinney_raster::volume::is_volume(input) {
        let volume = import::volume::plan(input, &import::volume::VolumeOptions::new())?;
        return volume.build(create_tree_file(output, &FileAccess::default())?, &());
    }
    let (inputs, options) = ([input.to_path_buf()], import::raster::ImportOptions::new());
    if spinney_raster::import::needs_layers(&inputs, &options)? {
        let stack = import::raster::plan_stack(&inputs, &import::raster::StackOptions::new())?;
        return spinney_raster::import::write_stack(
            &stack,
            create_tree_file(output, &FileAccess::default())?,
            &(),
        );
    }
    let raster = import::raster::plan(&inputs, &options)?;
    raster.build(create_tree_file(output, &FileAccess::default())?, &())
}

/// Opens a tree file of either format and any type, or a commit: `map.autumn@12` is commit 12 of
/// `map.autumn`. [`open_with`] takes options.
///
/// ```
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let mut class = [spinney::Number::default(); 4];
/// assert!(map.point([20, 20, 0], map.depth(), &mut class)?);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read, is not a tree file, is corrupt, or has a newer version.
pub fn open(path: impl AsRef<Path>) -> Result<Dataset> {
    open_with(path, &OpenOptions::new())
}

/// Opens a tree file or a commit with options; see [`open`].
///
/// # Errors
/// The errors of [`open`].
pub fn open_with(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Dataset> {
    raw::register();
    spinney_engine::dataset::open(path.as_ref(), options)
}

/// Compiles the README's Rust blocks.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
