//! `spinney build`: trees of rasters, volumes, solids and features.

mod body_values;
mod csg;
mod exact;
mod expression;
mod features;
mod half_spaces;
mod lines;
pub(super) mod points;
mod rasters;
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
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::mesh;
use spinney::raw::import::raster::{self, TargetGrid};
use spinney::raw::io::{any_file, url_of};
use spinney::{Dataset, FileAccess, Progress};

use spinney::points::PointImport;
use spinney::raw::ops::WarpGrid;
use spinney::raw::points::is_las_file;
use spinney::raw::reconstruction::{ReconstructionImport, is_views_name};
use spinney::raw::store::{TreeFormat, check_tree_name, file_is_tree};
use spinney::{Crs, Output, WarpOptions};

use self::body_values::{BodyArgs, BodyValueImport};
use self::csg::PrimitivesImport;
use self::exact::ExactImport;
use self::expression::ExpressionImport;
use self::features::{FeatureArgs, Index};
use self::half_spaces::HalfSpaceImport;
pub(super) use self::rasters::{Pages, RasterArgs};
pub(super) use self::solids::SolidArgs;
use self::surfaces::{SurfaceArgs, SurfaceImport};
use self::tree::TreeImport;
pub(super) use self::tree::spec as tree_spec;
use super::args::{GivenOptions, Memory, OutputLimit, Packing, check_output, expand_lists, parse_crs};
use super::lines::LineImport;
use super::report::{Work, report_built};
use super::{Global, open};

/// Build a tree of rasters, volumes, solids, features, points or lines
///
/// Writes one file with all levels of detail: .goblin is compact and read-only, .autumn can be
/// edited. The content of the input selects its kind. Metadata is kept unless options override it.
/// Data that exceeds --memory goes to a temporary file next to the output, which appears only when
/// complete.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Files or URLs; @FILE reads paths from a file, one a line
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// File to write; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    rasters: RasterArgs,
    #[command(flatten)]
    solids: SolidArgs,
    #[command(flatten)]
    features: FeatureArgs,
    #[command(flatten)]
    surfaces: SurfaceArgs,
    #[command(flatten)]
    bodies: BodyArgs,
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
    /// Time of the commit that an .autumn file begins with: in seconds since 1970-01-01 00:00 UTC
    /// [default: none, so that equal inputs make equal bytes]
    #[arg(long, value_name = "SECONDS", env = "SOURCE_DATE_EPOCH", allow_negative_numbers = true)]
    time: Option<i64>,
    /// Grid of the cells: xyz (web mercator with the world as the root, so that tiles are nodes),
    /// or that of a tree file. Rasters are warped through a temporary file next to the output
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
  spinney build landcover.tif -o landcover.autumn --kind categorical --nodata 0
  spinney build bunny.ply -o bunny.goblin --cells 1024
  spinney build part.stl -o exact.goblin --brep
  spinney build zones.gpkg -o zones.goblin --cell 10 --value code
  spinney build world.tif -o - | ssh host 'cat > world.goblin'";

/// Inputs that are open and checked, ready to be built.
enum Import {
    Rasters(Box<spinney::import::raster::RasterImport>),
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
    BodyValues(Box<BodyValueImport>),
    Points(Box<PointImport>),
    Lines(Box<LineImport>),
    Tree(Box<TreeImport>),
    Expression(Box<ExpressionImport>),
    /// A solid of half-spaces: a BSP tree, or an octree with planes in its leaves.
    HalfSpaces(Box<HalfSpaceImport>),
}

/// Fails if inputs are of different kinds, of which no tree can be built. Files are read only if
/// their names have different extensions.
pub(super) fn check_kinds(inputs: &[PathBuf], access: &FileAccess) -> Result<()> {
    let [first, others @ ..] = inputs else { return Ok(()) };
    let is_like = |other: &PathBuf| match (first.extension(), other.extension()) {
        (Some(first), Some(other)) => first.eq_ignore_ascii_case(other),
        (first, other) => first == other,
    };
    // (Files that are missing get their own error.)
    let is_missing = |input: &PathBuf| url_of(input).is_none() && !input.exists();
    if others.iter().all(is_like) || inputs.iter().any(is_missing) {
        return Ok(());
    }
    let kind = input_kind(first, access)?;
    for other in others.iter().filter(|other| !is_like(other)) {
        let found = input_kind(other, access)?;
        if found != kind {
            bail!(
                "{}: is {found}, but {} is {kind}; build one tree for each",
                other.display(),
                first.display()
            );
        }
    }
    Ok(())
}

