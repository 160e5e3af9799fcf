//! `spinney transform`: a region of a tree, moved, scaled or rotated.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use spinney::brep::TransformOptions;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::points::{PointRaster, rasterize_points};
use spinney::{FileView, Resampling, ViewStep, WarpOptions};

use super::args::{Memory, OutputLimit, Packing, UNITS, check_output, parse_step};
use super::report::{Work, report_output};
use super::{Global, exact, features, points};

/// Make a tree of a region of another, moved, scaled, mirrored or rotated, or of calculations with
/// other trees.
///
/// Operations are applied in the given order; a chain of any length looks up each cell once, in the
/// file on disk, and memory does not grow with the raster (the system loads and evicts pages of the
/// mapped file). Subtrees that the result has unchanged are copied. Without operations the result
/// is a condensed copy.
///
/// New cells that do not coincide with old ones get their value by the file's rule: the mean, or
/// the class with the largest area, of the cells they cover; if axes are not mapped to axes, the
/// value at their centre.
///
/// Exact models are moved in the world: integer translations on the grid, quarter turns, mirrors,
/// exchanged axes and one factor for all axes exactly, others with their vertices moved to the
/// nearest points of a grid.
///
/// Feature files are reprojected, with their attributes, heights and ids.
///
/// The raster keeps its world coordinates, however its cells are arranged; with --move it moves
/// with its cells.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    chain: ChainArgs,
    /// File to write, of features in the format of its name; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    /// Width of the grid units of a new grid for exact models, to which all vertices are moved
    /// [default: the model's grid, with as little rounding as possible]
    #[arg(long, value_name = "WIDTH")]
    snap: Option<f64>,
    /// Unit of the model's coordinates, of exact models [default: the file's]
    #[arg(long, value_parser = UNITS)]
    unit: Option<String>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    limit: OutputLimit,
}

/// A file, and the operations on it.
#[derive(clap::Args)]
pub(crate) struct ChainArgs {
    /// Tree file, exact model, or feature file
    file: PathBuf,
    /// Operations, in order; see the list in `spinney transform --help`
    #[arg(value_name = "STEP", value_parser = parse_any_step, allow_hyphen_values = false)]
    steps: Vec<AnyStep>,
    /// Resampling of cells that do not coincide with old ones: nearest, or for like=, warp= and
    /// grid= bilinear, cubic, area or majority, too [default: the file's rule; with warp=, grid=
    /// and, from another coordinate system, like= nearest for classes, bilinear for continuous
    /// values, and majority or area where new cells are more than 1.5 times as large]
    #[arg(long, value_name = "WAY")]
    resampling: Option<Resampling>,
    /// Treat datums whose shift to WGS 84 is unknown or needs a grid as WGS 84
    #[arg(long)]
    allow_ballpark: bool,
    /// Move the raster in the world as its cells are moved
    #[arg(long = "move")]
    moves: bool,
}

impl ChainArgs {
    /// Returns the operations on trees of cells, and the rasterizations of trees of points.
    fn steps(&self) -> (Vec<ViewStep>, Vec<&PointRaster>) {
        let (mut cells, mut rasters) = (Vec::new(), Vec::new());
        for step in &self.steps {
            match step {
                AnyStep::Cells(step) => cells.push(step.clone()),
                AnyStep::Points(raster) => rasters.push(raster),
            }
        }
        (cells, rasters)
    }

    /// Returns the view of a tree of cells.
    pub(crate) fn chain(&self, global: &Global) -> Result<FileView> {
        let (steps, rasters) = self.steps();
        if !rasters.is_empty() {
            bail!("{}: is no tree of points, which raster= is for", self.file.display());
        }
        let mut warp = WarpOptions::default();
        (warp.resampling, warp.allow_ballpark) = (self.resampling, self.allow_ballpark);
        Ok(FileView {
            steps,
            moves: self.moves,
            warp,
            access: global.access().clone(),
            ..FileView::of(&self.file)
        })
    }
}

/// An operation on trees of cells and exact models, or a rasterization of a tree of points.
#[derive(Clone, Debug)]
enum AnyStep {
    Cells(ViewStep),
    Points(PointRaster),
}

fn parse_any_step(text: &str) -> Result<AnyStep, String> {
    match text.strip_prefix("raster=") {
        Some(raster) => {
            raster.parse().map(AnyStep::Points).map_err(|error: spinney::Error| error.to_string())
        }
        None => parse_step(text).map(AnyStep::Cells),
    }
}

