//! Quadtrees and octrees on disk: maps, elevation models, volumes and 3D models that are larger than memory in one file with every
//! level of detail inside, and answers straight from that file.
//!
//! A quadtree halves a picture along both axes until a block has one value all over; an octree does the same with three.
//! A block with more detail keeps one value that stands for it, its *representative*, so that coarse views are read from
//! the upper levels and never touch the cells.
//!
//! # A tour
//!
//! A GeoTIFF becomes a tree, which answers windows of any size at any level, and exact statistics of any part:
//!
//! ```
//! # #[cfg(feature = "raster")]
//! # fn main() -> spinney::Result<()> {
//! use spinney::space::Bounds;
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("island.goblin");
//!
//! spinney::build("fixtures/island_classes.tif", &path)?;
//! let map = spinney::open(&path)?;
//!
//! // Cells of 8 x 8 pixels: the classes that cover most of each.
//! let level = map.depth() - 3;
//! let mut classes = [0; 4 * 3];
//! map.window(level, &Bounds { min: [20, 20, 0], max: [24, 23, 1] }, 0.0, &mut classes, None)?;
//!
//! // Exact statistics of any part, without looking at its cells.
//! let statistics = map.statistics(None, &())?;
//! assert_eq!(statistics.classes.iter().map(|(_, cells)| cells).sum::<u64>(), statistics.channels[0].cells);
//! # assert!(classes.iter().all(|class| statistics.classes.iter().any(|(known, _)| *known == spinney::value::Number::from(*class))));
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "raster"))]
//! # fn main() {}
//! ```
//!
//! Options, progress and interruption: [`import::raster::plan`]. Data that is in no file come in through [`store::Slabs`]
//! (blocks of samples) and [`tree::Source`] (anything that can be walked from the root down).
//!
//! # The two formats
//!
//! - [`store::goblin`]: compact and read-only. Records of one size stand in preorder in segments that a directory finds;
//!   statistics stand beside each segment.
//! - [`store::autumnal`]: pointered and edited. Files are append-only; a commit is durable when it returns, and every
//!   commit stays readable. Names that end with `.autumn` get this format, wherever something is written.
//!
//! Both are specified in `formats.md`, and [`open()`] opens both. A Goblin file may hold an exact model instead of a tree of
//! cells: `brep::ExactModel` opens it.
//!
//! # Where to look
//!
//! | module | what is there |
//! | --- | --- |
//! | [`dataset`] | a file, or a view of one, and all that can be asked of it |
//! | [`query`] | what is asked, and what is answered |
//! | [`ops`] | views (windows, scaling, rotation), other coordinate systems, set operations, edits: from files to files |
//! | `import` | pictures, volumes, meshes, lists of cells and features in |
//! | `export` | pictures, arrays, tiles, meshes, renderings, lines and polygons out |
//! | `style` | how values become colours, whatever is drawn |
//! | `brep` | exact models: planar faces on an integer grid, their files, set operations, and what can be asked of them |
//! | `lines` | trees of lines, their files, and what can be asked of them |
//! | `points` | trees of points, their files, and what can be asked of them; LAS and LAZ |
//! | `geometry` | polygons with holes on an integer grid: triangles, bridges, sections with octants |
//! | `partitions` | trees that divide in two: bintrees, and BSP trees of the plane and of space |
//! | `reconstruction` | solids of pictures from known directions, and of outlines at heights |
//! | `report`, `serve` | answers as JSON; a server of files and answers |
//! | [`manifest`] | many files as one |
//! | [`store`] | the formats, and building |
//! | [`tree`] | sources: everything that can be walked from the root down |
//! | [`space`], [`value`] | codes and boxes of nodes, coordinate systems; types of values and how they are averaged |
//! | [`io`] | output that appears whole or not at all, reading mapped or at positions |
//!
//! # Features
//!
//! Without any, the library is the trees of cells and their two formats alone.
//!
//! | feature | what it adds |
//! | --- | --- |
//! | `raster` | readers and writers of picture files, volumes and lists of cells; styles, tiles, cloud-optimized GeoTIFF |
//! | `brep` | exact models, bintrees and BSP trees |
//! | `mesh` | readers and writers of meshes, solids made of them, glTF and 3D Tiles (with `brep`) |
//! | `shards` | trees that are built by many processes (with `mesh` and `raster`) |
//! | `reconstruction` | solids of pictures and of outlines (with `mesh`, `raster` and `vector`) |
//! | `render` | pictures of solids (with `mesh` and `raster`) |
//! | `lines` | trees of lines |
//! | `points` | trees of points; readers and writers of LAS and LAZ |
//! | `vector` | readers and writers of features (with `brep`, `lines` and `points`) |
//! | `mbtiles` | MBTiles archives and GeoPackages: SQLite, which needs a C compiler (with `raster` and `vector`) |
//! | `meshopt` | compressed glTF (with `mesh`) |
//! | `flatgeobuf` | features in FlatGeobuf (with `vector`) |
//! | `site` | pages that show files in a browser |
//! | `remote` | files on web servers and in buckets: read in ranges, written by upload |
//! | `report` | answers as JSON (with `vector`) |
//! | `serve` | a server of files and answers (with `raster` and `report`) |
//! | `libwebp` | lossy WebP tiles: libwebp, which needs a C compiler (with `raster`) |
//! | `cli` | the program `spinney`, with all of these but `libwebp`; the default |