/// Returns the kind of an input, with its article.
fn input_kind(input: &Path, access: &FileAccess) -> Result<&'static str> {
    let by_name = [
        ("a point cloud", is_las_file(input)),
        ("a feature file", is_feature_file(input)),
        ("a solid of half-spaces", HalfSpaceImport::is_one(input)),
        ("a DF-expression", ExpressionImport::is_one(input)),
        ("a solid of primitives (CSG)", Csg::is_name(input)),
        ("a solid of views", is_views_name(input)),
    ];
    if let Some((kind, _)) = by_name.into_iter().find(|(_, is_one)| *is_one) {
        return Ok(kind);
    }
    Ok(if file_is_tree(input, access)? {
        "a tree of cells"
    } else if mesh::is_model(input, access)? {
        "a model of a solid"
    } else {
        "a raster or volume"
    })
}

/// Returns the grid of a tree with so many axes.
fn grid_of(tree: &Dataset, axes: usize, path: &Path) -> Result<WarpGrid> {
    let name = ["a quadtree", "an octree"];
    if tree.header().form.axes() != axes {
        bail!("--grid: {} is {}, expected {}", path.display(), name[3 - axes], name[axes - 2]);
    }
    Ok(WarpGrid { frame: tree.metadata().frame.clone(), extent: tree.header().extent })
}

