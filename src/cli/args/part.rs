//! Regions of trees as arguments: windows of cells, or boxes in other coordinates.

use anyhow::{Result, bail, ensure};
use clap::Args;
use spinney::{Bounds, Coordinates, Dataset};

use super::{CoordinatesOption, numbers};

/// A region of a raster or a solid; all of it if none is given.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PartOptions {
    /// Region of the tree: column, row, width and height in cells, in octrees X,Y,Z and three
    /// lengths; with --in other than cells: west, south, east, north (minimum and maximum
    /// coordinates), where west exceeds east across the 180th meridian
    #[arg(long, value_name = "COL,ROW,W,H", value_parser = parse_window)]
    window: Option<Window>,
    #[command(flatten)]
    coordinates: CoordinatesOption,
}

/// Numbers of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Window {
    /// Along two axes; all of the third.
    Flat([f64; 4]),
    /// Along three axes.
    Solid([f64; 6]),
}

/// Parses four or six comma-separated finite numbers.
fn parse_window(text: &str) -> Result<Window, String> {
    let window = numbers(text).map(Window::Flat).or_else(|| numbers(text).map(Window::Solid));
    window
        .filter(|window| window.numbers().iter().all(|number| number.is_finite()))
        .ok_or_else(|| match text.split(',').count() {
            4 | 6 => "expected finite numbers".into(),
            count => format!(
                "got {count} numbers, expected 4: column, row, width, height, or with --in west, south, east, north; \
                 octrees also take 6"
            ),
        })
}

impl Window {
    fn numbers(&self) -> &[f64] {
        match self {
            Window::Flat(numbers) => numbers,
            Window::Solid(numbers) => numbers,
        }
    }

    /// Returns minimum and maximum coordinates.
    fn corners(self) -> [[f64; 3]; 2] {
        match self {
            Window::Flat([a, b, c, d]) => [[a, b, f64::NEG_INFINITY], [c, d, f64::INFINITY]],
            Window::Solid([a, b, c, d, e, f]) => [[a, b, c], [d, e, f]],
        }
    }
}

impl PartOptions {
    /// Whether a region was given.
    pub(crate) fn is_given(&self) -> bool {
        self.window.is_some()
    }

    /// Whether a region was given along all three axes.
    pub(crate) fn is_solid(&self) -> bool {
        matches!(self.window, Some(Window::Solid(_)))
    }

    /// Returns the region's minimum and maximum coordinates, as given.
    pub(crate) fn corners(&self) -> Option<[[f64; 3]; 2]> {
        self.window.map(Window::corners)
    }

    /// Returns the option for coordinates.
    pub(crate) fn coordinates(&self) -> &CoordinatesOption {
        &self.coordinates
    }

    /// Returns west, south, east and north of a region in degrees. (The box of its cells would be
    /// larger.)
    pub(crate) fn degrees(&self) -> Option<[f64; 4]> {
        match (self.window, self.coordinates.given()) {
            (Some(Window::Flat(numbers)), Some(coordinates)) if *coordinates == Coordinates::LONLAT => {
                Some(numbers)
            }
            _ => None,
        }
    }

    /// Returns the region in cells of the deepest level; `None`: all.
    ///
    /// # Errors
    /// If the region crosses the tree's east edge, so that it is two boxes. `advice` ends the
    /// message.
    pub(crate) fn bounds(&self, tree: &Dataset, advice: &str) -> Result<Option<Bounds>> {
        let boxes = self.boxes(tree)?;
        if let Some([west, east]) = boxes.as_deref() {
            let span = |bounds: &Bounds| format!("columns {} to {}", bounds.min[0], bounds.max[0]);
            bail!("--window: crosses the tree's east edge, into {} and {}; {advice}", span(west), span(east));
        }
        Ok(boxes.map(|boxes| boxes[0]))
    }

