//! Regions of trees: boxes of cells, or in coordinates.

use serde::Deserialize;
use spinney_base::space::Bounds;
use spinney_base::{Error, Result};
use spinney_crs::{CellLocator, Coordinates};
use spinney_engine::dataset::Dataset;

/// A region of a tree, by default all of it.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Region {
    /// Cells of the deepest level: first ones, and exclusive ends.
    pub(crate) cells: Option<Vec<f64>>,
    /// Minimum and maximum coordinates.
    pub(crate) bounds: Option<Vec<f64>>,
    /// Coordinate system of the bounds, by default the tree's own.
    pub(crate) crs: Option<String>,
}

/// Parses coordinates, by default the tree's own.
pub(crate) fn coordinates(text: Option<&str>) -> Result<Coordinates> {
    text.map_or(Ok(Coordinates::World), str::parse)
}

/// Returns the locator from coordinates to a tree's cells.
pub(crate) fn cell_locator(tree: &Dataset, crs: Option<&str>) -> Result<CellLocator> {
    CellLocator::new(&coordinates(crs)?, &tree.metadata().frame, tree.header().extent)
}

impl Region {
    /// Returns the region's boxes of cells: one, or two on both sides of the tree's seam; `None` is
    /// the whole raster.
    ///
    /// # Errors
    /// If the numbers do not form a box, or it lies outside of the tree.
    pub(crate) fn boxes(&self, tree: &Dataset) -> Result<Option<Vec<Bounds>>> {
        let axes = tree.header().form.axes();
        match (&self.cells, &self.bounds) {
            (None, None) => Ok(None),
            (Some(cells), None) => cell_box(cells, axes, tree.header().extent).map(|found| Some(vec![found])),
            (None, Some(bounds)) => {
                let [low, high] = corners(bounds, axes)?;
                let locator = cell_locator(tree, self.crs.as_deref())?;
                let boxes = locator.boxes(low, high)?;
                if boxes.is_empty() {
                    let expected =
                        format!("a box that intersects the tree, which is {}", locator.bounds_text());
                    return Err(Error::invalid("bounds", format!("{bounds:?}"), expected));
                }
                Ok(Some(boxes))
            }
            (Some(_), Some(_)) => Err(Error::invalid("region", "both cells and bounds", "one of the two")),
        }
    }

    /// Returns the region's only box of cells, by default the whole raster.
    ///
    /// # Errors
    /// Those of [`Region::boxes`]; also if there are two.
    pub(crate) fn one_box(&self, tree: &Dataset) -> Result<Bounds> {
        match self.boxes(tree)?.as_deref() {
            None => Ok(tree.header().extent_bounds()),
            Some([one]) => Ok(*one),
            Some(_) => {
                let expected = "a region on one side of it; query both sides separately";
                Err(Error::invalid("bounds", "a region across the tree's seam", expected))
            }
        }
    }
}

/// Returns the minimum and maximum coordinates of a box along two or three axes.
fn corners(numbers: &[f64], axes: usize) -> Result<[[f64; 3]; 2]> {
    match *numbers {
        [a, b, c, d] => Ok([[a, b, f64::NEG_INFINITY], [c, d, f64::INFINITY]]),
        [a, b, c, d, e, f] if axes == 3 => Ok([[a, b, c], [d, e, f]]),
        _ => Err(Error::invalid("bounds", format!("{} numbers", numbers.len()), numbers_of(axes))),
    }
}

fn numbers_of(axes: usize) -> &'static str {
    if axes == 3 {
        "6 numbers: minimum x, y, z, then maximum x, y, z (or 4 without z)"
    } else {
        "4 numbers: minimum x, y, then maximum x, y"
    }
}

/// Returns a box of cells, which may extend beyond the raster.
fn cell_box(numbers: &[f64], axes: usize, extent: [u64; 3]) -> Result<Bounds> {
    /// Maximum number of cells along an axis, with a margin.
    const MAX_CELL: f64 = (1u64 << 32) as f64;
    let wrong = |found: String, expected: &str| Err(Error::invalid("cells", found, expected));
    if !(numbers.len() == 4 || numbers.len() == 6 && axes == 3) {
        return wrong(format!("{} numbers", numbers.len()), numbers_of(axes));
    }
    if !numbers.iter().all(|number| number.fract() == 0.0 && (0.0..MAX_CELL).contains(number)) {
        return wrong(format!("{numbers:?}"), "non-negative integers");
    }
    let along = numbers.len() / 2;
    let mut bounds = Bounds::of_extent(extent);
    for axis in 0..along {
        (bounds.min[axis], bounds.max[axis]) = (numbers[axis] as u64, numbers[along + axis] as u64);
    }
    if bounds.is_empty() {
        return wrong(format!("{numbers:?}"), "first cells below the exclusive ends");
    }
    Ok(bounds)
}