/// Lines about a build, each with its heading.
type Lines = Vec<(&'static str, String)>;

impl Import {
    fn description(&self) -> &[(&'static str, String)] {
        match self {
            Import::Rasters(import) | Import::Warped(import, ..) => import.description(),
            Import::Stack(stack) => stack.description(),
            Import::Volume(import) => import.description(),
            Import::Solid(import) => import.description(),
            Import::Exact(import) => import.description(),
            Import::Primitives(import) => import.description(),
            Import::Reconstruction(import) => import.description(),
            Import::Features(import) => import.description(),
            Import::Surface(import) => import.description(),
            Import::BodyValues(import) => import.description(),
            Import::Points(import) => import.description(),
            Import::Lines(import) => import.description(),
            Import::Tree(import) => import.description(),
            Import::Expression(import) => import.description(),
            Import::HalfSpaces(import) => import.description(),
        }
    }

    /// Whether the output is a tree file, not a mesh.
    fn is_tree(&self) -> bool {
        !matches!(self, Import::Surface(import) if import.is_mesh())
    }

    /// Returns the command for inspecting the tree.
    fn next(&self) -> &'static str {
        match self {
            // (`show` needs one layer.)
            Import::Points(_) | Import::Lines(_) | Import::Stack(_) => "info",
            _ => "show",
        }
    }

    /// Returns the unit of the build's progress, in the plural.
    fn unit(&self) -> &'static str {
        match self {
            Import::Exact(_) => "faces",
            Import::Points(_) => "points",
            Import::Lines(_) => "segments",
            Import::Primitives(import) => import.unit(),
            _ => "cells",
        }
    }

    /// Builds the tree. Returns lines about it.
    fn build(self, output: Output, solids: &SolidArgs, progress: &dyn Progress) -> Result<Lines> {
        match self {
            Import::Rasters(import) => {
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
                let nothing =
                    "the tree is empty: no cell's centre is inside; choose smaller cells, or check the input";
                Ok(if cells == 0 { vec![("warning", nothing.into())] } else { Lines::new() })
            }
            Import::Features(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Lines(import) => import.build(output, progress),
            Import::Surface(import) => import.build(output, progress),
            Import::BodyValues(import) => import.build(output, progress),
            Import::Points(import) => {
                let built = import.build(output, progress)?;
                let text = format!("{}, {} of them duplicates", built.points, built.duplicates);
                let nothing = "the tree is empty: no point satisfies the conditions";
                let warning = (built.points == 0).then(|| ("warning", nothing.into()));
                Ok([("points", text)].into_iter().chain(warning).collect())
            }
            Import::Tree(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::Expression(import) => {
                import.build(output, progress)?;
                Ok(Lines::new())
            }
            Import::HalfSpaces(import) => import.build(output, progress),
        }
    }
}

impl Args {
    /// Opens the inputs, and plans the import.
    fn plan(&self) -> Result<Import> {
        let Args { inputs, output, rasters, common, solids, features, surfaces, bodies } = self;
        check_output(inputs.iter().map(PathBuf::as_path), output)?;
        if surfaces.tin.is_none() || SurfaceArgs::mesh_format(output).is_none() {
            check_tree_name(output)?;
        }
        if features.index == Some(Index::Lines) {
            let import = lines::plan(inputs, (common, rasters, solids, features), output)?;
            return Ok(Import::Lines(Box::new(import)));
        }
        if surfaces.tin.is_some() {
            let import = surfaces.plan(inputs, output, (common, rasters, solids, features))?;
            return Ok(Import::Surface(Box::new(import)));
        }
        if let Some(body) = &bodies.body {
            let import = bodies.plan(body, inputs, output, (common, rasters, solids, features))?;
            return Ok(Import::BodyValues(Box::new(import)));
        }
        if let Some(height) = &features.heights {
            let import =
                reconstruction::outlines(inputs, output, height, (common, rasters, solids, features))?;
            return Ok(Import::Reconstruction(Box::new(import)));
        }
        if features.index.is_none() {
            check_kinds(inputs, &common.access)?;
        }
        if points::are_points(inputs, features) {
            let import = points::plan(inputs, (common, rasters, solids, features))?;
            return Ok(Import::Points(Box::new(import)));
        }
        if FeatureArgs::are_features(inputs) {
            let import = features.plan(inputs, output, (common, rasters, solids))?;
            return Ok(Import::Features(Box::new(import)));
        }
        let is_other = |input: &Path| Ok(!mesh::is_model(input, &common.access)?);
        let are_exact = solids.brep && !any_file(inputs, &is_other)?;
        if let Some(option) = features.given().filter(|option| !(are_exact && *option == "--where")) {
            bail!(
                "{option}: works only with features (GeoJSON, FlatGeobuf, GeoPackage, shapefile, CSV), {} has none",
                inputs[0].display()
            );
        }
        if inputs.iter().any(|input| HalfSpaceImport::is_one(input)) {
            let import = HalfSpaceImport::plan(inputs, (rasters, solids, common))?;
            return Ok(Import::HalfSpaces(Box::new(import)));
        }
        if let Some(expression) = inputs.iter().find(|input| ExpressionImport::is_one(input)) {
            solids.refuse(expression)?;
            return Ok(Import::Expression(Box::new(ExpressionImport::plan(inputs, rasters, common)?)));
        }
        if inputs.iter().any(|input| Csg::is_name(input)) {
            let import = PrimitivesImport::plan(inputs, output, (rasters, solids, common))?;
            return Ok(Import::Primitives(import));
        }
        if inputs.iter().any(|input| is_views_name(input)) {
            let import = reconstruction::views(inputs, output, (common, rasters, solids))?;
            return Ok(Import::Reconstruction(Box::new(import)));
        }
        if any_file(inputs, &|input| file_is_tree(input, &common.access))? {
            solids.refuse(&inputs[0])?;
            return Ok(Import::Tree(Box::new(TreeImport::plan(inputs, rasters, common)?)));
        }
        if any_file(inputs, &|input| mesh::is_model(input, &common.access))? {
            rasters.refuse(&inputs[0])?;
            if common.grid == Some(Grid::Xyz) {
                bail!("--grid xyz: works only with rasters, not with models");
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
                bail!("{option}: works only with --brep, without --cells, --cell and --grid");
            }
            common.given.check("cells of models", &[&solids::OF_CELLS[..], &["--stats"]].concat())?;
            return Ok(Import::Solid(Box::new(solids.plan(inputs, output, common)?)));
        }
        solids.refuse(&inputs[0])?;
        if let Some(input) = rasters.volume_input(inputs)? {
            let import = input.plan(&rasters.volume_options(common)?)?;
            return Ok(Import::Volume(Box::new(import)));
        }
        if let Some(options) = rasters.stack_options(inputs, common)? {
            return Ok(Import::Stack(Box::new(spinney::import::raster::plan_stack(inputs, &options)?)));
        }
        let options = rasters.import_options(common)?;
        let import = || spinney::import::raster::plan(inputs, &options).map(Box::new);
        let target = match &common.grid {
            Some(Grid::Xyz) if common.depth.is_some() => {
                bail!("--depth: has no effect with --grid xyz; use --max-zoom, the depth minus 8")
            }
            Some(Grid::Xyz) => TargetGrid::WebMercator(rasters.max_zoom),
            Some(Grid::Like(_)) if rasters.max_zoom.is_some() => {
                bail!("--max-zoom: works only with --grid xyz")
            }
            Some(Grid::Like(path)) => {
                check_output([path.as_path()], output)?;
                TargetGrid::Like(Box::new(grid_of(&open(path, &common.access)?, 2, path)?))
            }
            None => match rasters.of_warping() {
                Some(option) => bail!("{option}: works only with --grid"),
                None => return Ok(Import::Rasters(import()?)),
            },
        };
        Ok(Import::Warped(import()?, target, rasters.warp_options()))
    }
}

pub(crate) fn run(mut args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    args.inputs = expand_lists(args.inputs)?;
    (args.common.access, args.common.given) = (global.access().clone(), global.given().clone());
    if global.given().has("--time") && TreeFormat::of(&args.output) != TreeFormat::Autumnal {
        bail!("--time: works only with .autumn files, not with {}", args.output.display());
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
    let (limit, is_tree, next) = (&args.common.limit, import.is_tree(), import.next());
    let output = match is_tree {
        true => limit.create_tree(&args.output, global)?,
        false => limit.create(&args.output, global)?,
    };
    let lines = import.build(output, &args.solids, &work)?;
    work.finish();
    for (heading, text) in lines {
        global.report(heading, text);
    }
    report_built(global, &args.output, start, input);
    if is_tree && args.output != Path::new("-") {
        global.report("next", format_args!("spinney {next} {}", args.output.display()));
    }
    Ok(())
}