pub use spinney_base::{Error, Progress, Result, SetOperation};

/// Codes and boxes of nodes, and where the cells lie in the world.
pub mod space {
    pub use spinney_base::space::{
        Bounds, Cell, Code, CodeRun, Cover, Dimension, EdgeRule, Polygon, Region, Up,
    };
    pub use spinney_crs::{
        CellLocator, ControlPoint, ControlPoints, Coordinates, Crs, Epsg, Frame, GeoKeys, PROJECTION_METHODS,
        PolygonParts, Projection, WEB_MERCATOR, WEB_MERCATOR_HALF, WEB_MERCATOR_LATITUDE, web_mercator,
        web_mercator_depth,
    };
}

/// Values of cells: samples, values whose type is known at run time, what many cells add up to, and how coarse levels get theirs.
pub mod value {
    pub use spinney_base::value::{
        DataKind, DoubleDouble, Mask, Number, Numbers, Palette, Rule, Sample, SampleType, Samples, Sums,
        Value, ValueType, ZoneStats,
    };
}

/// Files: read where they are mapped, at positions, or in ranges from elsewhere, written whole or not at all.
pub mod io {
    pub use spinney_base::io::{
        CachedBytes, DEFAULT_GAP, Faults, Fetch, FileBytes, FileId, FileStat, FileVersion, Mapped, Output,
        OutputFolder, Positioned, RangeCache, RangeFile, ReadBackend, Stamp, WriteBackend,
        prefer_positioned_reads, url_of,
    };

    /// Questions about files that come in ranges, answered in rounds.
    pub mod batch {
        pub use spinney_base::io::batch::{
            MissingRange, Traffic, defer_missing, finish_deferred, map, run_batched, traffic, try_once,
        };
    }
}

/// Files on web servers and in buckets.
#[cfg(feature = "remote")]
pub mod remote {
    pub use spinney_remote::{RemoteOptions, enable};
}

/// Sources: everything that can be walked from the root down; the tree in memory.
pub mod tree {
    pub use spinney_base::TreeType;
    pub use spinney_engine::tree::{CellBlock, Child, Children, MemTree, NodeState, Source, no_children};

    /// DF-expressions: trees as text and as bits.
    pub mod df {
        pub use spinney_engine::tree::df::{Packed, from_packed, from_text, to_packed, to_text};
    }
}

/// Trees on disk: the two formats, what they have in common, and how trees are built.
pub mod store {
    pub use spinney_container::{
        ByteSource, Codec, FileReference, Finding, Header, LevelCounts, Metadata, OpenOptions, ScopedTags,
        Shape, Tag, TagScope, TreeFormat, check_tree_name, create_tree_file, file_is_tree, file_of,
    };
    pub use spinney_engine::store::{
        BuildOptions, Effort, Packing, ShardCheck, Slab, SlabBoxes, Slabs, TreeTarget, TreeWriter,
        WantedCells, WriteOptions, build_slabs, build_source, build_tree, depth_for,
    };

    /// The compact, read-only format.
    pub mod goblin {
        pub use spinney_engine::store::goblin::{
            Entry, Goblin, GoblinNode, LevelBytes, LightFile, MergeOutput, Segment, Shard, ShardPiece,
            merge_shards,
        };
    }

    /// The pointered format, which is edited and has a history.
    pub mod autumnal {
        pub use spinney_engine::store::autumnal::{
            Autumnal, AutumnalNode, Commit, CommitLayer, CompactOptions, Editor, History, Keep, Note,
            WriteSummary, compact, recover,
        };
    }

