//! Views: one affine map between the cells of a result and those of a source, for any number of
//! chained operations.

use std::sync::Arc;

use glam::DVec3;

use super::map::AffineMap;
use crate::ops::tree_file::TreeFile;
use crate::ops::view_source::ViewSource;
use crate::ops::warp::{Resampling, WarpGrid, WarpOptions, Warped};
use crate::store::depth_for;
use crate::tree::Source;
use spinney_base::TreeType;
use spinney_base::value::Rule;
use spinney_base::{Error, Result};
use spinney_container::{Metadata, Tag, Unit};
use spinney_crs::{Crs, Frame};

/// How cells that are not source cells get their value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampling {
    /// Value of the source cell at the cell's centre.
    Centre,
    /// Value from all source cells that the cell covers, weighted by the covered area, by the
    /// source's rule: the mean, or the value with the largest area (of equal areas, that of the
    /// first cell in row order). Only if axes map to axes; else as [`Sampling::Centre`], except for
    /// occupancy. For occupancy everything outside is empty, so that volumes are kept.
    Area(Rule),
}

/// Affine view of a file: a window, a translated, scaled, mirrored or rotated tree, or any chain of
/// these.
///
/// A chain is one map, so that cells are looked up once and nothing is lost between the operations.
/// Nothing is read before the view is traversed. Memory is proportional to depth: an INNER node of
/// the view holds the source nodes around its image (at most 2 along each axis), as in Samet's
/// algorithms for translation and rotation. It is uniform if they are, else it is split until this
/// is decided, down to single cells. Where a node of the view is a node of the source, that node is
/// returned with its stored subtree.
///
/// ```
/// use std::sync::Arc;
/// use spinney::raw::ops::{AffineMap, Axis, View};
/// use spinney::{Dimension, Rule, SampleType, TreeType, Value, ValueType};
/// use spinney::tree::{MemTree, Source};
///
/// let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
/// let columns = MemTree::from_cells(form, 2, Rule::Mean, &|[x, _, _]| Some(Value::from([x as u8])));
/// let view = View::new(Arc::new(columns.into()), [4, 3, 1])?;
/// let turned = view.window([1, 0, 0], [3, 3, 1])?.transform(&AffineMap::rotation(Axis::Z, 90.0, [0.0; 3]))?;
/// assert_eq!((turned.extent(), turned.depth()), ([3, 3, 1], 2));
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct View {
    pub(super) source: Arc<ViewSource>,
    /// Tree type of the source, copied here since every node needs it.
    pub(super) form: TreeType,
    /// Cells of the source along each axis; all others are VOID.
    pub(super) source_extent: [u64; 3],
    /// Map from source cells to the grid in which the view has its first cell at `origin`.
    to_grid: AffineMap,
    /// First cell of the view in that grid: integers. Windows move it without changing the grid.
    origin: DVec3,
    extent: [u64; 3],
    depth: u8,
    /// Windows that were applied: maps from source cells to the window's, and sizes.
    windows: Vec<(AffineMap, DVec3)>,
    pub(super) sampling: Sampling,
    pub(super) lookup: Lookup,
    /// Coordinate system, if it is not the source's.
    crs: Option<Arc<Crs>>,
    /// Unit of length of the world, if it is not the source's, and units per unit of the source.
    unit: Option<(Arc<str>, f64)>,
    /// Options for operations with a grid in another coordinate system.
    warp: WarpOptions,
    /// Whether cells may use the source's approximate level values, since this view is a level of
    /// another view.
    pub(super) is_level: bool,
}

