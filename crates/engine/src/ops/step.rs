//! Steps of a chain: windows, affine maps, resamplings and calculations of a tree before it is read or stored.

use std::path::{Path, PathBuf};

use super::affine::{AffineMap, Axis, View};
use super::calc::Calculation;
use super::data_box::data_box;
use super::reconcile::{CommonGrid, Located, OutputExtent, Position};
use super::regions::{Connectivity, Passes, Regions, Sieve};
use super::tree_file::TreeFile;
use super::warp::{Resampling, WarpGrid, WarpTarget};
use crate::tree::Source;
use spinney_base::space::{Code, Dimension};
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates, Crs};

/// One step of a chain. Its text is that of the command line: `window=0,0,512,512`, `rotate=30`.
#[derive(Clone, Debug, PartialEq)]
pub enum ViewStep {
    /// `window=COL,ROW,W,H` or `window=X,Y,Z,W,H,D`: a box of cells, which may stick out.
    Window([i64; 3], [u64; 3]),
    /// `window=W,S,E,N,in=world` or `window=X,Y,Z,X,Y,Z,in=world`: the cells in a box of other coordinates (`world`, `lonlat` or a
    /// coordinate system), by its least and greatest coordinates; those along z may be infinite.
    WindowIn(Coordinates, [f64; 3], [f64; 3]),
    /// `crop`: the smallest box around all that is not VOID.
    Crop,
    /// `translate=DX,DY[,DZ]`: moves by cells, whole or not.
    Translate([f64; 3]),
    /// `scale=F`, `scale=FX,FY[,FZ]`: so many times as many cells; one number is for all axes.
    Scale(Vec<f64>),
    /// `rotate=DEGREES`, `rotate=DEGREES@COL,ROW`, `rotate=DEGREES,AXIS@X,Y,Z`, where AXIS is `x`, `y`, `z`
    /// or a direction `VX,VY,VZ`: turns about a centre; if there is none, about the middle, where quarter
    /// turns take whole cells to whole cells.
    Rotate(f64, Turn, Option<[f64; 3]>),
    /// `mirror=x|y|z`, `transpose`, `axes=+y,-x,+z`, `affine=a,b,c,d,e,f` or the 12 numbers of a 3x4 matrix.
    AffineMap(AffineMap),
    /// `opaque`: VOID for what is transparent, where values have opacity.
    Opaque,
    /// `void=N`: VOID for cells that have this number in all channels.
    Void(Number),
    /// `depth=N`: coarser or finer cells, so that the tree has N levels below its root.
    Depth(u8),
    /// `tree-depth=N`: N levels below the root over the same cells, with room for more on the far sides.
    TreeDepth(u8),
    /// `subtree=/031`: a node becomes the root.
    Subtree(String),
    /// `embed=/2`: the root becomes that node of a larger tree.
    Embed(String),
    /// `crs=DEF`: says in which coordinate system the cells lie, in place of what the file says; see [`Crs::parse`].
    Crs(Crs),
    /// `like=FILE`, `like=FILE,extent=a|b|union|intersection`: onto the cells of another tree (a), by the frames of both, also in another
    /// coordinate system; over its extent, or that of this tree (b) where data of it lie beyond.
    Like(PathBuf, Option<OutputExtent>),
    /// `warp=DEF`, `warp=DEF,cell=WIDTH,resampling=WAY`: to another coordinate system, onto square cells where data land.
    Warp(WarpTarget),
    /// `grid=xyz`, `grid=xyz,ZOOM`: onto the cells of web maps, with the world as the root; see [`WarpGrid::web_mercator`].
    WebMercator(Option<u8>),
    /// `calc=EXPRESSION`, `calc=EXPRESSION,a=FILE,type=u8`, `reduce=median`: one channel of what is calculated with the channels, and
    /// with those of files on the same grid. `composite=B08,B04,B03`: two to four of them as channels of one tree.
    Calculation(Box<Calculation>),
    /// `components=4|8`, of octrees `6|26`: labels of the components of cells of equal value, numbered by their first cells in FD order.
    /// Not in views: see [`transform`](super::transform).
    Components(Connectivity),
    /// `sieve=CELLS`, `sieve=AREAm2,connect=8`: gives components that are smaller to their largest neighbours. Not in views.
    Sieve(Sieve),
}