    /// Stored records that a source may offer to builders besides its cells.
    pub mod builder {
        pub use spinney_engine::store::builder::{
            FULL_COVERAGE, Join, MergeAction, MergeState, MergeTable, Merging, Overlay, RecordRef,
            ReusableSource, RunFile, StoredNode, Subtree, joined_coverage,
        };
    }

    /// Records of segments, as they stand in files.
    pub mod records {
        pub use spinney_container::{CUT, INNER, LEAF, VOID};
        pub use spinney_engine::store::records::{RecordHead, RecordLayout};
    }
}

/// Trees that are built in shards, by many processes.
#[cfg(feature = "shards")]
pub mod shards {
    pub use spinney_shards::{Built, GivenLayers, Job, JobSpec, Planned, plan, plan_given};
}

/// Questions to trees: what is asked, and what is answered.
pub mod query {
    pub use spinney_engine::ops::{Label, LabelNeighbour, LabelRequest, LabelSummary, LabelVisitor};
    pub use spinney_engine::query::{
        CellHit, ChannelStatistics, ClassRegion, Condition, Contour, ContourEnds, ContourLevels,
        ContourRequest, ContourSummary, ContourVisitor, FoundBlock, PointSamples, PolygonRequest,
        PolygonSummary, Ray, Rays, RegionVisitor, SolidStatistics, SolidSurface, Statistics, StoredRows,
        SurfaceHit, ZonalRequest, ZoneChannel, ZoneMeasure, ZoneStatistics, ZoneValues,
    };

    /// Cells of a level, block by block, with those around them.
    pub mod cell_blocks {
        pub use spinney_engine::query::cell_blocks::{
            Block, BlockAttribute, BlockAttributeValues, BlockState, CellBlocks, SIDE, SourceBlocks,
            can_be_block_attribute,
        };
    }
}

/// Operations as sources, and from files to files: views, other coordinate systems, set operations, edits, conversions.
pub mod ops {
    pub use spinney_engine::ops::{
        AffineMap, Alignment, Around, Axis, BlockSource, Blockwise, Calculated, Calculation, CellPatch,
        CellValue, Change, CombineOperation, Combined, CombinedNode, Connectivity, Difference, Differences,
        Edit, FdRange, FileView, FillPatch, FillRegion, LayerInfo, MAX_ZOOM, MadeOperand, MemoryTree, Opaque,
        Outcome, Pair, PairOfSamples, Patch, Patched, PatchedNode, Prefer, Regions, Resampling, Sampling,
        Sieve, TreeFile, TreeFileNode, Turn, Universe, View, ViewNode, ViewSource, ViewSourceNode, ViewStep,
        WarpGrid, WarpOptions, WarpTarget, Warped, add_layer, align, apply_edits, blame, build, combine,
        combine_with, convert, crosstab, crosstab_files, data_box, diff, diff_files, differences, drop_layer,
        edit, layer_paths, only_layer, transform, transform_to, warp,
    };
}

/// Manifests: many files as one.
pub mod manifest {
    pub use spinney_engine::ops::{Mosaic, MosaicNode, list_files};
    pub use spinney_manifest::{FileTag, ListedFile, Manifest, is_manifest};
}

/// A file, or a view of one, with every question.
pub mod dataset {
    pub use spinney_engine::dataset::{Dataset, Rebuild, open, open_view};
}

/// Exact models: boundary representations on an integer grid, kept as they are and not as cells.
#[cfg(feature = "brep")]
pub mod brep {
    pub use spinney_brep::{
        AttributedFaceVisitor, Attributes, BoundaryPart, BuildReport, ChosenParts, ColumnValues,
        CombineReport, ContactKind, ContactVisitor, Defect, DefectKind, ExactModel, Face, FaceBuffer,
        FaceList, Faces, Grid, InsideRule, LEAF_SIZE, LeafRule, MAX_BITS, ModelBuilder, ModelNode,
        ModelNodeState, ModelView, Motion, NodeCounts, NodeKind, ObjectContact, Repair, TransformOptions,
        TransformReport, Triangulated, ViewRays, boundary_parts, combine, divide_faces, is_model_file,
        object_contacts, transform,
    };