/// Maps and boxes for finding a view's cells, derived from the operations.
#[derive(Clone, Debug)]
pub(super) struct Lookup {
    /// Map from the view's cells to the source's.
    pub(super) to_source: AffineMap,
    /// Whether cells are averaged over areas of the source.
    pub(super) by_area: bool,
    /// Whether these are averages of occupancy.
    pub(super) is_coverage: bool,
    /// Whether the visible part of some cell is no box of the source.
    pub(super) is_turned: bool,
    /// Visible source cells: first, and end (exclusive).
    pub(super) visible: ([i64; 3], [i64; 3]),
    /// Translation by whole cells, if the view is no more than that.
    pub(super) moved: Option<Moved>,
    /// Bounding box of the visible source cells' image, in whole cells of the view.
    pub(super) content: (DVec3, DVec3),
    /// Box of cells that may have values.
    pub(super) shown: (DVec3, DVec3),
    /// Windows that are not aligned with cells: maps from the view's cells to the window's, and
    /// sizes.
    pub(super) askew: Vec<(AffineMap, DVec3)>,
}

/// Translation by whole cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    /// Offset from the view's cells to the source's.
    pub(super) by: [i64; 3],
    /// Source cells that are visible, also through later windows.
    visible: ([i64; 3], [i64; 3]),
    /// Extent of the source; all cells outside are VOID.
    extent: [u64; 3],
}

impl Moved {
    /// Whether all cells of the source in a box, given by its first cell and side, are visible.
    pub(super) fn shows_all(&self, first: [i64; 3], side: i64, axes: usize) -> bool {
        (0..axes).all(|axis| {
            let (start, end) = (first[axis].max(0), (first[axis] + side).min(self.extent[axis] as i64));
            self.visible.0[axis] <= start && end <= self.visible.1[axis]
        })
    }
}

/// Tolerance of coordinates, in cells: more than their rounding errors, less than any relevant
/// overlap.
pub(super) const TINY: f64 = 1e-6;

impl View {
    /// View of a source's whole extent, as its header states.
    pub(crate) fn whole(source: ViewSource) -> Result<View> {
        let extent = source.header().extent;
        View::new(Arc::new(source), extent)
    }

    /// View of a whole source with `extent` cells.
    ///
    /// # Errors
    /// If the extent does not fit the source.
    pub fn new(source: Arc<ViewSource>, extent: [u64; 3]) -> Result<View> {
        let (form, depth) = (source.form(), source.depth());
        let side = 1u64 << depth;
        for (axis, cells) in extent.into_iter().enumerate() {
            let most = if axis < form.axes() { side } else { 1 };
            if cells == 0 || cells > most {
                let found = format!("{cells} cells along axis {axis}");
                return Err(Error::invalid(
                    "extent",
                    found,
                    format!("1 to {most}, the limit of the source's depth"),
                ));
            }
        }
        let view = View {
            source,
            form,
            source_extent: extent,
            to_grid: AffineMap::IDENTITY,
            origin: DVec3::ZERO,
            extent,
            depth,
            windows: Vec::new(),
            crs: None,
            unit: None,
            warp: WarpOptions::default(),
            is_level: false,
            sampling: Sampling::Centre,
            lookup: Lookup {
                to_source: AffineMap::IDENTITY,
                by_area: false,
                is_coverage: false,
                is_turned: false,
                visible: ([0; 3], [0; 3]),
                moved: None,
                content: (DVec3::ZERO, DVec3::ZERO),
                shown: (DVec3::ZERO, DVec3::ZERO),
                askew: Vec::new(),
            },
        };
        view.renewed()
    }

    /// View of another layer of the same file, on the same cells, through the same windows.
    ///
    /// # Errors
    /// If the layer has another dimension, or the map cannot be inverted.
    pub(crate) fn of_layer(&self, layer: ViewSource) -> Result<View> {
        let (axes, depth) = (self.form.axes(), layer.depth());
        let factor = 2f64.powi(i32::from(self.source.depth()) - i32::from(depth));
        let to_own = AffineMap::scaling(std::array::from_fn(|axis| if axis < axes { factor } else { 1.0 }));
        let windows = self.windows.iter().map(|(map, size)| (to_own.then(map), *size)).collect();
        let whole = View::whole(layer)?;
        let view = View {
            to_grid: to_own.then(&self.to_grid),
            origin: self.origin,
            extent: self.extent,
            depth: self.depth,
            windows,
            sampling: self.sampling,
            crs: self.crs.clone(),
            unit: self.unit.clone(),
            warp: self.warp,
            is_level: self.is_level,
            ..whole
        };
        view.renewed()
    }

