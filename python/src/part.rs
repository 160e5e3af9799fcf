//! Parts of trees as Python programs give them: windows of cells, boxes of the world.

use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use spinney::dataset::Dataset;
use spinney::space::Bounds;

use crate::error::invalid;

/// The cells of the deepest level that a window or a box of the world means; `None` if neither is given.
pub(crate) fn part_of(
    tree: &Dataset,
    window: Option<&Bound<'_, PyAny>>,
    bbox: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<Bounds>> {
    match (window, bbox) {
        (None, None) => Ok(None),
        (Some(window), None) => window_cells(tree, window).map(Some),
        (None, Some(bbox)) => box_cells(tree, bbox).map(Some),
        (Some(_), Some(_)) => Err(invalid("window and bbox: give one of them")),
    }
}

/// First cell and size along x, y and z.
type Corner = ([f64; 3], [f64; 3]);

/// Reads a window: column, row, width and height (of octrees x, y, z and three lengths), a pair of ranges of rows and
/// columns, or an object that has them, as those of rasterio.
fn corner_of(tree: &Dataset, window: &Bound<'_, PyAny>) -> PyResult<Corner> {
    let depth = tree.header().extent[2] as f64;
    let is_octree = tree.header().form.axes() == 3;
    if let Ok([x, y, width, height]) = window.extract::<[f64; 4]>() {
        return Ok(([x, y, 0.0], [width, height, depth]));
    }
    if let Ok([x, y, z, width, height, depth]) = window.extract::<[f64; 6]>() {
        if !is_octree {
            return Err(invalid("window: six numbers are for octrees; give column, row, width, height"));
        }
        return Ok(([x, y, z], [width, height, depth]));
    }
    if let Ok([[top, bottom], [left, right]]) = window.extract::<[[f64; 2]; 2]>() {
        return Ok(([left, top, 0.0], [right - left, bottom - top, depth]));
    }
    let named = |name: &str| window.getattr(name).and_then(|number| number.extract::<f64>());
    match (named("col_off"), named("row_off"), named("width"), named("height")) {
        (Ok(x), Ok(y), Ok(width), Ok(height)) => Ok(([x, y, 0.0], [width, height, depth])),
        _ => {
            let wanted =
                if is_octree { "(x, y, z, width, height, depth)" } else { "(column, row, width, height)" };
            Err(PyTypeError::new_err(format!("window: expected {wanted} in cells, got {}", window.repr()?)))
        }
    }
}

fn window_cells(tree: &Dataset, window: &Bound<'_, PyAny>) -> PyResult<Bounds> {
    let (first, size) = corner_of(tree, window)?;
    let extent = tree.header().extent;
    let is_whole = |number: &f64| number.fract() == 0.0 && number.abs() < 9e15;
    if !first.iter().chain(&size).all(is_whole) {
        return Err(invalid("window: cells are whole numbers"));
    }
    if size.iter().any(|length| *length < 1.0) {
        return Err(invalid(format!("window: {} x {} cells, at least 1 x 1 needed", size[0], size[1])));
    }
    if (0..3).any(|axis| first[axis] < 0.0 || first[axis] + size[axis] > extent[axis] as f64) {
        let [width, height, depth] = extent;
        let all = if tree.header().form.axes() == 3 { format!(" x {depth}") } else { String::new() };
        return Err(PyIndexError::new_err(format!(
            "window: sticks out of the {width} x {height}{all} cells; boundless=True reads VOID there"
        )));
    }
    let min = first.map(|number| number as u64);
    Ok(Bounds { min, max: std::array::from_fn(|axis| min[axis] + size[axis] as u64) })
}

fn box_cells(tree: &Dataset, bbox: &Bound<'_, PyAny>) -> PyResult<Bounds> {
    let (frame, extent) = (&tree.metadata().frame, tree.header().extent);
    let cells = if let Ok(rectangle) = bbox.extract::<[f64; 4]>() {
        let [west, south, east, north] = rectangle;
        if !(west < east && south < north) {
            return Err(invalid("bbox: left must be less than right, bottom less than top"));
        }
        frame.cells_in_rectangle(rectangle, extent)
    } else if let Ok([a, b, c, d, e, f]) = bbox.extract::<[f64; 6]>() {
        if !(a < d && b < e && c < f) {
            return Err(invalid("bbox: the least x, y, z come first, then the greatest"));
        }
        frame.cells_in_box([a, b, c], [d, e, f], extent)
    } else {
        let text = "bbox: expected (left, bottom, right, top), or of octrees (min x, y, z, max x, y, z)";
        return Err(PyTypeError::new_err(text));
    };
    let cells = cells.ok_or_else(|| invalid("the file's transform has no inverse"))?;
    if cells.is_empty() {
        let [low, high] = frame.world_box(&tree.header().picture());
        return Err(invalid(format!("bbox: outside of the picture, which lies from {low:?} to {high:?}")));
    }
    Ok(cells)
}

/// A level, the deepest if none is given.
pub(crate) fn level_of(tree: &Dataset, level: Option<i64>) -> PyResult<u8> {
    let depth = tree.depth();
    match level {
        None => Ok(depth),
        Some(level) if (0..=i64::from(depth)).contains(&level) => Ok(level as u8),
        Some(level) => Err(invalid(format!("level: {level}, the tree's levels are 0 to {depth}"))),
    }
}

/// The cells of a level that a box of the deepest cells covers, if only in part.
pub(crate) fn at_level(tree: &Dataset, bounds: Bounds, level: u8) -> Bounds {
    let shift = tree.depth() - level;
    Bounds {
        min: bounds.min.map(|cell| cell >> shift),
        max: bounds.max.map(|cell| cell.div_ceil(1 << shift)),
    }
}
