//! Building blocks without a stability promise: everything that the program, the bindings and the
//! tests of Spinney use and that is not in the library's public interface. Any version may change
//! names in this module.

/// Lets this process read the cells of indexes from the files that have them. [`open`](crate::open)
/// does it; call this before other functions that open files. Without the feature `indexes` it has
/// no effect.
pub fn register() {
    #[cfg(feature = "indexes")]
    spinney_references::register();
}

/// Node codes and boxes, and the georeferencing of cells.
pub mod space {
    pub use spinney_base::space::{Cell, CodeRange, Cover, Up};
    pub use spinney_crs::{
        ControlPoint, ControlPoints, Epsg, GeoKeys, PROJECTION_METHODS, PolygonParts, Projection,
        WEB_MERCATOR, WEB_MERCATOR_HALF, WEB_MERCATOR_LATITUDE, web_mercator, web_mercator_depth,
    };
}

/// Cell values: samples, dynamically typed values, sums over many cells, and the rules for coarse
/// levels.
pub mod value {
    pub use spinney_base::value::{
        DoubleDouble, Mask, Numbers, Palette, Sample, Samples, SquareSum, Sums, ZoneStats,
    };
}

/// File access: mapped reads, positioned reads, remote range reads, and atomic writes.
pub mod io {
    pub use spinney_base::io::{
        CachedBytes, CompletionRecord, DEFAULT_GAP, Faults, Fetch, FileBytes, FileId, FileStat, FileVersion,
        Mapped, OutputDirectory, Positioned, RangeCache, RangeFile, ReadBackend, RemoteFiles, RemoteWriter,
        ReplaceLock, Warn, WriteBackend, any_file, gdal_url, listed_path, redacted, shown, url_of,
        without_query,
    };

    /// Restartable, batched queries of remote files.
    pub mod batch {
        pub use spinney_base::io::batch::{
            MissingRange, Traffic, defer_missing, finish_deferred, map, run_batched, try_once,
        };
    }
}

/// Sources, which can be traversed from the root down, and the in-memory tree.
pub mod tree {
    pub use spinney_engine::tree::{CellBlock, no_children};

    /// DF-expressions: trees in text form and in binary form.
    pub mod df {
        pub use spinney_engine::tree::df::{from_text, to_packed, to_text};
    }
}

/// Trees on disk: the two formats, their common code, and the builders.
pub mod store {
    pub use spinney_container::{
        ByteSource, FileReference, Finding, LevelCounts, RangeSummary, ScopedTags, Shape, ShardSummary, Tag,
        TagScope, TreeFormat, Unit, check_tree_name, create_tree_file, file_is_tree, file_of, shell_word,
    };
    pub use spinney_engine::store::{
        Packing, ShardCheck, SlabBoxes, TreeTarget, TreeWriter, WantedCells, build_tree, depth_for,
    };

    /// The compact, read-only format.
    pub mod goblin {
        pub use spinney_engine::store::goblin::{
            Entry, Goblin, GoblinNode, LevelBytes, MergeOutput, Segment, Shard, ShardRange, merge_shards,
        };
    }

    /// The format with pointers, which can be edited and has a history.
    pub mod autumnal {
        pub use spinney_engine::store::autumnal::{
            Autumnal, AutumnalNode, CommitLayer, CompactOptions, History, Keep, WriteSummary, compact,
            recover,
        };
    }

    /// Stored records that a source may offer to builders in addition to its cells.
    pub mod builder {
        pub use spinney_engine::store::builder::{
            FULL_COVERAGE, Join, MergeAction, MergeState, MergeTable, Merging, Overlay, RecordFile,
            RecordRef, ReusableSource, StoredNode, Subtree, joined_coverage,
        };
    }

    /// Records of segments, as stored in files.
    pub mod records {
        pub use spinney_container::{CUT, INNER, LEAF, VOID};
        pub use spinney_engine::store::records::{RecordHead, RecordLayout};
    }
}

/// Sharded builds: trees that many processes build.
#[cfg(feature = "shards")]
pub mod shards {
    pub use spinney_shards::{
        ArrayLayers, Job, JobSpec, MergeOptions, MergeOutcome, PlanOutcome, ShardOutcome, merge, plan,
        plan_arrays,
    };
}

/// Queries of trees: requests and results.
pub mod query {
    pub use spinney_engine::ops::{Label, LabelNeighbour, LabelRequest, LabelSummary, LabelVisitor};
    pub use spinney_engine::query::{
        CellHit, ContourEnds, ContourSummary, ContourVisitor, PolygonSummary, RegionVisitor, SolidStatistics,
        SolidSurface, StoredRows, ZoneChannel, ZoneValues,
    };