/// Axis of a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn {
    /// An axis of the tree.
    About(Axis),
    /// Any direction.
    AboutLine([f64; 3]),
}

impl View {
    /// The view with some steps done to it, one after the other.
    ///
    /// # Errors
    /// If a step cannot be done.
    pub fn through(self, steps: &[ViewStep]) -> Result<View> {
        steps.iter().try_fold(self, |view, step| step.apply(view))
    }
}

impl ViewStep {
    /// Applies the step to a view.
    ///
    /// # Errors
    /// If it cannot be done: see the methods of [`View`]; if the file that the view is to be like cannot be
    /// read.
    pub fn apply(&self, view: View) -> Result<View> {
        match self {
            ViewStep::Window(min, size) => window(view, *min, *size),
            ViewStep::WindowIn(coordinates, low, high) => window_in(view, coordinates, *low, *high),
            ViewStep::Crop => crop(view),
            ViewStep::Translate(by) => view.translate(*by),
            ViewStep::Scale(factors) => scale(view, factors),
            ViewStep::Rotate(degrees, turn, centre) => rotate(view, *degrees, *turn, *centre),
            ViewStep::AffineMap(map) => view.transform(map),
            ViewStep::Opaque => view.opaque(),
            ViewStep::Void(number) => view.without_number(*number),
            ViewStep::Depth(depth) => view.resample(*depth),
            ViewStep::TreeDepth(depth) => view.deepened(*depth),
            ViewStep::Subtree(code) => subtree(view, code),
            ViewStep::Embed(code) => embed(view, code),
            ViewStep::Crs(crs) => Ok(view.in_system(crs.clone())),
            ViewStep::Like(path, extent) => like(view, path, *extent),
            ViewStep::Warp(target) => warp(view, target),
            ViewStep::WebMercator(zoom) => {
                let grid =
                    WarpGrid::web_mercator(*zoom, &view.frame(false), view.extent(), view.allows_ballpark())?;
                view.warped(&grid)
            }
            ViewStep::Calculation(calculation) => calculation.apply(view),
            ViewStep::Components(_) | ViewStep::Sieve(_) => Err(Error::unsupported(
                view.source().name(),
                format!("{self} in a view"),
                "it goes through all cells before it has the first: make a file of it with `spinney transform`",
            )),
        }
    }

    /// Applies the step to a view, also if that takes going through all of its cells.
    ///
    /// # Errors
    /// As [`ViewStep::apply`]; also if a temporary file cannot be used, or on interruption.
    pub(super) fn apply_whole(&self, view: View, passes: &Passes<'_>) -> Result<View> {
        match self {
            ViewStep::Components(connect) => {
                View::of_made(Regions::components(&view, *connect, passes)?.into(), &view)
            }
            ViewStep::Sieve(sieve) => View::of_made(Regions::sieved(&view, sieve, passes)?.into(), &view),
            _ => self.apply(view),
        }
    }

    /// Times that the step goes through all cells before the first is handed out.
    pub(super) fn passes(&self) -> u64 {
        match self {
            ViewStep::Components(_) => 1,
            ViewStep::Sieve(_) => 2,
            _ => 0,
        }
    }

