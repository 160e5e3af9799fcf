//! Parts of pictures as people give them: windows of cells, or boxes in the world.

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use spinney::dataset::Dataset;
use spinney::space::Bounds;

use super::{NO_INVERSE, numbers};

/// A part of a picture; all of it if neither is given.
#[derive(Args, Clone, Debug, Default)]
#[group(multiple = false)]
pub(crate) struct PartOptions {
    /// Window in cells: first column, first row, columns, rows
    #[arg(long, value_name = "COL,ROW,W,H", value_parser = four::<u64>)]
    window: Option<[u64; 4]>,
    /// Box in world coordinates: west, south, east, north
    #[arg(long, value_name = "W,S,E,N", value_parser = four::<f64>)]
    bbox: Option<[f64; 4]>,
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

    /// The cells of the deepest level that are meant; `None`: all.
    pub(crate) fn bounds(&self, tree: &Dataset) -> Result<Option<Bounds>> {
        match self.bbox {
            Some(rectangle) => rectangle_cells(tree, rectangle).map(Some),
            None => self.window_cells(tree, 2),
        }
    }

    /// The cells of the deepest level that are meant in a slice across an axis; `None`: all.
    pub(crate) fn slice_bounds(&self, tree: &Dataset, across: usize) -> Result<Option<Bounds>> {
        if across == 2 {
            return self.bounds(tree);
        }
        ensure!(self.bbox.is_none(), "--bbox is for slices across z; use --window");
        self.window_cells(tree, across)
    }

    /// The cells of the window, as it is seen along an axis, in all slices.
    fn window_cells(&self, tree: &Dataset, across: usize) -> Result<Option<Bounds>> {
        let Some([column, row, width, height]) = self.window else { return Ok(None) };
        let end = |start: u64, length: u64| start.checked_add(length).context("--window: too large");
        let (right, lower) = (end(column, width)?, end(row, height)?);
        ensure!(
            width > 0 && height > 0,
            "--window: {width} columns by {height} rows, at least 1 by 1 needed"
        );
        // Columns and rows are the other two axes, in order.
        let [columns, rows] = [[1, 2], [0, 2], [0, 1]][across];
        let mut bounds = Bounds::picture(tree.header().extent);
        (bounds.min[columns], bounds.max[columns]) = (column, right);
        (bounds.min[rows], bounds.max[rows]) = (row, lower);
        let extent = tree.header().extent;
        ensure!(
            column < extent[columns] && row < extent[rows],
            "--window: {column},{row} is outside the picture, which has {} x {} cells",
            extent[columns],
            extent[rows]
        );
        Ok(Some(bounds))
    }
}

/// The cells of the picture that a rectangle of the world means.
fn rectangle_cells(tree: &Dataset, rectangle: [f64; 4]) -> Result<Bounds> {
    let [west, south, east, north] = rectangle;
    ensure!(west < east && south < north, "--bbox: west must be less than east, south less than north");
    let bounds = tree.metadata().frame.cells_in_rectangle(rectangle, tree.header().extent);
    let bounds = bounds.context(NO_INVERSE)?;
    ensure!(!bounds.is_empty(), "--bbox: outside the picture, {}", world_box(tree));
    Ok(bounds)
}

/// Reads four numbers with commas between them.
fn four<T: std::str::FromStr>(text: &str) -> Result<[T; 4], String> {
    numbers(text).ok_or_else(|| "expected four numbers, as in 1,2,3,4; of cells none is negative".into())
}

/// West, south, east and north of the whole picture, for people.
fn world_box(tree: &Dataset) -> String {
    let [[west, south, _], [east, north, _]] = tree.metadata().frame.world_box(&tree.header().picture());
    format!("which is {west},{south},{east},{north}")
}
