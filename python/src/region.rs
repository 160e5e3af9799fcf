//! Regions of trees as given by Python programs: windows of cells, or of other coordinates.

use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use spinney::{Bounds, CellLocator, Coordinates, Dataset};

use crate::error::{OrRaise, invalid};

/// Returns the cells of the deepest level in a window: first cell and size in cells, or minimum and
/// maximum in other coordinates. Returns `None` if no window is given.
pub(crate) fn region_of(
    tree: &Dataset,
    window: Option<&Bound<'_, PyAny>>,
    coordinates: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<Bounds>> {
    let coordinates = coordinates.map(coordinates_of).transpose()?.unwrap_or(Coordinates::Cells);
    match window {
        None if coordinates != Coordinates::Cells => Err(invalid("coordinates: need a window")),
        None => Ok(None),
        Some(window) if coordinates == Coordinates::Cells => window_cells(tree, window).map(Some),
        Some(window) => box_cells(tree, window, &coordinates).map(Some),
    }
}

/// Parses coordinates: a name (`cells`, `world`, `lonlat`), or a coordinate system as a string or
/// as an object that has one.
pub(crate) fn coordinates_of(given: &Bound<'_, PyAny>) -> PyResult<Coordinates> {
    let text = match given.extract::<String>() {
        Ok(text) => text,
        Err(_) => given.py().import("spinney._build")?.getattr("crs_text")?.call1((given,))?.extract()?,
    };
    text.parse().or_raise()
}

/// First cell and size along x, y and z.
type Corner = ([f64; 3], [f64; 3]);

/// Parses a window: column, row, width and height (in octrees x, y, z and three lengths), a pair of
/// ranges of rows and columns, or an object with these, such as rasterio's.
fn corner_of(tree: &Dataset, window: &Bound<'_, PyAny>) -> PyResult<Corner> {
    let depth = tree.header().extent[2] as f64;
    let is_octree = tree.header().form.axes() == 3;
    if let Ok([x, y, width, height]) = window.extract::<[f64; 4]>() {
        return Ok(([x, y, 0.0], [width, height, depth]));
    }
    if let Ok([x, y, z, width, height, depth]) = window.extract::<[f64; 6]>() {
        if !is_octree {
            return Err(invalid(
                "window: got six numbers, expected column, row, width, height; six are for octrees",
            ));
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

/// Returns whether coordinates are cells, the default.
pub(crate) fn are_cells(coordinates: Option<&Bound<'_, PyAny>>) -> PyResult<bool> {
    Ok(matches!(coordinates.map(coordinates_of).transpose()?, None | Some(Coordinates::Cells)))
}

/// Returns whether a window of cells has fractional bounds.
pub(crate) fn is_fractional(
    tree: &Dataset,
    window: &Bound<'_, PyAny>,
    coordinates: Option<&Bound<'_, PyAny>>,
) -> PyResult<bool> {
    if !are_cells(coordinates)? {
        return Ok(false);
    }
    let corner = corner_of(tree, window);
    Ok(corner.is_ok_and(|(first, size)| first.iter().chain(&size).any(|number| number.fract().abs() > 0.0)))
}

fn window_cells(tree: &Dataset, window: &Bound<'_, PyAny>) -> PyResult<Bounds> {
    let (first, size) = corner_of(tree, window)?;
    let extent = tree.header().extent;
    let is_whole = |number: &f64| number.fract() == 0.0 && number.abs() < 9e15;
    if !first.iter().chain(&size).all(is_whole) {
        return Err(invalid("window: expected integer cells"));
    }
    if size.iter().any(|length| *length < 1.0) {
        return Err(invalid(format!("window: got {} x {} cells, expected at least 1 x 1", size[0], size[1])));
    }
    if (0..3).any(|axis| first[axis] < 0.0 || first[axis] + size[axis] > extent[axis] as f64) {
        let [width, height, depth] = extent;
        let all = if tree.header().form.axes() == 3 { format!(" x {depth}") } else { String::new() };
        return Err(PyIndexError::new_err(format!(
            "window: extends beyond the {width} x {height}{all} cells; boundless=True reads VOID there"
        )));
    }
    let min = first.map(|number| number as u64);
    Ok(Bounds { min, max: std::array::from_fn(|axis| min[axis] + size[axis] as u64) })
}

fn box_cells(tree: &Dataset, window: &Bound<'_, PyAny>, coordinates: &Coordinates) -> PyResult<Bounds> {
    let is_octree = tree.header().form.axes() == 3;
    let (low, high) = if let Ok([west, south, east, north]) = window.extract::<[f64; 4]>() {
        ([west, south, f64::NEG_INFINITY], [east, north, f64::INFINITY])
    } else if let (true, Ok([a, b, c, d, e, f])) = (is_octree, window.extract::<[f64; 6]>()) {
        ([a, b, c], [d, e, f])
    } else {
        let more = if is_octree { ", or (min x, y, z, max x, y, z)" } else { "" };
        let text =
            format!("window: expected (left, bottom, right, top){more}, in coordinates other than cells");
        return Err(PyTypeError::new_err(text));
    };
    let locator = CellLocator::new(coordinates, &tree.metadata().frame, tree.header().extent).or_raise()?;
    match *locator.boxes(low, high).or_raise()? {
        [bounds] => Ok(bounds),
        [] => Err(invalid(format!("window: is outside of the raster, which is {}", locator.bounds_text()))),
        _ => Err(invalid("window: crosses the tree's seam; read both sides separately")),
    }
}

/// Returns a level, by default the deepest.
pub(crate) fn level_of(tree: &Dataset, level: Option<i64>) -> PyResult<u8> {
    let depth = tree.depth();
    match level {
        None => Ok(depth),
        Some(level) if (0..=i64::from(depth)).contains(&level) => Ok(level as u8),
        Some(level) => Err(invalid(format!("level: got {level}, expected 0 to {depth}"))),
    }
}

/// Returns the cells of a level that a box of the deepest cells covers, at least partly.
pub(crate) fn at_level(tree: &Dataset, bounds: Bounds, level: u8) -> Bounds {
    let shift = tree.depth() - level;
    Bounds {
        min: bounds.min.map(|cell| cell >> shift),
        max: bounds.max.map(|cell| cell.div_ceil(1 << shift)),
    }
}
