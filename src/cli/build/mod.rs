//! `spinney build`: trees of rasters, volumes, solids and features.

mod bintree;
mod csg;
mod exact;
mod features;
mod lines;
mod pictures;
pub(super) mod points;
mod reconstruction;
mod solids;
mod surfaces;
mod tree;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use spinney::import::feature::FeatureImport;
use spinney::import::mesh::SolidImport;
use spinney::import::volume::VolumeImport;
use spinney::raw::csg::Csg;
use spinney::raw::import::mesh;
use spinney::raw::import::raster::{self, TargetGrid};
use spinney::raw::io::any_file;
use spinney::{Dataset, FileAccess, Progress};

use spinney::points::PointImport;
use spinney::raw::ops::WarpGrid;
use spinney::raw::reconstruction::{ReconstructionImport, is_views_name};
use spinney::raw::store::{TreeFormat, check_tree_name, file_is_tree};
use spinney::{Crs, Output, WarpOptions};

use self::bintree::BintreeImport;
use self::csg::PrimitivesImport;
use self::exact::ExactImport;
use self::features::{FeatureArgs, Index};
pub(super) use self::pictures::PictureArgs;
pub(super) use self::solids::SolidArgs;
use self::surfaces::{SurfaceArgs, SurfaceImport};
use self::tree::TreeImport;
pub(super) use self::tree::spec as tree_spec;
use super::args::{GivenOptions, Memory, OutputLimit, Packing, check_output, expand_lists, parse_crs};
use super::lines::LineImport;
use super::report::{Work, report_built};
use super::{Global, open};

/// Make a tree of a raster, or of several on one grid, of a volume, of models of solids, of
/// features, of points, or of lines.
///
/// Reads TIFF and GeoTIFF, PNG, OpenEXR and SRTM .hgt files of any size, and JPEG, WebP, BMP, GIF,
/// PNM, TGA, QOI and Radiance HDR files that fit in --memory. Writes one file with all levels of
/// detail: a .goblin file, compact and read-only, or an .autumn file, which can be edited. Metadata
/// of the pixels (coordinates, nodata, palette, names) are kept; options override them.
///
/// Reads Freeman chain codes of regions (docs/chain_codes.md has their grammar), as `export` writes
/// them to .chain files, or of a single outline.
///
/// Reads volumes, such as those of scanners: NPY files, as numpy.save writes them, of shape (z, y,
/// x) in C order, or (z, y, x, channels); NRRD files, raw or compressed, with their coordinates and
/// units; raw files of samples (--raw-size); and sections, an image or a page for each plane
/// (--pages z), from files or a directory. They become octrees of their samples. `get` writes these
/// as NPY or NRRD again, and `contours` makes isosurfaces of them.
///
/// Reads models of solids: PLY, OBJ, STL, OFF, CityJSON and CityJSONSeq. What their surface
/// encloses becomes an octree: exactly if the surface is closed, also with overlapping bodies and
/// cavities, and by its winding field, to 0.01, if it is open. Several models become one solid.
/// With --brep the faces themselves are stored; they must bound a body.
///
/// Reads constructive solid geometry: a text file (.csg) of block, ball, cylinder, cone, torus,
/// half_space, prism, sweep and revolve, moved by translate, scale, rotate, mirror and affine, and
/// combined by union, intersection, difference, xor and complement, such as
/// 'difference(block(0,0,0, 4,4,2), cylinder(2,2,0, 2,2,2, 1));' (see docs/csg.md). --deviation
/// limits the distance between facets and curved surfaces in an exact model.
///
/// Reads views of a solid: a JSON file (.views) that lists images, silhouettes or depths, and their
/// view directions. The octree has all cells that no view shows to be empty (see
/// docs/reconstruction.md).
///
/// Reads features: points, lines and polygons of GeoJSON, FlatGeobuf, GeoPackage (x.gpkg:NAME is
/// one layer of several), shapefiles and CSV with geometries. They are rasterized exactly, without
/// an intermediate raster, to cells with the value of an attribute.
///
/// Reads point clouds: LAS and LAZ, and with --index points the vertices of PLY files and arrays of
/// NumPy (x, y and z). They become a tree of points with their attributes. Each point is stored
/// once; coarse levels have an evenly spread subset.
///
/// For features that are points, such as boreholes, --tin makes a triangulated surface: a raster of
/// its heights, or, of several heights and with --brep, the layers between their surfaces as an
/// exact model, each an object of its own (docs/surfaces.md).
///
/// For features that are polygons at heights, such as sections of a body, --heights makes an octree
/// of the solid between them.
///
/// Reads bintrees as text, .bintree files with the output of `dump --bintree`: the same cells,
/// without the tree's other metadata.
///
/// Reads a tree, and keeps the metadata of its cells, such as kind, rule, coordinate system and
/// names, unless options override them: with another --rule, coarser levels are computed again.
///
/// Data that do not fit into --memory go to a temporary file next to the output.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Raster files (of several, the last lies on top), a volume, models, a CSG or views file,
    /// files of features or points, or a tree; @FILE reads paths from a file, one a line
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    #[command(flatten)]
    common: Common,
    // (Headings apply to all options that follow.)
    #[command(flatten)]
    pictures: PictureArgs,
    #[command(flatten)]
    solids: SolidArgs,
    #[command(flatten)]
    features: FeatureArgs,
    #[command(flatten)]
    surfaces: SurfaceArgs,
}