    /// Blocks of a level's cells, with their neighbours.
    pub mod cell_blocks {
        pub use spinney_engine::query::cell_blocks::{
            Block, BlockAttribute, BlockAttributeValues, BlockState, CellBlocks, SIDE, SourceBlocks,
            can_be_block_attribute,
        };
    }
}

/// Operations as sources, and from files to files: views, reprojection, set operations, edits,
/// conversions.
pub mod ops {
    pub use spinney_engine::ops::{
        AffineMap, Around, Axis, BlockSource, Blockwise, Calculated, Calculation, CellPatch, Change,
        ClassMatching, Coarse, CoarseNode, Combined, CombinedNode, CompareReport, Connectivity, Conversion,
        Converted, Difference, Differences, FdRange, FillPatch, LayerInfo, MAX_ZOOM, MadeOperand, MemoryTree,
        Outcome, OutputExtent, Pair, PairOfSamples, Patch, Patched, PatchedNode, Prefer, ReconcileOptions,
        Regions, RotationAxis, Sampling, Sieve, TreeFile, TreeFileNode, View, ViewNode, ViewSource,
        ViewSourceNode, WarpGrid, WarpTarget, Warped, add_layer, apply_edits, blame, build, combine_with,
        crosstab, crosstab_files, data_box, diff, diff_files, differences, drop_layer, layer_paths,
        only_layer, overwritten_input, transform_to, warp,
    };
}

/// Manifests: many files as one.
pub mod manifest {
    pub use spinney_engine::ops::{Mosaic, MosaicNode, list_files};
    pub use spinney_manifest::{FileTag, ListedFile, Manifest, is_manifest};
}

/// A file, or a view of one, with every query.
pub mod dataset {
    pub use spinney_engine::dataset::{Rebuild, open, open_view};
}

/// Exact models: boundary representations on an integer grid, stored unchanged, not as cells.
#[cfg(feature = "brep")]
pub mod brep {
    pub use spinney_brep::{
        AttributedFaceVisitor, Attributes, BoundaryClass, BuildReport, ChosenParts, ColumnValues,
        CombineReport, ContactKind, ContactVisitor, Defect, DefectKind, FaceList, InsideRule, LEAF_SIZE,
        LeafRule, MAX_BITS, ModelBuilder, ModelNode, ModelNodeState, ModelView, NodeCounts, NodeKind,
        NodePair, ObjectContact, OperandKind, Repair, TableEntry, TransformReport, Triangulated, ViewRays,
        boundary_classes, combine_explained, divide_faces, each_triangle, is_model_file, object_contacts,
    };

    /// Query results of exact models.
    pub mod query {
        pub use spinney_brep::query::{
            CellCoverage, Coverage, CoverageSums, Crossing, Cube, Line, MassSums, ModelRays, Nearest,
            PartMeasures, SectionPolygon, SectionVisitor, Visited, nearest_on_face,
        };
    }

    /// Lines, points and areas that the surfaces of two models share.
    pub mod surface_intersection {
        pub use spinney_brep::surface_intersection::{
            IntersectionArea, IntersectionLine, IntersectionPoint, LineKind, SurfaceIntersection,
            surface_intersection,
        };
    }

    /// Connectivity of faces.
    pub mod topology {
        pub use spinney_brep::topology::{Counts, Euler, Topology, TopologyOptions};
    }

    /// Euler operators, which change the connectivity of faces.
    pub mod euler {
        pub use spinney_brep::euler::{
            EditReport, EditedModel, EulerBody, EulerCorner, EulerText, LocalChange, ModelBody, TextLimits,
            apply_local, edit_model, euler_text,
        };
    }
}

/// Trees of points with attributes: each point is stored once, in the coarsest node whose spacing
/// it keeps. Reads and writes LAS and LAZ.
#[cfg(feature = "points")]
pub mod points {
    pub use spinney_points::las::{LasFiles, LasReader};
    pub use spinney_points::{
        BuildSummary, ChosenPoints, ColumnSummary, GriddedPoints, NearPoint, POSITION_BYTES, PointAttribute,
        PointBuildOptions, PointColumns, PointCondition, PointFormat, PointGrid, PointRows, PointSchema,
        PointSource, PointStatistics, PointSubset, Relation, RowField, RowLayout, WorldPoints,
        attribute_index, build, export_points, has_points, is_las_file, is_point_file, ordered_number,
        plan_points,
    };
    #[cfg(feature = "vector")]
    pub use spinney_vector::{CellRule, PointRaster, rasterize_points, region_of_polygons};
}

