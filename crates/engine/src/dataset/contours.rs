//! Contour lines and contour bands of a dataset.

use super::{Dataset, Tree};
use crate::query::{
    ContourGround, ContourRequest, ContourSummary, ContourVisitor, Extremes, Relief, check_level,
    file_extremes, source_extremes, trace_contours,
};
use crate::tree::Child;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{DataKind, Rule};
use spinney_base::{Error, Progress, Result};

impl Dataset {
    /// Traces the contour lines of a quadtree's first channel, at any level of detail, and passes
    /// each to `each`. Values are interpolated linearly between the centres of adjacent cells.
    ///
    /// Higher values are to the right of a line, seen in the world with y pointing up. A value
    /// equal to a contour level counts as above it. In a saddle of four cells, the mean of the four
    /// values decides. At the border of the raster, lines extend to the outer edge of the cells;
    /// [`ContourEnds`](crate::query::ContourEnds) says what they do next to VOID cells. Lines of
    /// one contour level never touch, because they keep a distance of a millionth of a cell from
    /// cell centres. Each line is passed as a whole, and a closed line ends at its first point.
    ///
    /// Uses all threads of the current pool and reads only where [statistics](Dataset::statistics)
    /// cannot exclude a line. The order of the lines depends only on the tree. Memory use is
    /// `request.memory` plus memory in proportion to the lines that cross a row of the raster.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::query::{ContourLevels, ContourRequest};
    ///
    /// let map = spinney::open("fixtures/v1/elevation.goblin")?;
    /// let request = ContourRequest::new(ContourLevels::At(vec![300.0]));
    /// let mut length = 0.0;
    /// let found = map.contours(&request, &(), &mut |line| {
    ///     let mut last: Option<[f64; 3]> = None;
    ///     line.points(0, &mut |points| {
    ///         for point in points {
    ///             let from = last.replace(*point).unwrap_or(*point);
    ///             length += (point[0] - from[0]).hypot(point[1] - from[1]);
    ///         }
    ///         Ok(())
    ///     })
    /// })?;
    /// assert!(found.count > 0 && length > 0.0);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the tree is an octree, is categorical or corrupt, the tree level does not exist, there
    /// are no contour levels or they are far too close, a temporary file cannot be written, `each`
    /// fails, or on cancellation.
    pub fn contours(
        &self,
        request: &ContourRequest,
        progress: &dyn Progress,
        each: &mut ContourVisitor<'_>,
    ) -> Result<ContourSummary> {
        self.trace(request, false, progress, each)
    }

    /// Traces the areas between consecutive contour levels and passes each to `each`, as a polygon
    /// with holes. The polygons are bounded by the lines of [`Dataset::contours`]. Together they
    /// cover all cells that are not VOID, each exactly once. Outer rings are counterclockwise,
    /// holes clockwise. The ranges below the first of [explicit
    /// levels](crate::query::ContourLevels::At) and above the last are bands, too; they end at the
    /// tree's minimum and maximum.
    ///
    /// A polygon is kept, in memory or in the temporary file, until it is complete. Memory use is
    /// `request.memory` plus about 200 bytes per hole whose outer ring is not known yet. In rasters
    /// of noise there are as many such holes as cells.
    ///
    /// # Errors
    /// Those of [`Dataset::contours`].
    pub fn contour_bands(
        &self,
        request: &ContourRequest,
        progress: &dyn Progress,
        each: &mut ContourVisitor<'_>,
    ) -> Result<ContourSummary> {
        self.trace(request, true, progress, each)
    }

    fn trace(
        &self,
        request: &ContourRequest,
        is_bands: bool,
        progress: &dyn Progress,
        each: &mut ContourVisitor<'_>,
    ) -> Result<ContourSummary> {
        if self.header().form.axes() != 2 {
            let advice =
                "export isosurfaces: `spinney contours` with -o surface.ply (in Python: export_isosurfaces)";
            return Err(Error::unsupported(self.name(), "contours of an octree", advice));
        }
        self.check_continuous("contours")?;
        let level = request.level.unwrap_or(self.depth());
        check_level(level, self.depth())?;
        let relief = self.relief(level);
        let [columns, rows, _] = self.extent_at(level).max;
        let bounds = self.value_bounds()?.first().copied().unwrap_or((0.0, 0.0));
        let ground = ContourGround {
            relief: &relief,
            level,
            size: [columns, rows],
            frame: self.metadata().frame.coarser(self.depth() - level),
            values: if relief.has_zeros { (bounds.0.min(0.0), bounds.1.max(0.0)) } else { bounds },
        };
        let summary = trace_contours(&ground, request, is_bands, progress, each)?;
        self.check_unchanged()?;
        Ok(summary)
    }

    /// Rejects a categorical tree: class numbers have no order, so nothing lies between two of
    /// them.
    ///
    /// # Errors
    /// If the tree is categorical.
    pub fn check_continuous(&self, what: &str) -> Result<()> {
        if self.header().kind != DataKind::Categorical {
            return Ok(());
        }
        let tree = self.name().display();
        let advice = if self.header().form.axes() == 2 {
            format!(
                "class numbers have no order. Areas of classes: `spinney stats {tree}`; blocks of one class: `spinney find {tree} --class N`; \
                 polygons: `spinney export {tree} regions.gpkg --polygons`. If the values are continuous: `spinney build {tree} --kind \
                 continuous -o CONTINUOUS.goblin`"
            )
        } else {
            format!(
                "class numbers have no order. Surface of all cells that are not VOID: `spinney export {tree} surface.ply`. If the \
                 values are continuous: `spinney build {tree} --kind continuous -o CONTINUOUS.goblin`"
            )
        };
        Err(Error::unsupported(self.name(), format!("{what} of a categorical tree"), advice))
    }

    /// Returns the cells of a level, which must exist.
    pub fn relief(&self, level: u8) -> LevelRelief<'_> {
        LevelRelief { tree: self, level, has_zeros: self.header().rule == Rule::Occupancy }
    }
}

/// The cells of one level.
pub struct LevelRelief<'a> {
    tree: &'a Dataset,
    level: u8,
    /// Whether VOID counts as the number 0, as in trees of occupancies.
    pub has_zeros: bool,
}

impl Relief for LevelRelief<'_> {
    fn node(&self, code: Code) -> Result<Child<()>> {
        self.tree.node(code)
    }

    fn extremes(&self, code: Code) -> Result<Extremes> {
        let extent = self.tree.header().extent_bounds();
        let extremes = match &self.tree.tree {
            Tree::Goblin(file) => file_extremes(file, code),
            Tree::Autumnal(file) => source_extremes(&**file, &extent, code),
            Tree::View(viewed) => source_extremes(viewed.view(), &extent, code),
        }?;
        Ok(if self.has_zeros { extremes.with_zeros() } else { extremes })
    }

    fn numbers(&self, bounds: &Bounds) -> Result<Vec<f64>> {
        let value = self.tree.header().form.value;
        let cells = bounds.volume() as usize;
        let (mut bytes, mut valid) = (vec![0; cells * value.size()], vec![false; cells]);
        self.tree.window(self.level, bounds, 0.0, &mut bytes, Some(&mut valid))?;
        let mut numbers = Vec::with_capacity(cells);
        value.push_numbers(0, &bytes, &mut numbers);
        if !self.has_zeros {
            let void = numbers.iter_mut().zip(&valid).filter(|(_, valid)| !**valid);
            void.for_each(|(number, _)| *number = f64::NAN);
        }
        Ok(numbers)
    }
}
