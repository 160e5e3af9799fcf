//! Contour lines and bands of any dataset.

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
    /// Hands out the contour lines of a quadtree's first channel, at any level of detail: where values that go straight from one cell's
    /// centre to the next are equal to one of some levels.
    ///
    /// Higher values are to the right of a line, as seen in the world with y going up. A value that equals a level counts as above it; four
    /// cells that make a saddle, by their mean. At the edge of the picture lines go on to the edge of its cells;
    /// [`ContourEnds`](crate::query::ContourEnds) says what they do where VOID cells are near. Lines of a level never touch: they stay a
    /// millionth of a cell away from the centres of cells. Lines are whole, and closed ones end at their first point.
    ///
    /// Reads only where [statistics](Dataset::statistics) cannot exclude a line, on all threads of the current pool. The order of the lines
    /// depends on the tree alone. Besides `request.memory`, memory goes with the lines that cross a row of the picture.
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
    /// If the tree is an octree, or of classes, or damaged, there is no such level, the contours' levels are none or far too close, a temporary file
    /// cannot be written, `each` fails, or on interruption.
    pub fn contours(
        &self,
        request: &ContourRequest,
        progress: &dyn Progress,
        each: &mut ContourVisitor<'_>,
    ) -> Result<ContourSummary> {
        self.trace(request, false, progress, each)
    }

    /// Hands out the areas between neighbouring levels as polygons with holes: as [`Dataset::contours`], whose lines are their borders. All
    /// polygons together cover the cells that are not VOID, each of these once. Outer rings are counterclockwise, holes
    /// clockwise. What is below the first of [some values](crate::query::ContourLevels::At) or above the last is a band, too, and ends at the
    /// tree's least or greatest value.
    ///
    /// A polygon is held, or in the temporary file, until all of it has been found. Besides `request.memory`, memory goes with the number
    /// of holes that wait for the ring around them: about 200 bytes for each, which in rasters of noise are as many as cells.
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
            let advice = "it has isosurfaces: `spinney contours` with -o surface.ply, or export_isosurfaces";
            return Err(Error::unsupported(self.name(), "contours of an octree", advice));
        }
        self.check_amounts("contours")?;
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

    /// Refuses a tree of classes, between which there is nothing that could be equal to a level.
    ///
    /// # Errors
    /// If it is one.
    pub fn check_amounts(&self, what: &str) -> Result<()> {
        if self.header().kind != DataKind::Categorical {
            return Ok(());
        }
        let tree = self.name().display();
        let advice = if self.header().form.axes() == 2 {
            format!(
                "numbers of classes have no order. Areas of classes: `spinney stats {tree}`; blocks of one: `spinney find {tree} --class N`; \
                 polygons: `spinney export {tree} regions.gpkg --polygons`. If the values are amounts: `spinney build {tree} --kind \
                 continuous -o AMOUNTS.goblin`"
            )
        } else {
            format!(
                "numbers of classes have no order. The surface of all cells that are not VOID: `spinney export {tree} surface.ply`. If the \
                 values are amounts: `spinney build {tree} --kind continuous -o AMOUNTS.goblin`"
            )
        };
        Err(Error::unsupported(self.name(), format!("{what} of a tree of classes"), advice))
    }

    /// The cells of a level, which there must be.
    pub fn relief(&self, level: u8) -> LevelRelief<'_> {
        LevelRelief { tree: self, level, has_zeros: self.header().rule == Rule::Occupancy }
    }
}

/// The cells of a level.
pub struct LevelRelief<'a> {
    tree: &'a Dataset,
    level: u8,
    /// Whether VOID is a number: that of nothing.
    pub has_zeros: bool,
}

impl Relief for LevelRelief<'_> {
    fn node(&self, code: Code) -> Result<Child<()>> {
        self.tree.node(code)
    }

    fn extremes(&self, code: Code) -> Result<Extremes> {
        let picture = self.tree.header().picture();
        let extremes = match &self.tree.tree {
            Tree::Goblin(file) => file_extremes(file, code),
            Tree::Autumnal(file) => source_extremes(&**file, &picture, code),
            Tree::View(viewed) => source_extremes(viewed.view(), &picture, code),
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