/// Trees of lines, and the features with their attributes. Each line segment is stored once, in the
/// deepest node that contains its middle and is no smaller than it.
#[cfg(feature = "lines")]
pub mod lines {
    pub use spinney_lines::{
        LevelTotals, LineAttribute, LineBuildSummary, LineCrossing, LineGrid, LineSchema, LineSource,
        LineValue, NearLine, NearestLines, ROUNDED, ValueKind, VertexGrid, VertexSurvey, is_line_file,
    };
    #[cfg(feature = "vector")]
    pub use spinney_vector::{
        CrossingSummary, JoinSummary, export_lines, join_crossing_lines, join_nearest_lines,
    };
}

/// Constructive solid geometry (CSG) from a text format: octrees, and exact models.
#[cfg(feature = "csg")]
pub mod csg {
    pub use spinney_csg::{Csg, CsgExactOptions, CsgExactReport, CsgImport, ShellReport, import_exact_csg};
}

/// Solids reconstructed from observations: octrees carved by images with known view directions, or
/// by outlines at heights.
#[cfg(feature = "reconstruction")]
pub mod reconstruction {
    pub use spinney_reconstruction::{ReconstructionImport, is_views_name, plan_outlines, plan_views};
}

/// Polygons with holes on an integer grid: intersection with octants, triangulation, and splitting
/// into single rings. Computes exactly, in integers.
#[cfg(feature = "brep")]
pub mod geometry {
    pub use spinney_brep::geometry::{
        Box3, Flaw, GridPolygon, Intersection, Stage, Stages, Triangulator, join_rings, split_bridges,
    };
}

/// Structures of the literature in memory: bintrees, which halve blocks of cells; BSP trees of the
/// plane and of space; PM quadtrees of edges; trees that are divided at their points.
#[cfg(feature = "brep")]
pub mod partitions {
    pub use spinney_partitions::bintree::{Bintree, BintreeNode, Halving, MAX_CELLS};
    pub use spinney_partitions::bsp::{
        Bsp, BspBlocks, BspFragment, BspItem, BspNode, Division, MAX_FRAGMENTS, PlaneText,
    };
    pub use spinney_partitions::divided_points::{DividedPoint, DividedPoints, PointDivision};
    pub use spinney_partitions::edges::{EdgeLeaf, EdgeTree, EdgeTreeCounts, PmRule};
    pub use spinney_partitions::preorder::BinaryNode;
    pub use spinney_partitions::{DfText, SolidText, df_head, extended_octree_text};
}

/// Values within bodies, interpolated from samples.
#[cfg(feature = "vector")]
pub mod body_values {
    pub use spinney_vector::{BodySamples, BodyValueOptions, build_body_values, read_samples};
}

/// Surfaces over the plane as triangulated irregular networks (TIN), and the layers between them.
#[cfg(feature = "vector")]
pub mod tin {
    pub use spinney_tin::{
        Duplicates, HeightGrid, Isoline, LayerInput, LayerMeasure, LayerOptions, LayerReport, LayerSurface,
        OrderedSurfaces, Smoothing, SurfaceInput, SurfaceReport, Tin, approximate, build_layers,
        order_surfaces, triangulate,
    };
    pub use spinney_vector::{
        BoreholeAttributes, BoreholeReport, SurfaceFiles, SurfacePoints, SurfaceRaster, export_isolines,
        read_heights, read_surfaces, write_surface,
    };
}

/// Colours of values, for all drawings.
#[cfg(feature = "raster")]
pub mod style {
    pub use spinney_style::{
        Ground, Key, LegendClass, LegendImage, LegendSection, SampleBlock, StylePainter, Tick,
    };
}