    /// The step as a map of coordinates that are no cells, such as those of exact models: about the origin where no centre is told.
    ///
    /// # Errors
    /// If it is no such map.
    pub fn as_map(&self) -> Result<AffineMap> {
        match self {
            ViewStep::Translate(by) => Ok(AffineMap::translation(*by)),
            ViewStep::Scale(factors) => {
                Ok(AffineMap::scaling(std::array::from_fn(|axis| match (&factors[..], axis) {
                    ([factor], _) => *factor,
                    (factors, axis) => factors.get(axis).copied().unwrap_or(1.0),
                })))
            }
            ViewStep::Rotate(degrees, Turn::About(axis), centre) => {
                Ok(AffineMap::rotation(*axis, *degrees, centre.unwrap_or_default()))
            }
            ViewStep::Rotate(degrees, Turn::AboutLine(direction), centre) => {
                AffineMap::rotation_about(*direction, *degrees, centre.unwrap_or_default())
            }
            ViewStep::AffineMap(map) => Ok(*map),
            _ => {
                let expected = "translate=, scale=, rotate=, mirror=, transpose, axes= or affine=, which move coordinates";
                Err(Error::invalid("step", format!("`{self}`"), expected))
            }
        }
    }

    /// Whether the step leads onto cells of another grid, which may lie in another coordinate system: `like=`, `warp=` and `grid=`.
    pub(super) fn leads_to_grid(&self) -> bool {
        matches!(self, ViewStep::Like(..) | ViewStep::Warp(_) | ViewStep::WebMercator(_))
    }

    /// The files that the step reads, besides that of the view.
    pub fn files(&self) -> Vec<&Path> {
        match self {
            ViewStep::Like(path, _) => vec![path],
            ViewStep::Calculation(calculation) => calculation.files().map(PathBuf::as_path).collect(),
            _ => Vec::new(),
        }
    }
}

impl ViewStep {
    /// The step with other names of its [files](ViewStep::files).
    ///
    /// # Errors
    /// Those of finding names.
    pub fn with_files(&self, name: &dyn Fn(&Path) -> Result<PathBuf>) -> Result<ViewStep> {
        Ok(match self {
            ViewStep::Like(path, extent) => ViewStep::Like(name(path)?, *extent),
            ViewStep::Calculation(calculation) => {
                ViewStep::Calculation(Box::new(calculation.with_files(name)?))
            }
            step => step.clone(),
        })
    }
}

fn window(view: View, min: [i64; 3], mut size: [u64; 3]) -> Result<View> {
    if view.form().axes() > 2 && min[2] == 0 && size[2] == 1 && view.extent()[2] > 1 {
        // Four numbers mean columns of any height.
        size[2] = view.extent()[2];
    }
    let extent = view.extent();
    let reaches =
        |axis: usize| min[axis] < extent[axis] as i64 && min[axis].saturating_add_unsigned(size[axis]) > 0;
    if !(0..3).all(reaches) {
        let [x, y, z] = extent;
        let expected = format!("one that is at least partly in the {x} x {y} x {z} cells");
        return Err(Error::invalid("window", "one that is outside of the tree", expected));
    }
    view.window(min, size)
}

fn window_in(view: View, coordinates: &Coordinates, low: [f64; 3], high: [f64; 3]) -> Result<View> {
    let places = CellLocator::new(coordinates, &view.frame(false), view.extent())?;
    match *places.boxes(low, high)? {
        [bounds] => view.window(bounds.min.map(|cell| cell as i64), bounds.size()),
        [] => {
            let expected = format!("one with a part of the tree, which is {}", places.picture());
            Err(Error::invalid("window", "one that is outside of the tree", expected))
        }
        _ => {
            let expected = "one of its two parts, each by itself";
            Err(Error::invalid("window", "one that lies across the tree's seam", expected))
        }
    }
}

