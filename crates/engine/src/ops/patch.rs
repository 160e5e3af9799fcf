//! Changes to regions of a tree: boxes, polygons, nodes, single cells.

use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code, Cover};
use spinney_base::value::Value;
use spinney_base::{Error, Result, sort};
use spinney_overlay::Polygon;

/// Effect of a patch on a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// No effect.
    Keep,
    /// The whole node becomes one value, or VOID.
    Uniform(Option<Value>),
    /// The effect differs between children. Never returned for a single cell.
    Split,
}

/// Changes to a tree.
pub trait Patch: Send + Sync {
    /// Effect on a node whose cells are `bounds`.
    fn change(&self, code: Code, bounds: &Bounds) -> Change;
}

/// Cell coordinates and value; `None` is VOID.
type NewCell = ([u64; 3], Option<Value>);

/// Single cells with new values.
#[derive(Clone, Debug)]
pub struct CellPatch {
    depth: u8,
    /// In FD order, each cell once.
    cells: Vec<(Code, Option<Value>)>,
}

impl CellPatch {
    /// Patch of the cells of a tree of this type, depth and extent, with new values (`None` is
    /// VOID), in any order. The last value of a cell wins.
    ///
    /// # Errors
    /// If a cell is outside the extent.
    pub fn new(form: TreeType, depth: u8, extent: [u64; 3], cells: Vec<NewCell>) -> Result<CellPatch> {
        let code = |cell: [u64; 3]| {
            let inside = (0..3).all(|axis| cell[axis] < extent[axis]);
            let code = inside
                .then(|| Code::from_cell(form.dimension, depth, cell.map(|coordinate| coordinate as u32)))
                .flatten();
            code.ok_or_else(|| {
                let (cell, extent) = (&cell[..form.axes()], &extent[..form.axes()]);
                let expected = format!("a cell of an extent of {extent:?} cells, counted from 0");
                Error::invalid("cell", format!("{cell:?}"), expected)
            })
        };
        let present = |value: Option<Value>| value.filter(|value| !form.value.is_nan(*value));
        let cells = cells.into_iter().map(|(cell, value)| Ok((code(cell)?, present(value))));
        let mut cells = cells.collect::<Result<Vec<_>>>()?;
        // (The sort is stable: the last value of a cell stays last.)
        sort::by_key(&mut cells, |(code, _)| code.bits());
        let mut last = 0;
        for next in 0..cells.len() {
            if cells[next].0 != cells[last].0 {
                last += 1;
            }
            cells[last] = cells[next];
        }
        cells.truncate(last + 1);
        Ok(CellPatch { depth, cells })
    }
}

impl Patch for CellPatch {
    fn change(&self, code: Code, _: &Bounds) -> Change {
        // In preorder, a node's code sorts before those of all cells below it, and after those of
        // all earlier cells. So either the first cell that is not before the node is in it, or none
        // is.
        let first = self.cells.partition_point(|(cell, _)| cell.bits() < code.bits());
        match self.cells.get(first) {
            Some((cell, value)) if code.contains(*cell) => {
                if code.level() == self.depth {
                    Change::Uniform(*value)
                } else {
                    Change::Split
                }
            }
            _ => Change::Keep,
        }
    }
}

/// Region that is filled with one value, or made VOID.
#[derive(Clone, Debug)]
pub struct FillPatch {
    region: FillRegion,
    /// Cells outside of this box do not change.
    within: Bounds,
    value: Option<Value>,
}

/// Region of cells to fill.
#[derive(Clone, Debug, PartialEq)]
pub enum FillRegion {
    /// A box of cells.
    Box(Bounds),
    /// All cells whose centre, projected along z, is inside a polygon.
    Polygon(Polygon),
}

impl FillRegion {
    /// Whether the region intersects a tree's extent.
    fn reaches(&self, extent: [u64; 3]) -> bool {
        match self {
            FillRegion::Box(region) => !region.intersect(&Bounds::of_extent(extent)).is_empty(),
            FillRegion::Polygon(polygon) => {
                let [low, high] = polygon.corners();
                (0..2).all(|axis| low[axis] < extent[axis] as f64 && high[axis] > 0.0)
            }
        }
    }
}

impl FillPatch {
    /// Fills the intersection of a region with a tree's extent.
    ///
    /// # Errors
    /// If the intersection is empty.
    pub fn new(region: FillRegion, extent: [u64; 3], value: Option<Value>) -> Result<FillPatch> {
        if !region.reaches(extent) {
            let [x, y, z] = extent;
            let z = if z > 1 { format!(" x {z}") } else { String::new() };
            let expected = format!("a region that overlaps its {x} x {y}{z} cells");
            return Err(Error::invalid("region to fill", "a region outside of the tree", expected));
        }
        Ok(FillPatch { region, within: Bounds::of_extent(extent), value })
    }
}

impl Patch for FillPatch {
    fn change(&self, _: Code, bounds: &Bounds) -> Change {
        if bounds.intersect(&self.within).is_empty() {
            return Change::Keep;
        }
        let inside = match &self.region {
            FillRegion::Box(region) if region.contains(bounds) => Some(true),
            FillRegion::Box(region) if region.intersect(bounds).is_empty() => Some(false),
            FillRegion::Box(_) => None,
            FillRegion::Polygon(polygon) => match polygon.cover_centres(bounds) {
                Cover::Whole => Some(true),
                Cover::Nothing => Some(false),
                Cover::Partial => None,
            },
        };
        match inside {
            Some(false) => Change::Keep,
            Some(true) if self.within.contains(bounds) => Change::Uniform(self.value),
            _ => Change::Split,
        }
    }
}