const EXAMPLES: &str = "\
Steps:
  window=COL,ROW,W,H       a box of cells, aligned or not; what sticks out is VOID
  window=X,Y,Z,W,H,D       the same of octrees
  window=W,S,E,N,in=world  the cells in a box of the world; in=lonlat: of longitudes and latitudes
  crop                     the smallest box around all data
  opaque                   VOID for transparent pixels, those of opacity 0
  void=N                   VOID for cells that have this number, in all channels
  translate=DX,DY[,DZ]     by cells or parts of cells; room is made on the far sides
  scale=F  scale=FX,FY     so many times as many cells along each axis
  rotate=DEG[@COL,ROW]     turns about a centre (the middle); clockwise, since rows go down
  rotate=DEG,AXIS[@X,Y,Z]  octrees: AXIS is x, y, z or a direction such as 1,1,0
  mirror=x  transpose      along an axis; columns for rows
  axes=+y,-x,+z            where x, y and z of the result come from: all 48 symmetries
  affine=a,b,c,d,e,f       col' = a col + b row + c, row' = d col + e row + f; or 12 numbers
  depth=N                  coarser or finer cells, so that the tree has N levels
  tree-depth=N             a deeper root over the same cells, so that the tree has N levels
  subtree=/031             a node becomes the root
  embed=/2                 the root becomes a node of a larger tree
  crs=DEF                  says in which coordinate system the cells lie: EPSG:NUMBER, WKT, PROJJSON, '+proj=...' or @FILE
  like=OTHER.goblin[,extent=PART]
                           onto the cells of another tree (a), where it lies in the world, also in another coordinate system;
                           PART is a, b (this tree's extent), union or intersection [default: a, or b where data lie beyond a]
  warp=DEF[,cell=W][,resampling=WAY]
                           to another coordinate system, onto square cells of width W where data land, as far as
                           they lie in its area of use [default: cells as large as the tree's, in its middle]
  grid=xyz[,ZOOM]          onto the cells of web maps, in web mercator with the world as the root
  calc=EXPR[,a=FILE ...][,type=T]
                           one channel, f32 or of type T, of what is calculated with the channels, b1, b2, ... or by
                           their names, and of files brought to the same cells: scale and offset are applied, + - * / < <= > >= == != and or not,
                           where(condition, then, else), abs, sqrt, and of any count min, max, mean, median, count
  reduce=WAY[,a=FILE ...][,type=T]
                           the median, mean, min, max or count of all channels, and those of files
  components=4|8           numbers the components of cells of equal value (of occupancy: of cells at least half full) from 1 on, by
                           their first cells in FD order; cells hang together with 4 or 8 neighbours, of octrees 6 or 26
  sieve=CELLS[,connect=8]  gives components of fewer cells to their largest neighbours, the smallest first; those in VOID stay
  sieve=AREAm2             the same with square metres, where the coordinate system tells them
                           (components= and sieve= go through all cells first, and are not for --view)
Steps of exact models, in coordinates of the world, about its origin:
  translate=DX,DY,DZ  scale=F  scale=FX,FY,FZ  mirror=x  transpose  axes=+y,-x,+z  affine=12 numbers  crs=DEF
  rotate=DEG,AXIS[@X,Y,Z]  counterclockwise seen from the axis' end, also about another point
Of files of features (GeoJSON, GeoPackage, FlatGeobuf, shapefile, CSV), which are written as any of these, .svg, .obj or .ply, by the output's name:
  warp=DEF                 every vertex to another coordinate system, one by one: edges are straight between them
  crs=DEF                  says in which coordinate system they are, whatever the file says
Of trees of points:
  raster=RULE,cell=W[,attribute=NAME]
                           a quadtree of cells of width W: the min, max or mean of the points' z (or an attribute), or their count

Examples:
  spinney transform world.goblin window=20000,5000,4096,4096 -o part.goblin
  spinney transform world.goblin window=5,44,17,48,in=world scale=0.5 -o alps.goblin
  spinney transform scan.goblin rotate=-1.3 crop -o straight.goblin
  spinney transform map.goblin rotate=90 mirror=x -o turned.goblin
  spinney transform bunny.goblin rotate=30,1,1,0 scale=2 -o large.goblin
  spinney transform relief.goblin depth=10 -o coarse.goblin
  spinney transform site.goblin crs=@site.wkt -o placed.goblin
  spinney transform old.goblin like=new.goblin -o old_on_new.goblin
  spinney transform relief.goblin grid=xyz,7 --resampling cubic -o relief_xyz.goblin
  spinney transform utm.goblin warp=EPSG:3035,cell=30 -o europe.goblin
  spinney transform scene.goblin 'calc=(b4-b3)/(b4+b3)' -o ndvi.goblin
  spinney transform B04.goblin 'calc=(nir-b1)/(nir+b1),nir=B08.goblin' -o ndvi.goblin
  spinney transform may.goblin reduce=median,june=june.goblin,july=july.goblin -o summer.goblin
  spinney transform landcover.goblin components=4 -o labels.goblin
  spinney transform landcover.goblin sieve=100 -o clean.goblin
  spinney transform part.goblin rotate=90,x translate=0,0,12.5 -o placed.goblin
  spinney transform inches.goblin scale=25.4 --unit mm -o part.goblin
  spinney transform parcels.gpkg warp=EPSG:25832 -o parcels_25832.gpkg
  spinney transform scan.goblin raster=max,cell=0.5 -o surface.goblin";

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Args { chain, output: path, snap, unit, memory, packing, limit } = args;
    let file = &chain.file;
    let (steps, rasters) = chain.steps();
    check_output([&**file].into_iter().chain(steps.iter().flat_map(ViewStep::files)), &path)?;
    if is_feature_file(file) {
        ensure!(
            rasters.is_empty(),
            "{}: is a file of features, which raster= means nothing for",
            file.display()
        );
        let features = features::Reprojection { file, steps: &steps, allow_ballpark: chain.allow_ballpark };
        return features.write(&path, memory.bytes, &limit, global);
    }
    if let Some(tree) = points::open(file, global)? {
        let [raster] = &rasters[..] else {
            bail!(
                "{}: is a tree of points, of which one step makes cells: raster=mean,cell=1",
                file.display()
            );
        };
        ensure!(
            steps.is_empty(),
            "{}: is a tree of points, for which steps of cells mean nothing",
            file.display()
        );
        global.check_options(file, points::KIND, &["--codec", "--max-error"])?;
        let work = Work::start(global, "cells")?;
        let memory = (memory.bytes, packing.choice());
        let [columns, rows] =
            rasterize_points(&tree, raster, memory, limit.create_tree(&path, global)?, &work)?;
        work.finish();
        global.report("size", format_args!("{columns} x {rows} cells"));
        report_output(global, &path, start);
        return Ok(());
    }
    let cells = chain.chain(global)?;
    if let Some(model) = exact::open(file, global)? {
        global.check_options(file, exact::KIND, &["--codec", "--snap", "--unit"])?;
        let mut options = TransformOptions::new(memory.bytes);
        (options.snap, options.unit, options.codec) = (snap, unit, packing.of_model(file)?);
        let moving = exact::Moving { model: &model, steps: &steps, options };
        return exact::transform(moving, &path, &limit, global);
    }
    let given = [("--snap", snap.is_some()), ("--unit", unit.is_some())];
    if let Some((name, _)) = given.iter().find(|(_, is_given)| *is_given) {
        bail!("{}: is no exact model, which {name} is for", file.display());
    }
    let how = packing.with(memory);
    let report_size = |[width, height, depth]: [u64; 3], levels: u8| {
        let more = if depth > 1 { format!(" x {depth}") } else { String::new() };
        global.report("size", format_args!("{width} x {height}{more} cells, depth {levels}"));
    };
    // (A grid of another coordinate system may have many more cells. Users learn this before they
    // wait.)
    let is_warped = steps.iter().any(|step| matches!(step, ViewStep::Warp(_)));
    if is_warped {
        let view = cells.open()?;
        report_size(view.extent(), view.depth());
    }
    let work = Work::start(global, "cells")?;
    let outcome = spinney::transform(&cells, limit.create_tree(&path, global)?, how, &work)?;
    work.finish();
    if !is_warped {
        report_size(outcome.extent, outcome.depth);
    }
    global.report("cells", format_args!("{} before, {} after", outcome.before[0], outcome.after));
    if let Some(expected) = outcome.expected.filter(|expected| *expected > 0.0) {
        let error = 100.0 * (outcome.after as f64 / expected - 1.0);
        global.report("area error", format_args!("{error:+.4} %"));
    }
    report_output(global, &path, start);
    Ok(())
}