/// Readers of other programs' formats.
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
            Feature, FeatureAttribute, FeatureGeometry, FeatureReader, FeatureSchema, Heights,
            is_feature_file, open_features,
        };
        pub use spinney_vector::import::filter::{AttributeCondition, Relation};
        pub use spinney_vector::import::zones::{
            FoundPolygons, PolygonLayer, PolygonReader, parse_polygons, read_polygons,
        };
        pub use spinney_vector::import::{FeatureLines, open_feature_lines, plan_point_files};
        pub use spinney_vector::objects::choose_objects;
        pub use spinney_vector::zonal::FeatureZones;
        pub use spinney_vector::{ReprojectOptions, SystemChange, reproject_features};
    }

    /// Meshes: solids of cells, and exact models.
    #[cfg(feature = "mesh")]
    pub mod mesh {
        pub use spinney_mesh::import::{
            Attribute, DEFAULT_MEMORY, EdgeOptions, ExactReport, InsideTest, MeshArrays, MeshColours,
            MeshEdges, MeshFace, Model, ModelContact, ModelInfo, SkippedObject, SolidReport, SolidSurvey,
            SurfaceAtPoint, SurveyedNode, fit_cells, is_model, model_contacts, open, open_all_with,
            open_mesh_edges, open_with, parts_of, plan_part,
        };
    }

    /// Raster files.
    #[cfg(feature = "raster")]
    pub mod raster {
        pub use spinney_raster::import::{
            Band, BandInfo, DEFAULT_MEMORY, Order, Pixels, Raster, RasterInfo, RasterOptions, RasterSlabs,
            StackLayer, TargetGrid, WarpedBuilt, mosaic, needs_layers, open, select, spill, value_type,
            write_stack,
        };
        pub use spinney_raster::index::{
            IndexUpdate, SourceFile, SourceRecorder, SourceWindow, UpdateReport, expand_sources, update_index,
        };
    }

    /// Rasterization: quadtrees of features.
    #[cfg(feature = "vector")]
    pub mod rasterize {
        pub use spinney_vector::import::rasterize::{FeatureGrid, FeatureTree, LineWidth, Overlaps};
    }

    /// Volumes.
    #[cfg(feature = "raster")]
    pub mod volume {
        pub use spinney_raster::volume::{RawLayout, VolumeInput, is_volume, plan_raw, plan_sections};
    }
}

/// Writers of other programs' formats.
pub mod export {
    #[cfg(feature = "raster")]
    pub use spinney_raster::{
        ChainDirections, ChainWriter, CogSummary, LegendFormat, RowSink, export_chain_code, export_layers,
        export_legend, void_number, window_rows,
    };
    #[cfg(feature = "render")]
    pub use spinney_render::{CameraProjection, DrawingFormat, DrawingStyle, draw_cells, draw_exact};

    /// Images and arrays, written row by row.
    #[cfg(feature = "raster")]
    pub mod image {
        pub use spinney_raster::image::{Format, ImageSpec, RowWriter, create, format_of};
    }

    /// Surfaces of trees and of exact models.
    #[cfg(feature = "mesh")]
    pub mod mesh {
        pub use spinney_mesh::export::{
            ExactSummary, FaceAttribute, IsosurfaceSummary, MeshSummary, ModelTilesSummary, SurfaceMesh,
            TilesetSummary, export_blocks, export_isosurfaces, export_triangles, isosurface_mesh,
            surface_mesh,
        };
    }

    /// Pages that show files in a browser.
    #[cfg(feature = "site")]
    pub mod page {
        pub use spinney_site::{
            PageConfiguration, PageContent, PageSource, PageStart, PageSummary, inline_page,
        };
    }

    /// Map tiles.
    #[cfg(feature = "raster")]
    pub mod tiles {
        pub use spinney_raster::tile_archives::{
            Pmtiles, SourceState, TileArchiveSummary, TileDirectory, TileProvenance, TileShard, TileTarget,
            TileUpdate, UpdateOptions, draw_tiles, encode_tile, is_tile_archive, is_tile_directory,
            verify_tiles,
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
            IntersectionSummary, LineSectionFigure, LineSectionOptions, LineSectionSummary, SectionLine,
            SectionPlanes, SectionSummary, Smoothed, VectorFeature, VectorLayer, VectorWriter,
            export_intersection, export_line_section, export_objects, export_section, export_zones,
            line_section, quantile_name,
        };
    }
}

/// Results as JSON, as the program prints them and the server sends them.
#[cfg(feature = "report")]
pub mod report {
    pub use spinney_report::{
        Bins, CellMeasure, JsonNumbers, OUTSIDE, PointLayers, PointReport, ZoneForm, ZoneReport,
        bins_as_json, bins_of, bins_with, channels_as_json, class_as_json, class_name, commit_as_json,
        filled, integral, measure_key, measure_name, printable_json, statistics_as_json, statistics_of,
        void_share, world_unit, write_number,
    };
}

/// Set operations of polygons.
#[cfg(feature = "vector")]
pub mod overlay {
    pub use spinney_vector::overlay::{
        OverlayOperation, OverlayReport, OverlayRequest, OverlaySummary, overlay_features,
        read_polygon_layers,
    };
}
