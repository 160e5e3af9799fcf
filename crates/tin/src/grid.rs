//! Grids of heights at cell centres, and conversion of surfaces to grids.

use crate::mesh::side;
use crate::tin::Tin;
use spinney_base::{Error, Result};

/// Heights at the centres of the cells of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightGrid {
    /// Number of columns.
    pub columns: usize,
    /// Number of rows.
    pub rows: usize,
    /// Affine coefficients a to f: the first corner of a cell is at x = a column + b row + c and y
    /// = d column + e row + f.
    pub transform: [f64; 6],
    /// Heights, row by row; NaN for cells without a value.
    pub heights: Vec<f64>,
}

/// Maximum number of cells of a grid, all of which are in memory.
const MAX_CELLS: usize = 1 << 30;

impl HeightGrid {
    /// Creates a grid without heights.
    ///
    /// # Errors
    /// If there is no cell or there are more than 2^30; if the transform has no inverse.
    pub fn new([columns, rows]: [usize; 2], transform: [f64; 6]) -> Result<HeightGrid> {
        let cells = columns.checked_mul(rows).filter(|cells| (1..=MAX_CELLS).contains(cells));
        let Some(cells) = cells else {
            let found = format!("{columns} x {rows} cells");
            return Err(Error::invalid("grid", found, "1 to 2^30 cells"));
        };
        let [a, b, _, d, e, _] = transform;
        let is_finite = transform.iter().all(|number| number.is_finite());
        if !(is_finite && (a * e - b * d).is_normal()) {
            return Err(Error::invalid("transform", format!("{transform:?}"), "an invertible transform"));
        }
        Ok(HeightGrid { columns, rows, transform, heights: vec![f64::NAN; cells] })
    }

    /// Returns the coordinates of a cell's centre.
    pub fn centre(&self, column: usize, row: usize) -> [f64; 2] {
        let [a, b, c, d, e, f] = self.transform;
        let (column, row) = (column as f64 + 0.5, row as f64 + 0.5);
        [a * column + b * row + c, d * column + e * row + f]
    }

    /// Converts a position to columns and rows relative to cell centres.
    fn cell_of(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [a, b, c, d, e, f] = self.transform;
        let (x, y, determinant) = (x - c, y - f, a * e - b * d);
        [(e * x - b * y) / determinant - 0.5, (a * y - d * x) / determinant - 0.5]
    }
}

impl Tin {
    /// Sets the heights of a grid at the cell centres that the surface covers, by linear
    /// interpolation in triangles. Cells outside of the surface are not changed.
    pub fn fill(&self, grid: &mut HeightGrid) {
        for (number, _) in self.mesh.triangles.iter().enumerate() {
            let corners = self.mesh.corners(number);
            let cells = corners.map(|corner| grid.cell_of(corner));
            let rows = span(cells.map(|cell| cell[1]), grid.rows);
            for row in rows {
                for column in across(&cells, row, grid.columns) {
                    let at = row * grid.columns + column;
                    let position = grid.centre(column, row);
                    let is_in = (0..3).all(|at| side(corners[at], corners[(at + 1) % 3], position) >= 0.0);
                    if is_in {
                        grid.heights[at] = self.height_in(number, position);
                    }
                }
            }
        }
    }
}

/// Returns the integers below `count` in the range of some numbers, extended by one at both ends.
fn span(numbers: [f64; 3], count: usize) -> std::ops::Range<usize> {
    let least = numbers.into_iter().fold(f64::INFINITY, f64::min);
    let most = numbers.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let first = (least - 1.0).floor().max(0.0) as usize;
    let end = (most + 2.0).ceil().clamp(0.0, count as f64) as usize;
    first.min(end)..end
}

/// Returns the columns of a row that a triangle may cover, extended by one at both ends.
fn across(cells: &[[f64; 2]; 3], row: usize, count: usize) -> std::ops::Range<usize> {
    let row = row as f64;
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for at in 0..3 {
        let ([ax, ay], [bx, by]) = (cells[at], cells[(at + 1) % 3]);
        // (With a margin of half a row, because the positions are rounded.)
        for row in [row - 0.5, row + 0.5] {
            if (ay <= row && row <= by) || (by <= row && row <= ay) {
                let share = if ay == by { 0.0 } else { (row - ay) / (by - ay) };
                let x = ax + share * (bx - ax);
                (least, most) = (least.min(x), most.max(x));
            }
        }
        if (ay - row).abs() <= 0.5 {
            (least, most) = (least.min(ax), most.max(ax));
        }
    }
    if least > most { 0..0 } else { span([least, most, most], count) }
}