/// Options for rasters, volumes and solids.
#[derive(clap::Args)]
pub(super) struct Common {
    /// Levels of the tree; its space has 2^N cells along a side [default: the minimum that holds
    /// the input]
    #[arg(long, value_name = "N")]
    depth: Option<u8>,
    /// Coordinate system of the input: EPSG:NUMBER, EPSG:NUMBER+NUMBER with heights, WKT, PROJJSON,
    /// or '+proj=...'; or @FILE that has one of these [default: from the file]
    #[arg(long, value_name = "DEF", value_parser = parse_crs)]
    crs: Option<Crs>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    limit: OutputLimit,
    /// Store equal subtrees once; for .autumn files
    #[arg(long)]
    share: bool,
    /// Time of the commit that an .autumn file begins with, in seconds since 1970-01-01 00:00 UTC
    /// [default: none, so that the same input makes the same bytes]
    #[arg(long, value_name = "SECONDS", env = "SOURCE_DATE_EPOCH", allow_negative_numbers = true)]
    time: Option<i64>,
    /// Grid of the cells: xyz is the web map grid, web mercator with the world as the root, so that
    /// tiles are nodes; a tree file names its own grid, so that both can be combined. Rasters are
    /// warped, through a temporary file next to the output
    #[arg(long, value_name = "xyz|TREE")]
    grid: Option<Grid>,
    /// Access to files: that of the [program](Global::access).
    #[arg(skip)]
    pub(super) access: FileAccess,
    /// The options on the command line.
    #[arg(skip)]
    pub(super) given: GivenOptions,
}

