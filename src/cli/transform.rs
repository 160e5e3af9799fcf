//! `spinney transform`: a region of a tree, moved, scaled or rotated.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use spinney::brep::TransformOptions;
use spinney::raw::brep::euler::LocalChange;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::points::{PointRaster, rasterize_points};
use spinney::{FileView, Resampling, ViewOperation, WarpOptions};

use super::args::{Memory, OutputLimit, Packing, UNITS, check_output, parse_step};
use super::report::{Work, report_output};
use super::{Global, exact, features, points};

/// Transform a tree: crop, scale, rotate, reproject or calculate
///
/// Operations are applied in the given order. A chain of any length looks up each cell once, in the
/// file on disk, and memory does not grow with the raster. Unchanged subtrees are copied. Without
/// operations, the result is a condensed copy.
///
/// New cells that do not coincide with old ones get their value by the file's rule: the mean, or
/// the class with the largest area, of the cells that they cover; if axes are not mapped to axes,
/// the value at their centre. Solids (rule occupancy) keep their volume: cells get the share that
/// is inside, also if turned, and all outside is empty. The raster keeps its world coordinates,
/// however its cells are arranged; with --move it moves with its cells.
///
/// Exact models are moved in the world: exactly by integer translations on the grid, quarter turns,
/// mirrors, exchanged axes and one factor for all axes; otherwise, vertices are moved to the
/// nearest points of a grid.
///
/// Feature files are reprojected, with their attributes, heights and ids.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    chain: ChainArgs,
    /// File to write; for features, its name determines the format; - is standard output
    #[arg(short, long, value_name = "OUT.goblin")]
    output: PathBuf,
    /// Width of the grid units of the result, for exact models: all vertices are moved to a new
    /// grid [default: the model's grid, with as little rounding as possible]
    #[arg(long, value_name = "WIDTH")]
    snap: Option<f64>,
    /// Unit of the model's coordinates [default: the file's]; those of octrees of cells are
    /// converted to it
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
    /// Operations, in order; `spinney help transform` lists them
    #[arg(value_name = "OPERATION", value_parser = parse_any_step, allow_hyphen_values = false)]
    steps: Vec<AnyOperation>,
    /// Resampling of cells that do not coincide with old ones: nearest, and for like=, warp= and
    /// grid= also bilinear, cubic, area or majority [default: the file's rule; for warp=, grid=,
    /// and like= from another coordinate system nearest for classes, bilinear for continuous
    /// values, and majority or area where new cells are more than 1.5 times as large]
    #[arg(long, value_name = "WAY")]
    resampling: Option<Resampling>,
    /// Treat datums as WGS 84 if their shift is unknown or needs a grid
    #[arg(long)]
    allow_ballpark: bool,
    /// Move the raster in the world as its cells are moved
    #[arg(long = "move")]
    moves: bool,
}

impl ChainArgs {
    /// Returns the operations on trees of cells, and the rasterizations of trees of points.
    fn steps(&self) -> (Vec<ViewOperation>, Vec<&PointRaster>) {
        let (mut cells, mut rasters) = (Vec::new(), Vec::new());
        for step in &self.steps {
            match step {
                AnyOperation::Cells(step) => cells.push(step.clone()),
                AnyOperation::Points(raster) => rasters.push(raster),
                AnyOperation::Levels | AnyOperation::Local(_) => {}
            }
        }
        (cells, rasters)
    }

    /// Returns whether levels of detail are added, which must be the last operation.
    fn has_levels(&self) -> Result<bool> {
        let is_levels = |step: &AnyOperation| matches!(step, AnyOperation::Levels);
        match self.steps.iter().position(is_levels) {
            Some(at) if at + 1 < self.steps.len() => {
                bail!("levels: is followed by another operation, expected it to be the last one")
            }
            at => Ok(at.is_some()),
        }
    }

    /// Returns the local operators on an exact model, which must be the only operations.
    fn local_changes(&self) -> Result<Vec<LocalChange>> {
        let local = self.steps.iter().filter_map(|step| match step {
            AnyOperation::Local(change) => Some(*change),
            _ => None,
        });
        let local: Vec<LocalChange> = local.collect();
        match local.first() {
            Some(first) if local.len() < self.steps.len() => {
                bail!(
                    "{first}: got other operations too, expected local ones only; apply the others to the result"
                )
            }
            _ => Ok(local),
        }
    }

    /// Fails if levels of detail or local operators are requested of a file that is not an exact
    /// model.
    fn check_not_exact(&self) -> Result<()> {
        if let Some(change) = self.local_changes()?.first() {
            bail!("{}: is not an exact model, which {change} needs", self.file.display());
        }
        if self.has_levels()? {
            bail!("{}: is not an exact model, which levels needs", self.file.display());
        }
        Ok(())
    }

