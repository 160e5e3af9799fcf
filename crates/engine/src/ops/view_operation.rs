//! Operations of a view chain: windows, affine maps, resamplings and calculations that are applied
//! to a tree before it is read or stored.

use std::path::{Path, PathBuf};

use super::affine::{AffineMap, Axis, View};
use super::calc::Calculation;
use super::data_box::data_box;
use super::reconcile::{CommonGrid, Located, OutputExtent, Position};
use super::regions::{Connectivity, Regions, ScanContext, Sieve};
use super::tree_file::TreeFile;
use super::warp::{Resampling, WarpGrid, WarpTarget};
use crate::tree::Source;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates, Crs};

/// One operation of a chain. Its string is that of the command line: `window=0,0,512,512`,
/// `rotate=30`.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewOperation {
    /// `window=COL,ROW,W,H` or `window=X,Y,Z,W,H,D`: a box of cells, which may reach beyond the
    /// extent. The size 0 along z selects all slices.
    Window([i64; 3], [u64; 3]),
    /// `window=W,S,E,N,in=world` or `window=X,Y,Z,X,Y,Z,in=world`: the cells in a box of other
    /// coordinates (`world`, `lonlat` or a coordinate system), by its minimum and maximum
    /// coordinates. Those along z may be infinite.
    WindowIn(Coordinates, [f64; 3], [f64; 3]),
    /// `crop`: the bounding box of all cells that are not VOID.
    Crop,
    /// `translate=DX,DY[,DZ]`: moves by a number of cells, which may be fractional.
    Translate([f64; 3]),
    /// `scale=F`, `scale=FX,FY[,FZ]`: multiplies the number of cells per axis. A single factor
    /// applies to all axes.
    Scale(Vec<f64>),
    /// `rotate=DEGREES`, `rotate=DEGREES@COL,ROW`, `rotate=DEGREES,AXIS@X,Y,Z`, where AXIS is `x`,
    /// `y`, `z` or a direction `VX,VY,VZ`: rotates about a centre. The default centre is the
    /// middle; quarter turns about it map cells to cells.
    Rotate(f64, RotationAxis, Option<[f64; 3]>),
    /// `mirror=x|y|z`, `transpose`, `axes=+y,-x,+z`, `affine=a,b,c,d,e,f` or the 12 numbers of a
    /// 3x4 matrix.
    AffineMap(AffineMap),
    /// `opaque`: makes transparent cells VOID, in values with opacity.
    Opaque,
    /// `void=N`: makes cells VOID that have this number in all channels.
    Void(Number),
    /// `depth=N`: resamples to coarser or finer cells, so that the tree has N levels below its
    /// root.
    Depth(u8),
    /// `tree-depth=N`: N levels below the root over the same cells, which leaves empty space after
    /// the last cell of each axis.
    TreeDepth(u8),
    /// `subtree=/031`: makes a node the root.
    Subtree(String),
    /// `embed=/2`: makes the root that node of a larger tree.
    Embed(String),
    /// `crs=DEF`: overrides the file's coordinate system; see [`Crs::parse`].
    Crs(Crs),
    /// `like=FILE`, `like=FILE,extent=a|b|union|intersection`: resamples to the grid of another
    /// tree (a), by the frames of both, also across coordinate systems. The result covers a's
    /// extent, or this tree's (b) if its data reach beyond a's.
    Like(PathBuf, Option<OutputExtent>),
    /// `warp=DEF`, `warp=DEF,cell=WIDTH,resampling=WAY`: reprojects to another coordinate system,
    /// onto square cells where data land.
    Warp(WarpTarget),
    /// `grid=xyz`, `grid=xyz,ZOOM`: resamples to the cells of web maps, with the world as the root;
    /// see [`WarpGrid::web_mercator`].
    WebMercator(Option<u8>),
    /// `calc=EXPRESSION`, `calc=EXPRESSION,a=FILE,type=u8`, `reduce=median`: one channel that is
    /// calculated from the channels, and from those of files on the same grid.
    /// `composite=B08,B04,B03`: two to four of them as channels of one tree.
    Calculation(Box<Calculation>),
    /// `components=4|8`, in octrees `6|26`: labels of the connected components of cells of equal
    /// value, numbered by their first cells in FD order. Not available in views: see
    /// [`transform`](super::transform).
    Components(Connectivity),
    /// `sieve=CELLS`, `sieve=AREAm2,connect=8`: merges smaller components into their largest
    /// neighbours. Not available in views.
    Sieve(Sieve),
}

/// Axis of a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RotationAxis {
    /// Axis of the tree.
    About(Axis),
    /// Any direction.
    AboutLine([f64; 3]),
}