    /// Answers of exact models.
    pub mod query {
        pub use spinney_brep::query::{
            BoxLocation, CellCoverage, Coverage, CoverageSums, Crossing, Cube, CuttingPlane, Hit, Line,
            Location, MassProperties, MassSums, ModelRays, Nearest, PartMeasures, SectionPolygon,
            SectionVisitor, SurfacePoint, Visited, nearest_on_face,
        };
    }

    /// Lines, points and areas that the surfaces of two models have in common.
    pub mod surface_intersection {
        pub use spinney_brep::surface_intersection::{
            IntersectionArea, IntersectionLine, IntersectionPoint, LineKind, SurfaceIntersection,
            surface_intersection,
        };
    }

    /// How faces hang together.
    pub mod topology {
        pub use spinney_brep::topology::{Counts, Euler, EulerBody, EulerCorner, Topology, TopologyOptions};
    }
}

/// Trees of points: each once, in the coarsest node whose spacing it keeps, with attributes; LAS and LAZ in and out.
#[cfg(feature = "points")]
pub mod points {
    pub use spinney_points::las::{LasFiles, LasReader};
    pub use spinney_points::memory;
    pub use spinney_points::{
        BuildSummary, ChosenPoints, ColumnSummary, GriddedPoints, NearPoint, POSITION_BYTES, PointAttribute,
        PointBuildOptions, PointColumns, PointCondition, PointFormat, PointGrid, PointImport,
        PointImportOptions, PointPart, PointRegion, PointRows, PointSchema, PointSource, PointStatistics,
        PointTree, Relation, RowField, RowLayout, Selection, WorldPoints, build, export_points, has_points,
        is_las_file, is_point_file, ordered_number, plan_files, plan_points, position,
    };
    #[cfg(feature = "vector")]
    pub use spinney_vector::{CellRule, PointRaster, rasterize_points};
}

/// Trees of lines: each piece of a line once, in the deepest node that is no smaller than it and has its middle, and the features with their attributes.
#[cfg(feature = "lines")]
pub mod lines {
    pub use spinney_lines::memory;
    pub use spinney_lines::{
        LevelTotals, LineAttribute, LineBuildOptions, LineBuildSummary, LineCrossing, LineFeature, LineGrid,
        LineSchema, LineSource, LineTree, LineValue, LinesInMemory, NearLine, NearestLines, ValueKind, build,
        is_line_file,
    };
    #[cfg(feature = "vector")]
    pub use spinney_vector::{
        CrossingSummary, JoinSummary, export_lines, join_crossing_lines, join_nearest_lines,
    };
}

/// Solids of primitives that are moved and combined, as a text tells them: octrees, and exact models.
#[cfg(feature = "csg")]
pub mod csg {
    pub use spinney_csg::{Csg, CsgExactOptions, CsgExactReport, CsgImport, import_exact_csg};
}

/// Solids of what was seen of them: octrees that are carved by pictures from known directions, and of outlines at heights.
#[cfg(feature = "reconstruction")]
pub mod reconstruction {
    pub use spinney_reconstruction::{ReconstructionImport, is_views_name, plan_outlines, plan_views};
}

/// Polygons with holes on an integer grid: against octants, into triangles, and as single rings. Exact, in integers.
#[cfg(feature = "brep")]
pub mod geometry {
    pub use spinney_brep::geometry::{
        Box3, Flaw, GridPolygon, Intersection, Stage, Stages, Triangulator, join_rings, split_bridges,
    };
}

/// Trees that divide space in two: bintrees, which halve blocks of cells, and BSP trees of the plane and of space.
#[cfg(feature = "brep")]
pub mod partitions {
    pub use spinney_partitions::bintree::{Bintree, BintreeNode, Halving, MAX_CELLS};
    pub use spinney_partitions::bsp::{Bsp, BspBlocks, BspNode, BspPiece, Division, MAX_PIECES, Seen};
    pub use spinney_partitions::preorder::BinaryNode;
}

/// Surfaces over the plane as triangulated irregular networks (TIN), and the layers between them.
#[cfg(feature = "vector")]
pub mod tin {
    pub use spinney_tin::{
        Duplicates, HeightGrid, Isoline, LayerInput, LayerMeasure, LayerOptions, LayerReport, LayerSurface,
        SurfaceInput, SurfaceReport, Tin, approximate, build_layers, triangulate,
    };
    pub use spinney_vector::{
        SurfaceFiles, SurfacePoints, export_isolines, read_heights, read_surfaces, write_surface,
    };
}