    /// Returns the view of a tree of cells.
    pub(crate) fn chain(&self, global: &Global) -> Result<FileView> {
        let (steps, rasters) = self.steps();
        if !rasters.is_empty() {
            bail!("{}: is not a tree of points, which raster= needs", self.file.display());
        }
        self.check_not_exact()?;
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

/// An operation on trees of cells and exact models, or one of these only, or a rasterization of a
/// tree of points.
#[derive(Clone, Debug)]
enum AnyOperation {
    Cells(ViewOperation),
    Points(PointRaster),
    /// Levels of detail of an exact model.
    Levels,
    /// A local change of an exact model.
    Local(LocalChange),
}

fn parse_any_step(text: &str) -> Result<AnyOperation, String> {
    if text == "levels" {
        return Ok(AnyOperation::Levels);
    }
    if LocalChange::is_named(text) {
        return text.parse().map(AnyOperation::Local).map_err(|error: spinney::Error| error.to_string());
    }
    match text.strip_prefix("raster=") {
        Some(raster) => {
            raster.parse().map(AnyOperation::Points).map_err(|error: spinney::Error| error.to_string())
        }
        None => parse_step(text).map(AnyOperation::Cells),
    }
}

const EXAMPLES: &str = "\
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
  spinney transform cells_in_mm.goblin --unit m -o cells_in_m.goblin
  spinney transform part.goblin move-face=5,5,10,0,0,2 -o taller.goblin
  spinney transform statue.goblin levels -o statue_levels.goblin
  spinney transform parcels.gpkg warp=EPSG:25832 -o parcels_25832.gpkg
  spinney transform scan.goblin raster=max,cell=0.5 -o surface.goblin

Operations on trees of cells:
  window=COL,ROW,W,H        crop to a box of cells; cells outside of the tree are VOID
  window=X,Y,Z,W,H,D        crop an octree
  window=W,S,E,N,in=world   crop to a box in world coordinates; in=lonlat: in degrees
  crop                      crop to the bounding box of all data
  opaque                    make pixels of opacity 0 VOID
  void=N                    make cells VOID that have this number in all channels
  translate=DX,DY[,DZ]      shift by cells or fractions of cells; the extent grows
  scale=F  scale=FX,FY      change the number of cells along each axis by a factor
  rotate=DEG[@COL,ROW]      rotate clockwise (rows go down) about a centre [default: the middle]
  rotate=DEG,AXIS[@X,Y,Z]   rotate an octree; AXIS is x, y, z or a direction such as 1,1,0
  mirror=x                  reverse an axis
  transpose                 exchange columns and rows
  axes=+y,-x,+z             permute and reverse axes: sources of x, y and z of the result
  affine=a,b,c,d,e,f        map cells: col' = a col + b row + c, row' = d col + e row + f
  affine=12 numbers         map cells of an octree by a 3 x 4 matrix, row by row
  depth=N                   make cells coarser or finer, so that the tree has N levels
  tree-depth=N              put a deeper root over the same cells, so that the tree has N levels
  subtree=/031              make a node the root
  embed=/2                  make the root a node of a larger tree
  crs=DEF                   set the coordinate system of the cells, without moving them
  like=TREE[,extent=E]      resample to another tree's cells, also across coordinate systems
  warp=DEF[,...]            reproject to another coordinate system
  grid=xyz[,ZOOM]           reproject to the web map grid: web mercator, the world is the root
  calc=EXPR[,...]           calculate one channel from channels, also of other files
  reduce=WAY[,...]          median, mean, min, max or count of channels, also of other files
  components=4|8            number the connected components of equal value (octrees: 6|26)
  sieve=CELLS[,connect=8]   merge components of fewer cells into their largest neighbours
  sieve=AREAm2              the same by square metres, if the coordinate system has them

Operations on exact models, in world coordinates, about the origin:
  translate=DX,DY,DZ        shift
  scale=F  scale=FX,FY,FZ   scale
  rotate=DEG,AXIS[@X,Y,Z]   rotate counterclockwise, seen from the axis' end; also about a point
  mirror=x                  reverse an axis
  transpose                 exchange x and y
  axes=+y,-x,+z             permute and reverse axes
  affine=12 numbers         map coordinates by a 3 x 4 matrix, row by row
  crs=DEF                   set the coordinate system
  levels                    add levels of detail: coarser surfaces with bounds of their error
  move-vertex=X,Y,Z,DX,DY,DZ
                            move the vertex at X,Y,Z; its faces must stay planar
  move-edge=, move-face=    the same for the vertices of the edge or the face through X,Y,Z
  chamfer=X,Y,Z,DX,DY,DZ    cut the edge through X,Y,Z off, by the plane at the end of the vector
                            from the edge, which the vector is perpendicular to

Operations on feature files (GeoJSON, GeoPackage, FlatGeobuf, shapefile, CSV):
  warp=DEF                  reproject each vertex; edges are straight between vertices
  crs=DEF                   set the coordinate system, whatever the file says

Operations on trees of points:
  raster=RULE,cell=W[,...]  write a quadtree of cells of width W: min, max, mean or count

DEF is EPSG:NUMBER, WKT, PROJJSON, '+proj=...' or @FILE.

like=TREE[,extent=E]: the extent is a (the other tree's), b (this tree's), union or intersection
[default: a, or b where data extend beyond a].

warp=DEF[,cell=W][,resampling=WAY]: cells are squares of width W [default: as large as the tree's
cells in its middle], over all data in the area of use of DEF.

calc=EXPR[,a=FILE ...][,type=T]: EXPR has the channels b1, b2, ... or their names, and files by the
names given to them, which are resampled to the same cells; scale and offset are applied. Operators
are + - * / < <= > >= == != and or not; functions are where(condition, then, else), abs, sqrt, and,
of any number of values, min, max, mean, median, count. The result is f32, or of type T.

reduce=WAY[,a=FILE ...][,type=T]: all channels, and those of the files.

components=, sieve=: cells of a component are connected through 4 or 8 neighbours, in octrees 6 or
26; with the rule occupancy, they are at least half full. Components are numbered from 1, by their
first cells in FD order. The smallest are merged first; those surrounded by VOID stay. Both
operations scan all cells first, and are not for --view.

raster=RULE,cell=W[,attribute=NAME]: of the points' z, or of an attribute.

Features are written in the formats that are read, or as .svg, .obj or .ply.";

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Args { chain, output: path, snap, unit, memory, packing, limit } = args;
    let file = &chain.file;
    let (steps, rasters) = chain.steps();
    check_output([&**file].into_iter().chain(steps.iter().flat_map(ViewOperation::files)), &path)?;
    if is_feature_file(file) {
        ensure!(
            rasters.is_empty(),
            "{}: is a feature file; raster= works only with trees of points",
            file.display()
        );
        chain.check_not_exact()?;
        let features = features::Reprojection { file, steps: &steps, allow_ballpark: chain.allow_ballpark };
        return features.write(&path, memory.bytes, &limit, global);
    }
    if let Some(tree) = points::open(file, global)? {
        let [raster] = &rasters[..] else {
            bail!(
                "{}: is a tree of points, expected one operation raster=, such as raster=mean,cell=1",
                file.display()
            );
        };
        ensure!(
            steps.is_empty(),
            "{}: is a tree of points; operations on cells have no effect on it",
            file.display()
        );
        chain.check_not_exact()?;
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
    if let Some(model) = exact::open(file, global)? {
        ensure!(
            rasters.is_empty(),
            "{}: is an exact model; raster= works only with trees of points",
            file.display()
        );
        let changes = chain.local_changes()?;
        if !changes.is_empty() {
            global.check_options(file, "changed by local operators", &["--codec"])?;
            let how = (memory.bytes, &packing);
            return exact::change((&model, &changes), how, (&path, &limit), global);
        }
        global.check_options(file, exact::KIND, &["--codec", "--snap", "--unit"])?;
        let mut options = TransformOptions::new(memory.bytes);
        (options.snap, options.unit, options.codec) = (snap, unit, packing.of_model(file)?);
        options.levels = chain.has_levels()?;
        let moving = exact::Moving { model: &model, steps: &steps, options };
        return exact::transform(moving, &path, &limit, global);
    }
    let cells = chain.chain(global)?;
    ensure!(snap.is_none(), "{}: is not an exact model, which --snap needs", file.display());
    ensure!(
        unit.is_none() || !steps.iter().any(|step| matches!(step, ViewOperation::Scale(_))),
        "{}: --unit converts octrees of cells, and scale= changes the number of cells; leave one of them out",
        file.display()
    );
    let cells = FileView { unit, ..cells };
    let how = packing.with(memory);
    let report_size = |[width, height, depth]: [u64; 3], levels: u8| {
        let more = if depth > 1 { format!(" x {depth}") } else { String::new() };
        global.report("size", format_args!("{width} x {height}{more} cells, depth {levels}"));
    };
    // (A grid of another coordinate system may have many more cells. Users learn this before they
    // wait.)
    let is_warped = steps.iter().any(|step| matches!(step, ViewOperation::Warp(_)));
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
        let what = if outcome.extent[2] > 1 { "volume" } else { "area" };
        let why = "after scaling, since cells have the value at their centres, or parts were cut off";
        global.report(what, format_args!("{error:+.4} % compared with the source's {why}"));
    }
    report_output(global, &path, start);
    Ok(())
}