    /// Cells along each axis; everything outside is VOID.
    pub fn extent(&self) -> [u64; 3] {
        self.extent
    }

    /// Levels below the root.
    pub fn depth(&self) -> u8 {
        self.depth
    }

    /// View of a whole source that was computed from the cells of another view, with that view's
    /// options.
    ///
    /// # Errors
    /// None in practice: those of [`View::new`].
    pub(in crate::ops) fn of_made(source: ViewSource, of: &View) -> Result<View> {
        let header = source.header();
        let (rule, extent, depth) = (header.rule, header.extent, header.depth());
        let view = View::new(Arc::new(source), extent)?.warping(of.warp());
        let view = if depth > depth_for(extent) { view.deepened(depth)? } else { view };
        match of.sampling() {
            Sampling::Centre => Ok(view),
            Sampling::Area(_) => view.sampled(Sampling::Area(rule)),
        }
    }

    /// Returns this view of a source that has other values in the same nodes.
    pub(in crate::ops) fn over(self, source: Arc<ViewSource>) -> View {
        View { form: source.form(), source, ..self }
    }

    /// Returns this view with [levels between](View::levels_above) its cells and the source's, of
    /// a source whose cells are as large as the view's.
    pub(in crate::ops) fn over_scaled(self, source: Arc<ViewSource>, to_own: &AffineMap) -> Result<View> {
        let Lookup { visible, shown, .. } = &self.lookup;
        let to_scaled = to_own.inverse()?;
        let to_grid = to_own.then(&self.to_grid);
        let box_of = |(start, end): ([i64; 3], [i64; 3])| {
            let corner = |cell: [i64; 3]| DVec3::from(to_scaled.apply(cell.map(|cell| cell as f64)));
            (corner(start), corner(end).ceil())
        };
        let (start, end) = box_of(*visible);
        let to_shown = to_grid.then(&AffineMap::translation((-self.origin - shown.0).to_array()));
        let windows =
            vec![(AffineMap::translation((-start).to_array()), end - start), (to_shown, shown.1 - shown.0)];
        let source_extent = source.header().extent;
        View { source, source_extent, to_grid, windows, ..self }.renewed()
    }

    /// Source of the view.
    pub fn source(&self) -> &Arc<ViewSource> {
        &self.source
    }

    /// Map from the view's cells to the source's.
    pub fn to_source(&self) -> AffineMap {
        self.lookup.to_source
    }

    /// Window: a box of cells, which may reach beyond the extent on any side. Its first cell
    /// becomes the view's first.
    ///
    /// # Errors
    /// If it is empty, is larger than the deepest tree, or does not intersect the view.
    pub fn window(mut self, min: [i64; 3], size: [u64; 3]) -> Result<View> {
        let axes = self.form.axes();
        let outside = (0..axes).any(|axis| {
            min[axis] >= self.extent[axis] as i64 || min[axis].saturating_add_unsigned(size[axis]) <= 0
        });
        if size.contains(&0) || outside {
            let found = format!("{} cells from cell {}", show(&size, axes), show(&min, axes));
            let expected =
                format!("a box that intersects the {} cells of the tree", show(&self.extent, axes));
            return Err(Error::invalid("window", found, expected));
        }
        self.origin += DVec3::from(min.map(|min| min as f64));
        self.extent = size;
        self.add_window();
        self.fitted()
    }