/// How values become colours, whatever is drawn.
#[cfg(feature = "raster")]
pub mod style {
    pub use spinney_style::{
        Ground, Key, Legend, LegendClass, LegendImage, LegendSection, SampleBlock, Style, StylePainter, Tick,
    };
}

/// Readers of other programs' files.
pub mod import {
    /// Lists of cells and their values.
    #[cfg(feature = "raster")]
    pub mod cells {
        pub use spinney_raster::cells::CellList;
    }

    /// Features: points, lines and polygons with attributes.
    #[cfg(feature = "vector")]
    pub mod feature {
        pub use spinney_vector::import::feature::{
            Feature, FeatureAttribute, FeatureGeometry, FeatureOptions, FeatureReader, FeatureSchema,
            Heights, is_feature_file, open_features,
        };
        pub use spinney_vector::import::filter::{AttributeCondition, FeatureFilter, Relation};
        pub use spinney_vector::import::zones::{
            FoundPolygons, PolygonLayer, PolygonReader, parse_polygons, read_polygons,
        };
        pub use spinney_vector::import::{FeatureLines, open_feature_lines, plan_point_files};
        pub use spinney_vector::objects::choose_objects;
        pub use spinney_vector::zonal::FeatureZones;
    }

    /// Meshes: solids of cells, and exact models.
    #[cfg(feature = "mesh")]
    pub mod mesh {
        pub use spinney_mesh::import::{
            Attribute, DEFAULT_MEMORY, ExactOptions, ExactReport, InsideTest, MeshArrays, MeshColours,
            MeshFace, Model, ModelContact, ModelInfo, Resolution, SkippedObject, SolidImport, SolidOptions,
            SolidReport, SolidSurvey, SurfaceAtPoint, SurveyedNode, import_exact, is_model, model_contacts,
            open, open_all, parts_of, plan_models, plan_part,
        };
    }

    /// Picture files.
    #[cfg(feature = "raster")]
    pub mod raster {
        pub use spinney_raster::import::{
            Band, BandInfo, DEFAULT_MEMORY, ImportOptions, Order, Pixels, Raster, RasterImport, RasterInfo,
            RasterOptions, RasterSlabs, Stack, StackLayer, StackOptions, TargetGrid, WarpedBuilt, mosaic,
            open, plan, plan_stack, select, spill, value_type, write_stack,
        };
    }

    /// Rasterization: quadtrees of features.
    #[cfg(feature = "vector")]
    pub mod rasterize {
        pub use spinney_vector::import::rasterize::{
            FeatureGrid, FeatureImport, FeatureTree, FeatureValue, LineWidth, Overlaps, RasterizeOptions,
            plan_features,
        };
    }

    /// Volumes.
    #[cfg(feature = "raster")]
    pub mod volume {
        pub use spinney_raster::volume::{
            RawLayout, VolumeImport, VolumeInput, VolumeOptions, is_volume, plan, plan_raw, plan_sections,
        };
    }
}

/// Writers of other programs' files.
pub mod export {
    #[cfg(feature = "raster")]
    pub use spinney_raster::{
        ArrayRequest, ChainDirections, ChainWriter, CogCompression, CogRequest, CogSummary, Detail,
        LegendFormat, RowSink, WindowRequest, export_array, export_chain_code, export_cog, export_layers,
        export_legend, export_window, fill_for, void_number, window_rows,
    };
    #[cfg(feature = "render")]
    pub use spinney_render::{
        CameraProjection, DrawingFormat, DrawingStyle, RenderRequest, draw_cells, draw_exact, render,
        render_exact,
    };

    /// Pictures and arrays, written row by row.
    #[cfg(feature = "raster")]
    pub mod image {
        pub use spinney_raster::image::{Format, ImageSpec, RowWriter, create, format_of};
    }

    /// Surfaces of trees and of exact models.
    #[cfg(feature = "mesh")]
    pub mod mesh {
        pub use spinney_mesh::export::{
            ExactSummary, FaceAttribute, GltfOptions, IsosurfaceSummary, MeshFormat, MeshRequest,
            MeshSummary, SurfaceMesh, TilesetSummary, export_blocks, export_exact, export_glb,
            export_isosurfaces, export_mesh, export_tileset, export_triangles, isosurface_mesh, surface_mesh,
        };
    }

    /// Pages that show files in a browser.
    #[cfg(feature = "site")]
    pub mod page {
        pub use spinney_site::{
            PageConfiguration, PageFile, PageRequest, PageSource, PageStart, PageSummary, export_page,
            inline_page,
        };
    }

