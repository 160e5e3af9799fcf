//! Polygons of the classes of a dataset.

use super::Dataset;
use crate::query::{
    ClassCells, ClassGrid, PolygonRequest, PolygonSummary, RegionVisitor, check_level, find_regions,
};
use crate::tree::Child;
use spinney_base::space::{Bounds, Code};
use spinney_base::value::DataKind;
use spinney_base::{Error, Progress, Result};

impl Dataset {
    /// Passes the regions of a categorical quadtree to `each` as polygons, at any level of detail.
    /// A region is a set of cells of one class that are connected by their edges, or also by their
    /// corners. VOID cells are in no region, and every other cell is in exactly one.
    ///
    /// Borders follow the cell edges, without collinear points. Rings are simple: where a region
    /// touches itself in a corner, an outer ring and a hole touch there, or two holes. Outer rings
    /// are counterclockwise, holes clockwise. A region of cells that are connected only by corners
    /// has several polygons, which touch there. If borders are
    /// [simplified](PolygonRequest::simplify), adjacent regions still share the same border: each
    /// arc between two junctions (points where three or four borders meet) is simplified once.
    /// Junctions and the corners of the raster do not move.
    ///
    /// Skips the interior of uniform nodes, and rows that equal the row above them. The order of
    /// the regions depends only on the tree: they are sorted by the row, from the first on, in
    /// which they end. Memory use is `request.memory` plus memory in proportion to the borders that
    /// cross a row of the raster, plus about 150 bytes per arc of a region that is not complete
    /// yet.
    ///
    /// ```
    /// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
    /// use spinney::query::PolygonRequest;
    ///
    /// let map = spinney::open("fixtures/v1/classes.goblin")?;
    /// let mut cells = 0;
    /// let found = map.polygons(&PolygonRequest::new(), &(), &mut |region| {
    ///     cells += region.cells();
    ///     Ok(())
    /// })?;
    /// assert_eq!(cells, map.statistics(None, &())?.cells);
    /// assert!(found.rings >= found.count);
    /// # Ok::<(), spinney::Error>(())
    /// ```
    ///
    /// # Errors
    /// If the tree is an octree, not categorical or corrupt, the level does not exist, a class or a
    /// distance is invalid, a temporary file cannot be written, `each` fails, or on cancellation.
    pub fn polygons(
        &self,
        request: &PolygonRequest,
        progress: &dyn Progress,
        each: &mut RegionVisitor<'_>,
    ) -> Result<PolygonSummary> {
        self.check_polygons()?;
        let level = request.level.unwrap_or(self.depth());
        check_level(level, self.depth())?;
        let [columns, rows, _] = self.extent_at(level).max;
        let cells = LevelClasses { tree: self, level };
        let value = self.header().form.value;
        let mut grid = ClassGrid {
            cells: &cells,
            level,
            size: [columns, rows],
            frame: self.metadata().frame.coarser(self.depth() - level),
            value,
            width: value.size(),
            classes: None,
        };
        let summary = find_regions(&mut grid, request, progress, each)?;
        self.check_unchanged()?;
        Ok(summary)
    }

    /// Rejects a tree whose regions are not polygons.
    ///
    /// # Errors
    /// If it is an octree, has several channels, or is not categorical.
    fn check_polygons(&self) -> Result<()> {
        let (form, tree) = (self.header().form, self.name().display());
        let refuse = |found: &str, advice: String| Err(Error::unsupported(self.name(), found, advice));
        if form.axes() != 2 {
            let advice = format!(
                "export the surface: `spinney export {tree} surface.ply`. Or build a quadtree from a slice, such as z = 0: \
                 `spinney get {tree} layer.tif --slice z=0`, `spinney build layer.tif --kind categorical -o layer.goblin`"
            );
            return refuse("polygons of an octree", advice);
        }
        if form.value.channels != 1 {
            let sum = (1..=form.value.channels).map(|channel| {
                let factor = 256u64.pow(u32::from(form.value.channels - channel));
                if factor == 1 { format!("b{channel}") } else { format!("b{channel}*{factor}") }
            });
            let sum = sum.collect::<Vec<_>>().join("+");
            let sample = if form.value.channels == 4 { "i64" } else { "i32" };
            let advice = format!(
                "combine the channels to one class number per cell: `spinney transform {tree} 'calc={sum},type={sample}' -o number.goblin`, \
                 `spinney build number.goblin --kind categorical -o classes.goblin`"
            );
            return refuse("polygons of several channels", advice);
        }
        if self.header().kind != DataKind::Categorical {
            let bounds = self.value_bounds()?;
            let middle = bounds.first().map_or(0.0, |(low, high)| (low + high) / 2.0);
            let advice = format!(
                "export the areas above a value: `spinney contours {tree} --at {middle} --filled -o areas.gpkg`. If the values are classes: \
                 `spinney build {tree} --kind categorical -o classes.goblin`"
            );
            return refuse("polygons of a tree of continuous values", advice);
        }
        Ok(())
    }
}

/// The cells of one level.
struct LevelClasses<'a> {
    tree: &'a Dataset,
    level: u8,
}

impl ClassCells for LevelClasses<'_> {
    fn node(&self, code: Code) -> Result<Child<()>> {
        self.tree.node(code)
    }

    fn window(&self, bounds: &Bounds) -> Result<(Vec<u8>, Vec<bool>)> {
        let cells = bounds.volume() as usize;
        let mut bytes = vec![0; cells * self.tree.header().form.value.size()];
        let mut valid = vec![false; cells];
        self.tree.window(self.level, bounds, 0.0, &mut bytes, Some(&mut valid))?;
        Ok((bytes, valid))
    }
}