    /// Clips to the extent: nothing outside becomes visible again by later operations.
    fn add_window(&mut self) {
        let to_window = self.to_grid.then(&AffineMap::translation((-self.origin).to_array()));
        self.windows.push((to_window, DVec3::from(self.extent.map(|cells| cells as f64))));
    }

    /// Translates by a number of cells along each axis, which may be fractional. The view's first
    /// cell stays in place: cells that move before it are not visible, and the extent grows or
    /// shrinks at the end. Solids lose nothing: the view then begins with the cell where they
    /// begin.
    ///
    /// # Errors
    /// If nothing remains, or the result exceeds the deepest tree.
    pub fn translate(mut self, by: [f64; 3]) -> Result<View> {
        self.check_axes(&AffineMap::translation(by))?;
        let (mut extent, mut start) = ([1; 3], DVec3::ZERO);
        let is_solid = self.source.header().rule == Rule::Occupancy;
        let most = (1u64 << self.form.dimension.max_depth()) as f64;
        for axis in 0..self.form.axes() {
            if is_solid && by[axis].abs() <= most {
                start[axis] = (by[axis] + TINY).floor().min(0.0);
            }
            let end = (self.extent[axis] as f64 + by[axis] - TINY).ceil() - start[axis];
            if end.is_nan() || end < 1.0 {
                let found = format!("{} cells along axis {axis}", by[axis]);
                return Err(Error::invalid(
                    "translation",
                    found,
                    "a translation that keeps some cells at coordinates of at least 0",
                ));
            }
            extent[axis] = end as u64;
        }
        self.to_grid = self.to_grid.then(&AffineMap::translation(by));
        self.origin += start;
        self.extent = extent;
        self.fitted()
    }

    /// Applies an affine map. The result's extent is the bounding box of the mapped cells; its
    /// first cell is that box's corner.
    ///
    /// # Errors
    /// If the map cannot be inverted, leaves a quadtree's plane, or the result exceeds the deepest
    /// tree.
    pub fn transform(self, map: &AffineMap) -> Result<View> {
        let end = DVec3::from(self.extent.map(|cells| cells as f64));
        let (min, max) = map.bounding_box(DVec3::ZERO, end);
        let (min, max) = ((min + TINY).floor(), (max - TINY).ceil());
        let extent = (max - min).max(DVec3::ONE).to_array().map(|cells| cells as u64);
        self.mapped(map, min, extent)
    }

    /// Maps the view's cells onto a given grid of `extent` cells; cells outside are not visible.
    ///
    /// # Errors
    /// Those of [`View::transform`].
    pub fn onto(self, map: &AffineMap, extent: [u64; 3]) -> Result<View> {
        if extent.contains(&0) {
            let found = show(&extent, self.form.axes());
            return Err(Error::invalid("size of the result", found, "at least one cell"));
        }
        let mut view = self.mapped(map, DVec3::ZERO, extent)?;
        view.add_window();
        view.renewed()
    }

    fn mapped(mut self, map: &AffineMap, min: DVec3, extent: [u64; 3]) -> Result<View> {
        self.check_axes(map)?;
        map.inverse()?;
        let there = AffineMap::translation((-self.origin).to_array()).then(map);
        let and_back = AffineMap::translation(self.origin.to_array());
        self.to_grid = self.to_grid.then(&there).then(&and_back);
        self.origin += min;
        self.extent = extent;
        self.fitted()
    }

    /// Scales by a factor along each axis, which multiplies the number of cells.
    ///
    /// # Errors
    /// Those of [`View::transform`]; factors must be positive.
    pub fn scale(self, by: [f64; 3]) -> Result<View> {
        if !by.iter().all(|factor| *factor > 0.0 && factor.is_finite()) {
            return Err(Error::invalid("scale", format!("{by:?}"), "factors greater than 0"));
        }
        self.transform(&AffineMap::scaling(by))
    }