impl View {
    /// Applies operations to the view, in order.
    ///
    /// # Errors
    /// If an operation cannot be applied.
    pub fn through(self, steps: &[ViewOperation]) -> Result<View> {
        steps.iter().try_fold(self, |view, step| step.apply(view))
    }
}

impl ViewOperation {
    /// Applies the operation to a view.
    ///
    /// # Errors
    /// If it cannot be applied (see the methods of [`View`]), or a file that it names cannot be
    /// read.
    pub fn apply(&self, view: View) -> Result<View> {
        match self {
            ViewOperation::Window(min, size) => window(view, *min, *size),
            ViewOperation::WindowIn(coordinates, low, high) => window_in(view, coordinates, *low, *high),
            ViewOperation::Crop => crop(view),
            ViewOperation::Translate(by) => view.translate(*by),
            ViewOperation::Scale(factors) => scale(view, factors),
            ViewOperation::Rotate(degrees, turn, centre) => rotate(view, *degrees, *turn, *centre),
            ViewOperation::AffineMap(map) => view.transform(map),
            ViewOperation::Opaque => view.opaque(),
            ViewOperation::Void(number) => view.without_number(*number),
            ViewOperation::Depth(depth) => view.resample(*depth),
            ViewOperation::TreeDepth(depth) => view.deepened(*depth),
            ViewOperation::Subtree(code) => subtree(view, code),
            ViewOperation::Embed(code) => embed(view, code),
            ViewOperation::Crs(crs) => Ok(view.in_system(crs.clone())),
            ViewOperation::Like(path, extent) => like(view, path, *extent),
            ViewOperation::Warp(target) => {
                let name = view.source().name().to_path_buf();
                warp(view, target).map_err(|error| error.of_file(&name))
            }
            ViewOperation::WebMercator(zoom) => {
                let (frame, extent, name) = (view.frame(false), view.extent(), view.source().name());
                let grid = WarpGrid::web_mercator(*zoom, &frame, extent, view.allows_ballpark())
                    .map_err(|error| error.of_file(name))?;
                view.warped(&grid)
            }
            ViewOperation::Calculation(calculation) => calculation.apply(view),
            ViewOperation::Components(_) | ViewOperation::Sieve(_) => Err(Error::unsupported(
                view.source().name(),
                format!("{self} in a view"),
                "it scans all cells before the first result: write its result to a file with `spinney transform`",
            )),
        }
    }

    /// Applies the operation to a view, also if it has to scan all cells first.
    ///
    /// # Errors
    /// Those of [`ViewOperation::apply`]; also if a temporary file cannot be used, or on
    /// cancellation.
    pub(super) fn apply_whole(&self, view: View, passes: &ScanContext<'_>) -> Result<View> {
        match self {
            ViewOperation::Components(connect) => {
                View::of_made(Regions::components(&view, *connect, passes)?.into(), &view)
            }
            ViewOperation::Sieve(sieve) => {
                View::of_made(Regions::sieved(&view, sieve, passes)?.into(), &view)
            }
            _ => self.apply(view),
        }
    }

    /// Number of scans over all cells before the first result is available.
    pub(super) fn passes(&self) -> u64 {
        match self {
            ViewOperation::Components(_) => 1,
            ViewOperation::Sieve(_) => 2,
            _ => 0,
        }
    }

    /// The operation as a map of coordinates that are not cells, such as those of exact models.
    /// Rotates about the origin if no centre is given.
    ///
    /// # Errors
    /// If it is not an affine map.
    pub fn as_map(&self) -> Result<AffineMap> {
        match self {
            ViewOperation::Translate(by) => Ok(AffineMap::translation(*by)),
            ViewOperation::Scale(factors) => {
                Ok(AffineMap::scaling(std::array::from_fn(|axis| match (&factors[..], axis) {
                    ([factor], _) => *factor,
                    (factors, axis) => factors.get(axis).copied().unwrap_or(1.0),
                })))
            }
            ViewOperation::Rotate(degrees, RotationAxis::About(axis), centre) => {
                Ok(AffineMap::rotation(*axis, *degrees, centre.unwrap_or_default()))
            }
            ViewOperation::Rotate(degrees, RotationAxis::AboutLine(direction), centre) => {
                AffineMap::rotation_about(*direction, *degrees, centre.unwrap_or_default())
            }
            ViewOperation::AffineMap(map) => Ok(*map),
            _ => {
                let expected = "an operation that moves coordinates (translate=, scale=, rotate=, mirror=, transpose, axes= or affine=), or in `spinney transform` crs=";
                Err(Error::invalid("operation", format!("`{self}`"), expected))
            }
        }
    }