impl Common {
    /// Returns the first given option that sharded builds reject.
    pub(super) fn not_of_shards(&self) -> Option<&'static str> {
        let given = [
            ("--share", self.share),
            ("--time", self.given.has("--time")),
            ("--grid", self.grid.is_some()),
            ("--max-bytes", self.limit.is_given()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }
}

/// A grid that is not the input's own.
#[derive(Clone, Debug, PartialEq)]
enum Grid {
    /// The web map grid.
    Xyz,
    /// Another tree's grid.
    Like(PathBuf),
}

impl From<OsString> for Grid {
    fn from(text: OsString) -> Grid {
        if text == "xyz" { Grid::Xyz } else { Grid::Like(text.into()) }
    }
}

const EXAMPLES: &str = "\
Examples:
  spinney build world.tif -o world.goblin
  spinney build landcover.tif -o landcover.goblin --kind categorical --nodata 0
  spinney build scene.tif -o colour.goblin --band 4,3,2
  spinney build N46E007.hgt N46E008.hgt -o alps.goblin --memory 1G
  spinney build @tiles.txt -o country.goblin
  spinney build B02.tif B03.tif B11.tif -o scene.goblin --stack
  spinney build scan.png -o scan.goblin --crs EPSG:3857 --transform 0.5,0,1000,0,-0.5,2000
  spinney build scan.npy -o scan.goblin --nodata -1024 --transform 0.7,0.7,1.25
  spinney build head.nrrd -o head.goblin
  spinney build scan.raw -o scan.goblin --raw-size 512,512,300 --raw-type u16 --big-endian
  spinney build sections/ -o block.goblin --pages z --transform 0.01,0.01,0.05
  spinney build bunny.ply -o bunny.goblin --cells 1024
  spinney build part.stl -o part.goblin --cell 0.1mm --unit mm --edge area
  spinney build part.stl -o exact.goblin --brep
  spinney build bracket.csg -o bracket.goblin --cells 512
  spinney build bracket.csg -o bracket.goblin --brep --deviation 0.01
  spinney build bust.views -o bust.goblin --cells 512
  spinney build sections.csv -o body.goblin --heights z --cells 256
  spinney build city.json -o city.goblin --cell 0.5 --attribute part
  spinney build zones.gpkg -o zones.goblin --cell 10 --value code
  spinney build scan.laz -o scan.goblin --where 'classification=2' --attribute intensity,classification
  spinney build boreholes.csv -o surface.goblin --tin z --cell 10 --breaklines faults.geojson
  spinney build boreholes.csv -o layers.goblin --tin top,coal,base --brep --outline area.geojson
  spinney build landcover.tif -o landcover.autumn --share
  spinney build heights.goblin -o highest.goblin --rule max
  spinney build map.bintree -o map.goblin --kind categorical
  spinney build landcover.tif -o tiles.goblin --grid xyz
  spinney build dem.tif -o dem_tiles.goblin --grid xyz --max-zoom 12 --resampling cubic
  spinney build world.tif -o - | ssh host 'cat > world.goblin'

The output appears under its name only when it is complete; until then, an older file of that name
stays.";

/// Error message for options that models reject.
const NOT_OF_MODELS: &str = "--kind, --rule, --band, --nodata, --transform, --layer, --pages, --raw-size, --stack and --keep-transparent are for pictures and volumes, not for models";

/// Inputs that are open and checked, ready to be built.
enum Import {
    Pictures(Box<spinney::import::raster::RasterImport>),
    /// Rasters on another grid than their own.
    Warped(Box<spinney::import::raster::RasterImport>, TargetGrid, WarpOptions),
    /// Rasters as layers.
    Stack(Box<spinney::import::raster::Stack>),
    Volume(Box<VolumeImport>),
    Solid(Box<SolidImport>),
    Exact(Box<ExactImport>),
    /// A solid of primitives.
    Primitives(PrimitivesImport),
    /// A solid of views, or of outlines.
    Reconstruction(Box<ReconstructionImport>),
    Features(Box<FeatureImport>),
    Surface(Box<SurfaceImport>),
    Points(Box<PointImport>),
    Lines(Box<LineImport>),
    Tree(Box<TreeImport>),
    Bintree(Box<BintreeImport>),
}

/// Returns the grid of a tree with so many axes.
fn grid_of(tree: &Dataset, axes: usize, path: &Path) -> Result<WarpGrid> {
    let name = ["a quadtree", "an octree"];
    if tree.header().form.axes() != axes {
        bail!("--grid: {} is {}, {} is needed", path.display(), name[3 - axes], name[axes - 2]);
    }
    Ok(WarpGrid { frame: tree.metadata().frame.clone(), extent: tree.header().extent })
}

/// Lines about a build, each with its heading.
type Lines = Vec<(&'static str, String)>;

impl Import {
    fn description(&self) -> &[(&'static str, String)] {
        match self {
            Import::Pictures(import) | Import::Warped(import, ..) => import.description(),
            Import::Stack(stack) => stack.description(),
            Import::Volume(import) => import.description(),
            Import::Solid(import) => import.description(),
            Import::Exact(import) => import.description(),
            Import::Primitives(import) => import.description(),
            Import::Reconstruction(import) => import.description(),
            Import::Features(import) => import.description(),
            Import::Surface(import) => import.description(),
            Import::Points(import) => import.description(),
            Import::Lines(import) => import.description(),
            Import::Tree(import) => import.description(),
            Import::Bintree(import) => import.description(),
        }
    }

    /// Returns the command for inspecting the tree.
    fn next(&self) -> &'static str {
        match self {
            Import::Points(_) | Import::Lines(_) => "info",
            _ => "show",
        }
    }

    /// Returns the unit of the build's progress, in the plural.
    fn unit(&self) -> &'static str {
        match self {
            Import::Exact(_) => "faces",
            Import::Points(_) => "points",
            Import::Lines(_) => "pieces of lines",
            Import::Primitives(import) => import.unit(),
            _ => "cells",
        }
    }

    /// Builds the tree. Returns lines about it.
    fn build(self, output: Output, solids: &SolidArgs, progress: &dyn Progress) -> Result<Lines> {
        match self {
            Import::Pictures(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Stack(stack) => {
                raster::write_stack(&stack, output, progress)?;
                Ok(Lines::new())
            }
            Import::Volume(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Warped(import, target, warp) => {
                let made = import.build_warped(&target, &warp, output, progress)?;
                let grid = match target {
                    TargetGrid::WebMercator(_) => {
                        format!("web mercator to zoom {}", made.depth.saturating_sub(8))
                    }
                    TargetGrid::Cells(_) | TargetGrid::Like(_) => "the other tree's".into(),
                };
                Ok(vec![("grid", format!("{grid}, {}", made.resampling))])
            }
            Import::Solid(import) => Ok(solids.lines(&import.build(output, progress)?)),
            Import::Exact(import) => import.build(output, solids.stats, progress),
            Import::Primitives(import) => import.build(output, progress),
            Import::Reconstruction(import) => {
                let cells = import.build(output, progress)?;
                let nothing = "the tree is empty: no cell's centre is inside; choose smaller cells, or look at the input";
                Ok(if cells == 0 { vec![("warning", nothing.into())] } else { Lines::new() })
            }
            Import::Features(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Lines(import) => import.build(output, progress),
            Import::Surface(import) => import.build(output, progress),
            Import::Points(import) => {
                let built = import.build(output, progress)?;
                let text = format!("{}, {} of them where another one is", built.points, built.duplicates);
                Ok(vec![("points", text)])
            }
            Import::Tree(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Bintree(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
        }
    }
}

impl Args {
    /// Opens the inputs, and plans the import.
    fn plan(&self) -> Result<Import> {
        let Args { inputs, output, pictures, common, solids, features, surfaces } = self;
        check_output(inputs.iter().map(PathBuf::as_path), output)?;
        check_tree_name(output)?;
        if features.index == Some(Index::Lines) {
            let import = lines::plan(inputs, (common, pictures, solids, features))?;
            return Ok(Import::Lines(Box::new(import)));
        }
        if surfaces.tin.is_some() {
            let import = surfaces.plan(inputs, (common, pictures, solids, features))?;
            return Ok(Import::Surface(Box::new(import)));
        }
        if let Some(height) = &features.heights {
            let import =
                reconstruction::outlines(inputs, output, height, (common, pictures, solids, features))?;
            return Ok(Import::Reconstruction(Box::new(import)));
        }
        if points::are_points(inputs, features) {
            let import = points::plan(inputs, (common, pictures, solids, features))?;
            return Ok(Import::Points(Box::new(import)));
        }
        if FeatureArgs::are_features(inputs) {
            let import = features.plan(inputs, output, (common, pictures, solids))?;
            return Ok(Import::Features(Box::new(import)));
        }
        let is_other = |input: &Path| Ok(!mesh::is_model(input, &common.access)?);
        let are_exact = solids.brep && !any_file(inputs, &is_other)?;
        if let Some(option) = features.given().filter(|option| !(are_exact && *option == "--where")) {
            bail!(
                "{option} is for features (GeoJSON, FlatGeobuf, GeoPackage, shapefiles, CSV), {} has none",
                inputs[0].display()
            );
        }
        if let Some(bintree) = inputs.iter().find(|input| BintreeImport::is_one(input)) {
            if solids.are_given() {
                bail!("{}: is a tree of cells; the options for solids are for models", bintree.display());
            }
            return Ok(Import::Bintree(Box::new(BintreeImport::plan(inputs, pictures, common)?)));
        }
        if inputs.iter().any(|input| Csg::is_name(input)) {
            let import = PrimitivesImport::plan(inputs, output, (pictures, solids, common))?;
            return Ok(Import::Primitives(import));
        }
        if inputs.iter().any(|input| is_views_name(input)) {
            let import = reconstruction::views(inputs, output, (common, pictures, solids))?;
            return Ok(Import::Reconstruction(Box::new(import)));
        }
        if any_file(inputs, &|input| file_is_tree(input, &common.access))? {
            if solids.are_given() {
                bail!("{}: is a tree of cells; the options for solids are for models", inputs[0].display());
            }
            return Ok(Import::Tree(Box::new(TreeImport::plan(inputs, pictures, common)?)));
        }
        if any_file(inputs, &|input| mesh::is_model(input, &common.access))? {
            if pictures.are_given() {
                bail!("{NOT_OF_MODELS}");
            }
            if common.grid == Some(Grid::Xyz) {
                bail!("--grid xyz is for pictures, not for models");
            }
            if solids.brep {
                return Ok(Import::Exact(Box::new(ExactImport::plan(
                    inputs,
                    solids,
                    features.filter.as_ref(),
                    common,
                )?)));
            }
            // (--cells, --cell and --grid conflict with --brep. clap then does not enforce that
            // these options require --brep.)
            if let Some(option) = solids.of_exact_models() {
                bail!("{option} is for exact models: add --brep, without --cells, --cell and --grid");
            }
            common.given.check("cells of models", &[&solids::OF_CELLS[..], &["--stats"]].concat())?;
            return Ok(Import::Solid(Box::new(solids.plan(inputs, output, common)?)));
        }
        if solids.are_given() {
            let input = inputs[0].display();
            bail!(
                "{input}: is no model; the options for solids are for PLY, OBJ, STL, OFF, CityJSON and CSG files"
            );
        }
        if let Some(input) = pictures.volume_input(inputs)? {
            let import = input.plan(&pictures.volume_options(common)?)?;
            return Ok(Import::Volume(Box::new(import)));
        }
        if let Some(options) = pictures.stack_options(inputs, common)? {
            return Ok(Import::Stack(Box::new(spinney::import::raster::plan_stack(inputs, &options)?)));
        }
        let options = pictures.import_options(common)?;
        let import = || spinney::import::raster::plan(inputs, &options).map(Box::new);
        let target = match &common.grid {
            Some(Grid::Xyz) if common.depth.is_some() => {
                bail!("--depth: with --grid xyz say --max-zoom, the depth less 8")
            }
            Some(Grid::Xyz) => TargetGrid::WebMercator(pictures.max_zoom),
            Some(Grid::Like(_)) if pictures.max_zoom.is_some() => bail!("--max-zoom is for --grid xyz"),
            Some(Grid::Like(path)) => {
                check_output([path.as_path()], output)?;
                TargetGrid::Like(Box::new(grid_of(&open(path, &common.access)?, 2, path)?))
            }
            None => match pictures.of_warping() {
                Some(option) => bail!("{option} is for --grid"),
                None => return Ok(Import::Pictures(import()?)),
            },
        };
        Ok(Import::Warped(import()?, target, pictures.warp_options()))
    }
}

pub(crate) fn run(mut args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    args.inputs = expand_lists(args.inputs)?;
    (args.common.access, args.common.given) = (global.access().clone(), global.given().clone());
    if global.given().has("--time") && TreeFormat::of(&args.output) != TreeFormat::Autumnal {
        bail!("--time: is for .autumn files; {} is none", args.output.display());
    }
    let import = args.plan()?;
    for (heading, text) in import.description() {
        global.report(heading, text);
    }
    // (The size of a directory's contents is unknown: no ratio is reported then.)
    let sizes = args
        .inputs
        .iter()
        .map(|input| std::fs::metadata(input).map_or(Some(0), |file| file.is_file().then_some(file.len())));
    let input = sizes.sum();
    let work = Work::start(global, import.unit())?;
    let output = args.common.limit.create_tree(&args.output, global)?;
    let next = import.next();
    let lines = import.build(output, &args.solids, &work)?;
    work.finish();
    for (heading, text) in lines {
        global.report(heading, text);
    }
    report_built(global, &args.output, start, input);
    if args.output != Path::new("-") {
        global.report("next", format_args!("spinney {next} {}", args.output.display()));
    }
    Ok(())
}