    /// Resamples to a tree of this depth over the same space: coarser or finer cells, and as many
    /// of them as needed.
    ///
    /// # Errors
    /// Those of [`View::transform`].
    pub fn resample(self, depth: u8) -> Result<View> {
        let factor = 2f64.powi(i32::from(depth) - i32::from(self.depth));
        let axes = self.form.axes();
        let mut view = self.scale(std::array::from_fn(|axis| if axis < axes { factor } else { 1.0 }))?;
        view.depth = view.depth.max(depth);
        view.renewed()
    }

    /// Deeper tree over the same cells, with empty space after the last cell of each axis.
    ///
    /// # Errors
    /// If the view does not fit, or trees cannot have that depth.
    pub fn deepened(mut self, depth: u8) -> Result<View> {
        let (least, most) = (depth_for(self.extent), self.form.dimension.max_depth());
        if depth < least || depth > most {
            let expected = format!("{least} to {most}");
            return Err(Error::invalid("depth", depth.to_string(), expected));
        }
        self.depth = depth;
        self.renewed()
    }

    /// Sets how new cells get their values.
    ///
    /// # Errors
    /// None in practice: any existing view can be sampled in any way.
    pub fn sampled(mut self, sampling: Sampling) -> Result<View> {
        self.sampling = sampling;
        self.renewed()
    }

    /// Whether a window was applied, so that the view may show less than the source has.
    pub(crate) fn has_windows(&self) -> bool {
        !self.windows.is_empty()
    }

    /// Frame of the view. By default cells keep the file's position in the world, regardless of
    /// their arrangement. With `moves`, they are moved in the world as in the tree.
    pub fn frame(&self, moves: bool) -> Frame {
        let source = &self.source.metadata().frame;
        let world = AffineMap::from_rows(source.matrix);
        let mut frame = Frame { matrix: self.placed_cells(moves).then(&world).to_rows(), ..source.clone() };
        if let Some((_, factor)) = &self.unit {
            frame.matrix = frame.matrix.map(|row| row.map(|number| number * factor));
        }
        if let Some(crs) = &self.crs {
            frame.crs = Some((**crs).clone());
        }
        frame
    }

    /// View whose cells are in this coordinate system, overriding the source's.
    pub(crate) fn in_system(self, crs: Crs) -> View {
        View { crs: Some(Arc::new(crs)), ..self }
    }

    /// View of an octree in another unit of length, to which its world coordinates are converted.
    /// Without a unit in the source, coordinates stay the same.
    ///
    /// # Errors
    /// If the view is a quadtree, the unit is unknown, or the coordinate system defines the unit.
    pub(crate) fn in_unit(self, unit: &str) -> Result<View> {
        let length = |unit: &str| Unit::parse(unit).and_then(Unit::metres);
        let Some(metres) = length(unit) else {
            return Err(Error::invalid("unit", unit, "a unit of length, such as mm, cm, m, km, in or ft"));
        };
        let is_octree = self.form.axes() == 3;
        let crs = self.crs.as_deref().or(self.source.metadata().frame.crs.as_ref());
        let found = match crs {
            Some(crs) if is_octree => format!("cells in {crs}, which defines their unit"),
            None if !is_octree => "a quadtree".to_string(),
            Some(_) => "a quadtree with a coordinate system".to_string(),
            None => {
                let own = self.source.metadata().tag(Tag::Unit).and_then(length);
                let factor = own.map_or(1.0, |own| own / metres);
                return Ok(View { unit: Some((unit.into(), factor)), ..self });
            }
        };
        Err(Error::invalid("unit", found, "an octree without a coordinate system"))
    }

    /// Sets how grids in other coordinate systems get their values.
    #[must_use]
    pub(crate) fn warping(self, warp: WarpOptions) -> View {
        View { warp, ..self }
    }

    /// Sets the resampling for later operations, if one is given.
    #[must_use]
    pub(in crate::ops) fn resampling(self, resampling: Option<Resampling>) -> View {
        let resampling = resampling.or(self.warp.resampling);
        View { warp: WarpOptions { resampling, ..self.warp }, ..self }
    }

