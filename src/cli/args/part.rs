//! Parts of pictures as people give them: windows of cells, or boxes in other coordinates.

use anyhow::{Result, ensure};
use clap::Args;
use spinney::dataset::Dataset;
use spinney::space::{Bounds, Coordinates};

use super::{CoordinatesOption, numbers};

/// A part of a picture; all of it if neither is given.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct PartOptions {
    /// Window: first column, first row, columns, rows; with --in other than cells west, south, east, north: the smallest window
    /// around such a box, which may lie across the 180th meridian (west greater than east)
    #[arg(long, value_name = "COL,ROW,W,H", value_parser = four, conflicts_with = "bbox")]
    window: Option<[f64; 4]>,
    /// Box in world coordinates: west, south, east, north; short for --in world --window
    #[arg(long, value_name = "W,S,E,N", value_parser = four)]
    bbox: Option<[f64; 4]>,
    #[command(flatten)]
    coordinates: CoordinatesOption,
}

impl PartOptions {
    /// Whether a window was given.
    pub(crate) fn is_window(&self) -> bool {
        self.window.is_some()
    }

    /// Whether a box was given.
    pub(crate) fn is_bbox(&self) -> bool {
        self.bbox.is_some()
    }

    /// The coordinates that were given.
    pub(crate) fn coordinates(&self) -> &CoordinatesOption {
        &self.coordinates
    }

    /// The cells of the deepest level that are meant; `None`: all.
    ///
    /// # Errors
    /// If these are two boxes, on both sides of the tree's seam: `advice` is what to do then.
    pub(crate) fn bounds(&self, tree: &Dataset, advice: &str) -> Result<Option<Bounds>> {
        let boxes = self.boxes(tree)?;
        if let Some([west, east]) = boxes.as_deref() {
            let span = |bounds: &Bounds| format!("columns {} to {}", bounds.min[0], bounds.max[0]);
            anyhow::bail!(
                "the box lies across the tree's seam, in {} and {}; {advice}",
                span(west),
                span(east)
            );
        }
        Ok(boxes.map(|boxes| boxes[0]))
    }

    /// The cells of the deepest level that are meant: one box, or two where it lies across the tree's seam, the western first;
    /// `None`: all.
    pub(crate) fn boxes(&self, tree: &Dataset) -> Result<Option<Vec<Bounds>>> {
        let (name, numbers, usual) = match (self.window, self.bbox) {
            (Some(window), _) if self.coordinates.are_cells() => {
                return window_cells(tree, window, 2).map(|found| Some(vec![found]));
            }
            (Some(window), _) => ("--window", window, Coordinates::World),
            (None, Some(bbox)) => ("--bbox", bbox, Coordinates::World),
            (None, None) => return Ok(None),
        };
        ensure!(
            self.coordinates.given() != Some(&Coordinates::Cells),
            "--bbox is in the world: with --in cells use --window COL,ROW,W,H"
        );
        let [west, south, east, north] = numbers;
        let places = self.coordinates.places(tree, usual)?;
        let boxes = places.boxes([west, south, f64::NEG_INFINITY], [east, north, f64::INFINITY]);
        let boxes = boxes.map_err(|error| anyhow::anyhow!("{name}: {error}"))?;
        if boxes.is_empty() {
            let swapped = places.boxes([south, west, f64::NEG_INFINITY], [north, east, f64::INFINITY]);
            let advice = match swapped {
                Ok(boxes) if !boxes.is_empty() => "; are longitude and latitude (x and y) swapped?",
                _ => "",
            };
            anyhow::bail!("{name}: outside the picture, which is {}{advice}", places.picture());
        }
        Ok(Some(boxes))
    }

    /// The cells of the deepest level that are meant in a slice across an axis: see [`PartOptions::boxes`].
    pub(crate) fn slice_boxes(&self, tree: &Dataset, across: usize) -> Result<Option<Vec<Bounds>>> {
        if across == 2 {
            return self.boxes(tree);
        }
        ensure!(self.bbox.is_none(), "--bbox is for slices across z; use --window");
        ensure!(
            self.window.is_none() || self.coordinates.are_cells(),
            "--window in other coordinates than cells is for slices across z"
        );
        self.window.map(|window| window_cells(tree, window, across).map(|found| vec![found])).transpose()
    }
}

/// The cells of a window, as it is seen along an axis, in all slices.
fn window_cells(tree: &Dataset, window: [f64; 4], across: usize) -> Result<Bounds> {
    let is_cell = |number: &f64| number.fract() == 0.0 && (0.0..2e19).contains(number);
    ensure!(
        window.iter().all(is_cell),
        "--window: cells are whole numbers and none is negative: column, row, columns, rows; see --in for other coordinates"
    );
    let [column, row, width, height] = window.map(|number| number as u64);
    ensure!(width > 0 && height > 0, "--window: {width} columns by {height} rows, at least 1 by 1 needed");
    // Columns and rows are the other two axes, in order.
    let [columns, rows] = [[1, 2], [0, 2], [0, 1]][across];
    let extent = tree.header().extent;
    let mut bounds = Bounds::picture(extent);
    (bounds.min[columns], bounds.max[columns]) = (column, column.saturating_add(width));
    (bounds.min[rows], bounds.max[rows]) = (row, row.saturating_add(height));
    ensure!(
        column < extent[columns] && row < extent[rows],
        "--window: {column},{row} is outside the picture, which has {} x {} cells",
        extent[columns],
        extent[rows]
    );
    Ok(bounds)
}

/// Reads four finite numbers with commas between them.
fn four(text: &str) -> Result<[f64; 4], String> {
    let numbers = numbers(text).filter(|numbers: &[f64; 4]| numbers.iter().all(|number| number.is_finite()));
    numbers.ok_or_else(|| "expected four numbers, as in 1,2,3,4".into())
}