    /// Whether the operation resamples to another grid, possibly in another coordinate system:
    /// `like=`, `warp=` and `grid=`.
    pub(super) fn leads_to_grid(&self) -> bool {
        matches!(self, ViewOperation::Like(..) | ViewOperation::Warp(_) | ViewOperation::WebMercator(_))
    }

    /// Files that the operation reads in addition to the view's.
    pub fn files(&self) -> Vec<&Path> {
        match self {
            ViewOperation::Like(path, _) => vec![path],
            ViewOperation::Calculation(calculation) => calculation.files().map(PathBuf::as_path).collect(),
            _ => Vec::new(),
        }
    }
}

impl ViewOperation {
    /// The operation with other names of its [files](ViewOperation::files).
    ///
    /// # Errors
    /// Those of `name`.
    pub fn with_files(&self, name: &dyn Fn(&Path) -> Result<PathBuf>) -> Result<ViewOperation> {
        Ok(match self {
            ViewOperation::Like(path, extent) => ViewOperation::Like(name(path)?, *extent),
            ViewOperation::Calculation(calculation) => {
                ViewOperation::Calculation(Box::new(calculation.with_files(name)?))
            }
            step => step.clone(),
        })
    }
}

fn window(view: View, min: [i64; 3], mut size: [u64; 3]) -> Result<View> {
    let extent = view.extent();
    let is_flat = size[2] == 0;
    if is_flat {
        // Four numbers select columns of any height.
        size[2] = extent[2];
    }
    let reaches =
        |axis: usize| min[axis] < extent[axis] as i64 && min[axis].saturating_add_unsigned(size[axis]) > 0;
    if !(0..3).all(reaches) {
        let axes = view.form().axes();
        let cells: Vec<String> = extent[..axes].iter().map(u64::to_string).collect();
        let expected = format!(
            "a window that overlaps the {} cells of the tree{}",
            cells.join(" x "),
            as_box_of_the_world(&view, min, size, if is_flat { 2 } else { 3 })
        );
        return Err(Error::invalid("window", "a window outside of the tree", expected));
    }
    view.window(min, size)
}

/// Returns advice for the numbers of a window of cells that are a box of the world, or the first
/// cell and the size of one.
fn as_box_of_the_world(view: &View, min: [i64; 3], size: [u64; 3], axes: usize) -> &'static str {
    let extent = view.extent();
    let [low, high] = view.frame(false).world_box(&Bounds::of_extent(extent));
    let meets =
        |ends: [f64; 3]| (0..axes).all(|axis| (min[axis] as f64) < high[axis] && ends[axis] > low[axis]);
    let ends = size.map(|number| number as f64);
    match meets(ends) || meets(std::array::from_fn(|axis| min[axis] as f64 + ends[axis])) {
        true => "; for a box in world coordinates (minimum, then maximum), append ,in=world",
        false => "",
    }
}

fn window_in(view: View, coordinates: &Coordinates, low: [f64; 3], high: [f64; 3]) -> Result<View> {
    let locator = CellLocator::new(coordinates, &view.frame(false), view.extent())?;
    match *locator.boxes(low, high)? {
        [bounds] => view.window(bounds.min.map(|cell| cell as i64), bounds.size()),
        [] => {
            let expected = format!("a window that overlaps the tree, which is {}", locator.bounds_text());
            Err(Error::invalid("window", "a window outside of the tree", expected))
        }
        _ => {
            let expected = "two separate windows, one on each side of the seam";
            Err(Error::invalid(
                "window",
                "a window across the seam of the tree (where longitudes wrap)",
                expected,
            ))
        }
    }
}

fn crop(view: View) -> Result<View> {
    match data_box(&view)? {
        Some(bounds) => view.window(bounds.min.map(|cell| cell as i64), bounds.size()),
        None => Err(Error::invalid("crop", "a tree without data", "a tree with cells that are not VOID")),
    }
}

fn scale(view: View, factors: &[f64]) -> Result<View> {
    let axes = view.form().axes();
    let each = |axis: usize| match *factors {
        [factor] if axis < axes => factor,
        _ => factors.get(axis).copied().unwrap_or(1.0),
    };
    view.scale(std::array::from_fn(each))
}