    /// Options for operations with a grid in another coordinate system.
    pub(in crate::ops) fn warp(&self) -> WarpOptions {
        self.warp
    }

    /// How new cells get their values.
    pub(in crate::ops) fn sampling(&self) -> Sampling {
        self.sampling
    }

    /// Whether datums may be treated as WGS 84: see [`WarpOptions::allow_ballpark`].
    pub(in crate::ops) fn allows_ballpark(&self) -> bool {
        self.warp.allow_ballpark
    }

    /// Whether the view's cells are those of its source, all of them: no operation has moved or
    /// omitted cells.
    pub(in crate::ops) fn has_its_cells(&self) -> bool {
        self.to_grid == AffineMap::IDENTITY
            && self.origin == DVec3::ZERO
            && self.windows.is_empty()
            && self.extent == self.source.header().extent
    }

    /// The view resampled to a grid in another coordinate system, as a source of its own. The view
    /// must have its file's cells.
    ///
    /// # Errors
    /// If an operation has moved or omitted cells; else those of [`Warped::new`].
    pub fn warped(self, grid: &WarpGrid) -> Result<View> {
        if !self.has_its_cells() {
            let expected = "this operation first (after crs= at most); others apply to its result";
            return Err(Error::invalid(
                "operation that changes the grid or coordinate system",
                "other operations before it",
                expected,
            ));
        }
        let warped = Warped::new(self.source.clone(), &self.frame(false), grid, &self.warp)?;
        let view = View::new(Arc::new(warped.into()), grid.extent)?;
        Ok(View { warp: self.warp, ..view })
    }

    /// Metadata of the source with the view's frame, and its control points at the view's cells.
    pub fn metadata(&self, moves: bool) -> Metadata {
        let source = self.source.metadata();
        let cells = Frame { matrix: self.placed_cells(moves).to_rows(), ..Frame::identity() };
        let points = source.control_points.as_ref();
        let mut metadata = Metadata {
            frame: self.frame(moves),
            control_points: points.and_then(|points| points.seen_through(&cells)),
            ..source.clone()
        };
        if let Some((unit, _)) = &self.unit {
            metadata.set_tag(Tag::Unit, unit.to_string());
        }
        metadata
    }

    /// Whether the view shows its whole source unchanged.
    pub(crate) fn is_whole(&self) -> bool {
        let is_same = self.lookup.to_source == AffineMap::IDENTITY && self.depth == self.source.depth();
        is_same
            && self.extent == self.source_extent
            && self.windows.is_empty()
            && self.crs.is_none()
            && self.unit.is_none()
    }

    /// The file, if the view shows all of it unchanged.
    pub(in crate::ops) fn as_file(&self) -> Option<&TreeFile> {
        match &*self.source {
            ViewSource::File(file) if self.is_whole() => Some(file),
            _ => None,
        }
    }

    /// Whether each cell of the view lies within the source's extent.
    pub(crate) fn shows_all(&self) -> bool {
        let Lookup { to_source, visible, shown, askew, .. } = &self.lookup;
        let size = DVec3::from(self.extent.map(|cells| cells as f64));
        let (low, high) = to_source.bounding_box(DVec3::ZERO, size);
        let is_inside = |axis: usize| {
            let (start, end) = (visible.0[axis] as f64, visible.1[axis] as f64);
            let all = shown.0[axis] <= 0.0 && shown.1[axis] >= size[axis];
            all && low[axis] >= start - TINY && high[axis] <= end + TINY
        };
        askew.is_empty() && (0..self.form.axes()).all(is_inside)
    }

    /// Map from the view's cells to the source's cells at the same position in the world.
    fn placed_cells(&self, moves: bool) -> AffineMap {
        if moves { AffineMap::translation(self.origin.to_array()) } else { self.lookup.to_source }
    }

