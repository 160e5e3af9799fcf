//! Places as people give them: windows, boxes, points, in cells or in the world.

use anyhow::{Context, Result, ensure};
use clap::Args;
use spinney::dataset::Dataset;
use spinney::space::Bounds;

/// A part of a picture; all of it if neither is given.
#[derive(Args, Clone, Debug, Default)]
#[group(multiple = false)]
pub(crate) struct Part {
    /// Window in cells: first column, first row, columns, rows
    #[arg(long, value_name = "COL,ROW,W,H", value_parser = four::<u64>)]
    window: Option<[u64; 4]>,
    /// Box in world coordinates: west, south, east, north
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true, value_parser = four::<f64>)]
    bbox: Option<[f64; 4]>,
}

impl Part {
    /// The cells of the deepest level that are meant in a slice across an axis; `None`: all.
    pub(crate) fn slice_bounds(&self, tree: &Dataset, across: usize) -> Result<Option<Bounds>> {
        if across == 2 {
            return self.bounds(tree);
        }
        ensure!(self.bbox.is_none(), "--bbox is for slices across z; use --window");
        let Some([column, row, width, height]) = self.window else { return Ok(None) };
        ensure!(
            width > 0 && height > 0,
            "--window: {width} columns by {height} rows, at least 1 by 1 needed"
        );
        let end = |start: u64, length: u64| start.checked_add(length).context("--window: too large");
        let columns = 1 - across;
        let mut bounds = Bounds { min: [0; 3], max: tree.header().extent };
        (bounds.min[columns], bounds.max[columns]) = (column, end(column, width)?);
        (bounds.min[2], bounds.max[2]) = (row, end(row, height)?);
        Ok(Some(bounds))
    }

    /// The cells of the deepest level that are meant; `None`: all.
    pub(crate) fn bounds(&self, tree: &Dataset) -> Result<Option<Bounds>> {
        let depth_of_z = tree.header().extent[2];
        if let Some([x, y, width, height]) = self.window {
            let end = |start: u64, length: u64| start.checked_add(length).context("--window: too large");
            let max = [end(x, width)?, end(y, height)?, depth_of_z];
            ensure!(
                width > 0 && height > 0,
                "--window: {width} columns by {height} rows, at least 1 by 1 needed"
            );
            return Ok(Some(Bounds { min: [x, y, 0], max }));
        }
        let Some([west, south, east, north]) = self.bbox else { return Ok(None) };
        ensure!(west < east && south < north, "--bbox: west must be less than east, south less than north");
        let frame = &tree.metadata().frame;
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in [[west, south], [east, south], [west, north], [east, north]] {
            let cell =
                frame.to_cells([corner[0], corner[1], 0.0]).context("the file's transform has no inverse")?;
            for axis in 0..2 {
                low[axis] = low[axis].min(cell[axis]);
                high[axis] = high[axis].max(cell[axis]);
            }
        }
        // Edges that are a rounding error beside a cell's edge mean that edge.
        let first = |cell: f64| (cell + 1e-6).floor().max(0.0) as u64;
        let end = |cell: f64| (cell - 1e-6).ceil().max(0.0) as u64;
        let bounds =
            Bounds { min: [first(low[0]), first(low[1]), 0], max: [end(high[0]), end(high[1]), depth_of_z] };
        let picture = Bounds { min: [0; 3], max: tree.header().extent };
        let inside = bounds.intersect(&picture);
        ensure!(!inside.is_empty(), "--bbox: outside the picture, {}", world_box(tree));
        Ok(Some(inside))
    }
}

/// Four numbers with commas between them.
fn four<T: std::str::FromStr>(text: &str) -> std::result::Result<[T; 4], String> {
    let numbers: Option<Vec<T>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| numbers.try_into().ok())
        .ok_or_else(|| "expected four numbers, as in 1,2,3,4".into())
}

/// West, south, east and north of the whole picture, for people.
pub(crate) fn world_box(tree: &Dataset) -> String {
    let [width, height, _] = tree.header().extent.map(|cells| cells as f64);
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    let world = corners.map(|[x, y]| tree.metadata().frame.to_world([x, y, 0.0]));
    let least = |axis: usize| world.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
    let most = |axis: usize| world.iter().map(|corner| corner[axis]).fold(f64::NEG_INFINITY, f64::max);
    format!("which is {},{},{},{}", least(0), least(1), most(0), most(1))
}