fn rotate(view: View, degrees: f64, turn: RotationAxis, centre: Option<[f64; 3]>) -> Result<View> {
    let about = centre.unwrap_or(view.extent().map(|cells| cells as f64 / 2.0));
    let map = match turn {
        RotationAxis::About(axis) => AffineMap::rotation(axis, degrees, about),
        RotationAxis::AboutLine(direction) => AffineMap::rotation_about(direction, degrees, about)?,
    };
    // A quarter turn about the middle of an odd by an even number of cells would cut every cell in
    // half.
    let map = if centre.is_none() { map.on_whole_cells(view.extent()) } else { map };
    view.transform(&map)
}

fn subtree(view: View, code: &str) -> Result<View> {
    let code = Code::parse(view.form().dimension, code)?;
    let depth = view.depth();
    if code.level() > depth {
        let expected = format!("a code of at most {depth} digits");
        return Err(Error::invalid("subtree", code.to_string(), expected));
    }
    let node = code.bounds(depth);
    // The part of the extent that lies in the node. It need not begin at the node's first cell.
    let extent: [u64; 3] =
        std::array::from_fn(|axis| view.extent()[axis].saturating_sub(node.min[axis]).min(node.size()[axis]));
    view.window(node.min.map(|cell| cell as i64), extent)?.deepened(depth - code.level())
}

fn embed(view: View, code: &str) -> Result<View> {
    let dimension = view.form().dimension;
    let (code, depth) = (Code::parse(dimension, code)?, view.depth());
    let most = dimension.max_depth();
    if u32::from(depth) + u32::from(code.level()) > u32::from(most) {
        let found = format!("a tree of {depth} levels below {code}");
        return Err(Error::invalid("embed", found, format!("at most {most} levels in all")));
    }
    let node = code.bounds(depth + code.level());
    view.translate(node.min.map(|cell| cell as f64))?.deepened(depth + code.level())
}

fn warp(view: View, target: &WarpTarget) -> Result<View> {
    let Some(data) = data_box(&view)? else {
        return Err(Error::invalid("warp", "a tree without data", "a tree with cells that are not VOID"));
    };
    let grid = target.grid(&view.frame(false), view.extent(), &data, view.allows_ballpark())?;
    view.resampling(target.resampling).warped(&grid)
}

/// View on the cells of a file, over the requested extent. The default is the file's extent, or the
/// view's own if its data reach beyond the file's.
fn like(view: View, path: &Path, extent: Option<OutputExtent>) -> Result<View> {
    let other = TreeFile::open(path, &view.source().access().into())?;
    let dimension = view.form().dimension;
    if other.form().dimension != dimension {
        let expected = format!("{}, like {}", dimension.tree_name(), view.source().name().display());
        return Err(Error::invalid(path.display().to_string(), other.form().dimension.tree_name(), expected));
    }
    let (name, here) = (path.display().to_string(), view.source().name().display().to_string());
    let target = View::whole(other.into())?;
    let grid_for = |located: Located<'_>, choice: OutputExtent| {
        CommonGrid::of(&[Located::of(&name, &target), located], dimension, choice, Position::World)
    };
    // (VOID cells around the data do not require a larger extent.)
    let located = || -> Result<Located<'_>> {
        let own = Located::of(&here, &view);
        let data = data_box(&view)?.unwrap_or(own.data);
        Ok(Located { data, ..own })
    };
    let both = grid_for(Located::of(&here, &view), OutputExtent::Union)?;
    let choice = match extent {
        Some(extent) => extent,
        None if both.is_own(target.extent()) => OutputExtent::A,
        None => match grid_for(located()?, OutputExtent::Union)?.is_own(target.extent()) {
            true => OutputExtent::A,
            false => OutputExtent::B,
        },
    };
    let grid = match choice {
        OutputExtent::A => grid_for(Located::of(&here, &view), choice)?,
        _ => grid_for(located()?, choice)?,
    };
    if grid.box_of(1).is_empty() {
        let expected = format!("overlapping extents, or like={name},extent=union");
        return Err(Error::invalid(format!("extent of {name}"), format!("no cell of {here}"), expected));
    }
    // An affine map samples cell centres, or averages areas by the file's rule. The warper does all
    // other resamplings, also within one coordinate system.
    match view.warp().resampling {
        None | Some(Resampling::Nearest) => grid.bring(1, view),
        // (Cells that coincide with the other grid's are the same under any resampling, and are
        // copied with their nodes.)
        Some(_) if grid.shift(1).is_some() => grid.bring(1, view),
        Some(way) if dimension == Dimension::Oct => {
            let expected = "nearest, or no method: the rule of the octree is then used";
            Err(Error::invalid("resampling of an octree", way.name(), expected))
        }
        Some(_) => view.warped(&WarpGrid { frame: grid.frame.clone(), extent: grid.extent }),
    }
}