    /// Returns the region in cells of the deepest level: one box, or two if it crosses the tree's
    /// east edge, the western first; `None`: all.
    pub(crate) fn boxes(&self, tree: &Dataset) -> Result<Option<Vec<Bounds>>> {
        let Some(window) = self.window else { return Ok(None) };
        let is_octree = tree.header().form.axes() == 3;
        ensure!(is_octree || !self.is_solid(), "--window: got 6 numbers, expected 4: the tree is a quadtree");
        if self.coordinates.are_cells() {
            return window_cells(tree, window, 2).map(|found| Some(vec![found]));
        }
        let [low, high] = window.corners();
        let locator = self.coordinates.locator(tree, Coordinates::World)?;
        let boxes = locator.boxes(low, high).map_err(|error| anyhow::anyhow!("--window: {error}"))?;
        if boxes.is_empty() {
            let swapped = |[x, y, z]: [f64; 3]| [y, x, z];
            let advice = match locator.boxes(swapped(low), swapped(high)) {
                Ok(boxes) if !boxes.is_empty() => "; are longitude and latitude (x and y) swapped?",
                _ => "",
            };
            let what = if is_octree { "octree" } else { "raster" };
            bail!("--window: is outside of the {what}, which is {}{advice}", locator.bounds_text());
        }
        Ok(Some(boxes))
    }

    /// Returns the region's cells in a slice across an axis: see [`PartOptions::boxes`].
    pub(crate) fn slice_boxes(&self, tree: &Dataset, across: usize) -> Result<Option<Vec<Bounds>>> {
        ensure!(!self.is_solid(), "--window: got 6 numbers, expected 4 for a slice");
        if across == 2 {
            return self.boxes(tree);
        }
        ensure!(
            self.window.is_none() || self.coordinates.are_cells(),
            "--window: must be in cells for slices across x or y; leave out --in"
        );
        self.window.map(|window| window_cells(tree, window, across).map(|found| vec![found])).transpose()
    }
}

/// Returns the cells of a window. A window along two axes is perpendicular to axis `across`, and
/// covers all slices.
fn window_cells(tree: &Dataset, window: Window, across: usize) -> Result<Bounds> {
    let is_cell = |number: &f64| number.fract() == 0.0 && (0.0..2e19).contains(number);
    let numbers = window.numbers();
    let text =
        |numbers: &[f64], between| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(between);
    ensure!(
        numbers.iter().all(is_cell),
        "--window: got {}, expected integers from 0: a first cell, and numbers of cells; for other coordinates, add --in",
        text(numbers, ",")
    );
    // Columns and rows are the other two axes, in order.
    let axes: &[usize] = match window {
        Window::Flat(_) => &[[1, 2], [0, 2], [0, 1]][across],
        Window::Solid(_) => &[0, 1, 2],
    };
    let (first, size) = numbers.split_at(axes.len());
    ensure!(
        size.iter().all(|length| *length > 0.0),
        "--window: got {} cells, expected at least 1 along each axis",
        text(size, " x ")
    );
    let extent = tree.header().extent;
    let mut bounds = Bounds::of_extent(extent);
    for ((axis, first), size) in axes.iter().zip(first).zip(size) {
        let first = *first as u64;
        (bounds.min[*axis], bounds.max[*axis]) = (first, first.saturating_add(*size as u64));
    }
    let all: Vec<f64> = axes.iter().map(|axis| extent[*axis] as f64).collect();
    ensure!(
        axes.iter().all(|axis| bounds.min[*axis] < extent[*axis]),
        "--window: cell {} is outside of the tree, which has {} cells{}",
        text(first, ","),
        text(&all, " x "),
        as_box_of_the_world(tree, numbers)
    );
    Ok(bounds)
}

/// Returns advice for numbers that are a world box, where cells were expected.
fn as_box_of_the_world(tree: &Dataset, numbers: &[f64]) -> String {
    let half = numbers.len() / 2;
    let [low, high] = tree.metadata().frame.world_box(&tree.header().extent_bounds());
    let meets = |axis: usize| numbers[axis] < high[axis] && numbers[half + axis] > low[axis];
    match (0..half).all(meets) {
        true => "; for world coordinates, add --in world".into(),
        false => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_have_four_or_six_numbers() {
        assert_eq!(parse_window("1,2,3,4"), Ok(Window::Flat([1.0, 2.0, 3.0, 4.0])));
        assert_eq!(parse_window(" -1,2.5,3,4,5,6"), Ok(Window::Solid([-1.0, 2.5, 3.0, 4.0, 5.0, 6.0])));
        for text in ["", "1,2,3", "1,2,3,4,5", "1,2,3,inf", "a,b,c,d"] {
            assert!(parse_window(text).is_err(), "{text}");
        }
    }
}