fn crop(view: View) -> Result<View> {
    match data_box(&view)? {
        Some(bounds) => view.window(bounds.min.map(|cell| cell as i64), bounds.size()),
        None => Err(Error::invalid("crop", "a tree that is VOID", "some data")),
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

fn rotate(view: View, degrees: f64, turn: Turn, centre: Option<[f64; 3]>) -> Result<View> {
    let about = centre.unwrap_or(view.extent().map(|cells| cells as f64 / 2.0));
    let map = match turn {
        Turn::About(axis) => AffineMap::rotation(axis, degrees, about),
        Turn::AboutLine(direction) => AffineMap::rotation_about(direction, degrees, about)?,
    };
    // A quarter turn about the middle of an odd by an even number of cells would cut all of them in half.
    let map = if centre.is_none() { map.on_whole_cells(view.extent()) } else { map };
    view.transform(&map)
}

fn subtree(view: View, code: &str) -> Result<View> {
    let code = Code::parse(view.form().dimension, code)?;
    let depth = view.depth();
    if code.level() > depth {
        let expected = format!("at most {depth} digits");
        return Err(Error::invalid("subtree", code.to_string(), expected));
    }
    let node = code.bounds(depth);
    // As much of the picture as lies in the node: it need not begin there.
    let extent: [u64; 3] =
        std::array::from_fn(|axis| view.extent()[axis].saturating_sub(node.min[axis]).min(node.size()[axis]));
    view.window(node.min.map(|cell| cell as i64), extent)?.deepened(depth - code.level())
}

fn embed(view: View, code: &str) -> Result<View> {
    let dimension = view.form().dimension;
    let (code, depth) = (Code::parse(dimension, code)?, view.depth());
    let most = dimension.max_depth();
    if u32::from(depth) + u32::from(code.level()) > u32::from(most) {
        let found = format!("{code} over {depth} levels");
        return Err(Error::invalid("embed", found, format!("at most {most} levels in all")));
    }
    let node = code.bounds(depth + code.level());
    view.translate(node.min.map(|cell| cell as f64))?.deepened(depth + code.level())
}

fn warp(view: View, target: &WarpTarget) -> Result<View> {
    let Some(data) = data_box(&view)? else {
        return Err(Error::invalid("warp", "a tree that is VOID", "some data"));
    };
    let grid = target.grid(&view.frame(false), view.extent(), &data, view.allows_ballpark())?;
    view.resampling(target.resampling).warped(&grid)
}

/// The view on the cells of a file, over the requested part of the world; else over the file's extent, or the view's own where data lie beyond it.
fn like(view: View, path: &Path, extent: Option<OutputExtent>) -> Result<View> {
    let other = TreeFile::open(path, &view.source().access().into())?;
    let dimension = view.form().dimension;
    if other.form().dimension != dimension {
        let expected = format!("{}, as {} is", dimension.tree_name(), view.source().name().display());
        return Err(Error::invalid(path.display().to_string(), other.form().dimension.tree_name(), expected));
    }
    let (name, here) = (path.display().to_string(), view.source().name().display().to_string());
    let target = View::whole(other.into())?;
    let grid_for = |located: Located<'_>, choice: OutputExtent| {
        CommonGrid::of(&[Located::of(&name, &target), located], dimension, choice, Position::World)
    };
    // (What is VOID around the data is no reason for more cells.)
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
        let expected = format!("one that both share, or like={name},extent=union");
        return Err(Error::invalid(
            format!("extent of {name}"),
            format!("one without a cell of {here}"),
            expected,
        ));
    }
    // An affine map takes the centre of a cell, or the file's rule for areas. All other ways are the warper's, also within one system.
    match view.warp().resampling {
        None | Some(Resampling::Nearest) => grid.bring(1, view),
        // (Cells that lie on the other's are the same by any way, and are copied with the nodes that have them.)
        Some(_) if grid.shift(1).is_some() => grid.bring(1, view),
        Some(way) if dimension == Dimension::Oct => {
            let expected = "nearest, or none: cells of an octree are averaged by its own rule";
            Err(Error::invalid("resampling of an octree", way.name(), expected))
        }
        Some(_) => view.warped(&WarpGrid { frame: grid.frame.clone(), extent: grid.extent }),
    }
}