    fn check_axes(&self, map: &AffineMap) -> Result<()> {
        let rows = map.to_rows();
        let stays = self.form.axes() > 2 || map.is_planar();
        let finite = rows.iter().flatten().all(|number| number.is_finite());
        if stays && finite {
            return Ok(());
        }
        let expected = if finite { "a map that keeps z unchanged, for a quadtree" } else { "finite numbers" };
        Err(Error::invalid("affine map", format!("{rows:?}"), expected))
    }

    /// Sets the minimum depth for the extent.
    fn fitted(mut self) -> Result<View> {
        let depth = depth_for(self.extent);
        let most = self.form.dimension.max_depth();
        if depth > most {
            let found = format!("{} cells", show(&self.extent, self.form.axes()));
            let expected = format!("at most {} along each axis", 1u64 << most);
            return Err(Error::invalid("size of the result", found, expected));
        }
        self.depth = depth;
        self.renewed()
    }

    /// Recomputes the lookup from the operations.
    fn renewed(mut self) -> Result<View> {
        // Windows limit the visible source cells where they consist of whole source cells, else the
        // view's cells that may have values. Windows that are aligned with neither are tested cell
        // by cell.
        let to_source = self.to_grid.then(&AffineMap::translation((-self.origin).to_array())).inverse()?;
        let source_end = DVec3::from(self.source_extent.map(|cells| cells as f64));
        let mut visible = (DVec3::ZERO, source_end);
        let mut shown = (DVec3::ZERO, DVec3::from(self.extent.map(|cells| cells as f64)));
        let mut askew = Vec::new();
        let is_area = matches!(self.sampling, Sampling::Area(rule) if rule != Rule::Nearest);
        let is_coverage = self.sampling == Sampling::Area(Rule::Occupancy);
        // (Of a cell of a solid, a window may hide a part.)
        let is_aligned = |here: &AffineMap| !is_coverage || here.is_near_cells();
        let mut is_turned = !to_source.keeps_axes();
        for (map, size) in &self.windows {
            let here = to_source.then(map);
            if map.keeps_cells() {
                let (start, end) = map.inverse()?.bounding_box(DVec3::ZERO, *size);
                visible = (visible.0.max(start.round()), visible.1.min(end.round()).max(visible.0));
            } else if here.is_translation() && is_aligned(&here) {
                let start = (-here.0.translation).round();
                shown = (shown.0.max(start), shown.1.min(start + size));
            } else {
                is_turned |= !here.keeps_axes();
                askew.push((here, *size));
            }
        }
        let image = to_source.inverse()?.bounding_box(visible.0, visible.1);
        let whole = |point: DVec3| point.to_array().map(|number| number as i64);
        let moves = to_source.is_translation() && to_source.keeps_cells();
        let moved = moves.then(|| {
            let by = to_source.0.translation;
            let visible = (whole(visible.0.max(shown.0 + by)), whole(visible.1.min(shown.1 + by)));
            Moved { by: whole(by), visible, extent: self.source_extent }
        });
        let is_averaged = to_source.keeps_axes() && !to_source.keeps_cells() && !to_source.divides_cells();
        let by_area = is_area && (is_averaged || is_coverage && (is_turned || !askew.is_empty()));
        self.lookup = Lookup {
            to_source,
            by_area,
            is_coverage: by_area && is_coverage,
            is_turned: by_area && is_turned,
            visible: (whole(visible.0), whole(visible.1)),
            moved,
            content: ((image.0 + TINY).floor(), (image.1 - TINY).ceil()),
            shown,
            askew,
        };
        Ok(self)
    }
}

/// Numbers of cells along each axis, for messages.
fn show<T: ToString>(numbers: &[T; 3], axes: usize) -> String {
    numbers[..axes].iter().map(T::to_string).collect::<Vec<_>>().join(" x ")
}