    /// Tiles of maps.
    #[cfg(feature = "raster")]
    pub mod tiles {
        pub use spinney_raster::tile_archives::{
            Pmtiles, SourceState, TileArchiveSummary, TileEncoding, TileFolder, TileFormat, TilePart,
            TileProvenance, TileRequest, TileTarget, TileUpdate, UpdateOptions, draw_tiles, encode_tile,
            export_pmtiles, export_tiles, is_tile_archive, is_tile_folder, verify_tiles,
        };
        pub use spinney_tiles::{
            GeographicExtent, MAX_ZOOM, TileContent, TileId, TilePainter, TileRange, TileSamples, TileSource,
            TreeTiles, WarpedTiles, degrees_of, draw_tile, tile_source,
        };
    }

    /// Lines and polygons.
    #[cfg(feature = "vector")]
    pub mod vector {
        pub use spinney_vector::export::{
            AttributeType, AttributeValue, ContourFeatures, FeatureParts, Geometry, GeometryKind,
            IntersectionSummary, SectionPlanes, SectionSummary, Smoothed, VectorFeature, VectorFormat,
            VectorLayer, VectorWriter, export_contours, export_intersection, export_objects, export_polygons,
            export_section, export_zones, quantile_name,
        };
    }
}

/// Answers as JSON, as the program prints them and the server sends them.
#[cfg(feature = "report")]
pub mod report {
    pub use spinney_report::{
        Bins, JsonNumbers, OUTSIDE, PointLayers, PointReport, ZoneForm, ZoneReport, bins_as_json, bins_of,
        bins_with, cell_area, channels_as_json, class_as_json, class_name, commit_as_json, printable_json,
        statistics_as_json, statistics_of, void_share, write_number,
    };
}

/// A server of files and answers.
#[cfg(feature = "serve")]
pub mod serve {
    pub use spinney_serve::{ServeOptions, Server};
}

/// Set operations of polygons.
#[cfg(feature = "vector")]
pub mod overlay {
    pub use spinney_vector::overlay::{
        OverlayOperation, OverlayReport, OverlayRequest, OverlaySummary, overlay_features,
        read_polygon_layers,
    };
}

use std::path::Path;

/// Makes a tree of a picture file, a volume, or another tree: a `.goblin` file, or an `.autumn` file, which can be edited. Data that do not fit into
/// memory ([`import::raster::DEFAULT_MEMORY`]) go to a temporary file beside the output, which appears when it is whole.
///
/// [`import::raster::plan`] and [`import::volume::plan`] take options, and tell beforehand what will be built. Meshes become solids
/// by `import::mesh::plan_models`, or exact models by `import::mesh::import_exact`.
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
/// If the input cannot be read, is of no such format, is damaged or uses something unsupported, or if the output cannot be written.
#[cfg(feature = "raster")]
pub fn build(input: impl AsRef<Path>, output: impl AsRef<Path>) -> Result<()> {
    build_tree(input.as_ref(), output.as_ref())
}

/// Implements [`build`], once for all types of paths.
#[cfg(feature = "raster")]
fn build_tree(input: &Path, output: &Path) -> Result<()> {
    if store::file_is_tree(input) {
        let tree = open(input)?;
        return tree.build(
            &tree.build_options(import::raster::DEFAULT_MEMORY),
            store::create_tree_file(output)?,
            &(),
        );
    }
    if import::volume::is_volume(input) {
        let volume = import::volume::plan(input, &import::volume::VolumeOptions::new())?;
        return volume.build(store::create_tree_file(output)?, &());
    }
    let picture = import::raster::plan(&[input.to_path_buf()], &import::raster::ImportOptions::new())?;
    picture.build(store::create_tree_file(output)?, &())
}

/// Opens a tree file of either format and any type, or a commit of one: `map.autumn@12` is commit 12 of `map.autumn`.
/// [`dataset::open`] takes options.
///
/// ```
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let mut class = [spinney::value::Number::default(); 4];
/// assert!(map.point([20, 20, 0], map.depth(), &mut class)?);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If it cannot be read, is no tree file, is damaged, or of a newer version.
pub fn open(path: impl AsRef<Path>) -> Result<dataset::Dataset> {
    dataset::open(path.as_ref(), &store::OpenOptions::new())
}

/// Compiles the README's Rust blocks.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
