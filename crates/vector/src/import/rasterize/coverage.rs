//! Shares of a block's cells that a polygon covers.

use std::ops::Range;

use super::edge::{Edge, PARTS, Point, centre};

/// Rounding error of a share. A share is a sum of differences of coordinates, in cells of the
/// block. Each is off by 2^-52 of the distance of the edge's ends; at a distance of a million
/// cells, by 2^-32.
const ROUNDING: f64 = 1e-9;

/// Snaps a share to 0 or 1 within the rounding error.
pub(super) fn settled(share: f64) -> f64 {
    match share {
        share if share < ROUNDING => 0.0,
        share if share > 1.0 - ROUNDING => 1.0,
        share => share,
    }
}

/// Shares of a block's cells that polygons cover.
pub(super) struct Shares {
    sums: Vec<f64>,
    /// Number of polygons that partially cover each cell, at most 2; [`FULL`] if one covers all of
    /// it.
    polygons: Vec<u8>,
}

/// Marks a cell that is fully covered by one polygon.
const FULL: u8 = u8::MAX;

impl Shares {
    pub(super) fn new(cells: usize) -> Shares {
        Shares { sums: vec![0.0; cells], polygons: vec![0; cells] }
    }

    /// Adds a share to each of some cells; returns whether it exceeds the rounding error.
    #[inline]
    pub(super) fn add(&mut self, share: f64, cells: Range<usize>) -> bool {
        let share = settled(share.abs());
        if share == 0.0 {
            return false;
        }
        if share == 1.0 {
            self.polygons[cells].fill(FULL);
            return true;
        }
        for (sum, polygons) in self.sums[cells.clone()].iter_mut().zip(&mut self.polygons[cells]) {
            *sum += share;
            *polygons = if *polygons < 2 { *polygons + 1 } else { *polygons };
        }
        true
    }

    /// Returns and resets the sum of shares of a cell, and the number of polygons in it, at most 2.
    /// The number is 1 if one polygon covers the cell fully. The sum of several polygons is the
    /// share of their union only if they do not overlap.
    pub(super) fn take(&mut self, cell: usize) -> (f64, u8) {
        let sum = std::mem::take(&mut self.sums[cell]);
        match std::mem::take(&mut self.polygons[cell]) {
            FULL => (1.0, 1),
            count => (sum, count),
        }
    }
}

/// Workspace for measuring polygons in a square block of cells.
pub(super) struct Coverage {
    side: usize,
    /// Difference of each cell's share from that of the previous cell, in rows of `side + 1`. All
    /// are zero between measurements.
    changes: Vec<f64>,
    /// Inside length of the block's left side, per row.
    left: Vec<f64>,
    /// Change of the winding number along the left side, from each row on.
    steps: Vec<f64>,
    /// Columns of each row to which something was added since the last `take_touched`.
    touched: Vec<Range<usize>>,
}

impl Coverage {
    pub(super) fn new(side: usize) -> Coverage {
        let row = || vec![0.0; side + 1];
        let touched = vec![side..0; side];
        Coverage { side, changes: vec![0.0; (side + 1) * side], left: row(), steps: row(), touched }
    }

    /// Returns the number of cells along a side of the block.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Marks some columns of a row as changed.
    pub(super) fn touch(&mut self, row: usize, columns: Range<usize>) {
        let touched = &mut self.touched[row];
        *touched = touched.start.min(columns.start)..touched.end.max(columns.end);
    }

    /// Returns and resets the changed columns of a row.
    pub(super) fn take_touched(&mut self, row: usize) -> Range<usize> {
        std::mem::replace(&mut self.touched[row], self.side..0)
    }

    /// Adds the shares of a block's cells that a polygon covers, given its edges in the block, the
    /// block's first cell, and the winding number of that cell's centre. The result is exact up to
    /// rounding if rings do not intersect.
    ///
    /// First, edges that cross the left side change the inside lengths along it. Then each edge
    /// changes the shares to its right.
    pub(super) fn measure<'a>(
        &mut self,
        edges: impl Iterator<Item = &'a Edge> + Clone,
        cell: Point,
        winding: i32,
        shares: &mut Shares,
    ) {
        let (side, origin) = (self.side, cell.map(|cell| cell * PARTS));
        self.left.fill(0.0);
        self.steps.fill(0.0);
        // From the first centre to the left side.
        let on_side = [origin[0], centre(cell[1])];
        // This must be exact: an error here affects entire rows, while rounding errors below stay
        // that small.
        let way: i32 = edges.clone().map(|edge| edge.on_the_way_right(on_side, centre(cell[0]))).sum();
        self.steps[0] = f64::from(winding - way);
        // Range of columns and rows that edges reach.
        let mut reached = [[side as f64, 0.0]; 2];
        for edge in edges {
            let local =
                [edge.a, edge.b].map(|at| [0, 1].map(|axis| (at[axis] - origin[axis]) as f64 / PARTS as f64));
            for corner in local {
                for (reached, at) in reached.iter_mut().zip(corner) {
                    *reached = [reached[0].min(at), reached[1].max(at)];
                }
            }
            let crossing = edge.passes(0, origin[0]).then(|| {
                let [[x, y], [to_x, to_y]] = local;
                y + (to_y - y) * (-x / (to_x - x))
            });
            if let Some(y) = crossing {
                self.cross_left_side(y, f64::from(edge.direction(0)), edge.is_above(on_side));
            }
            self.add_edge(local, crossing);
        }
        let cells = |at: [f64; 2]| {
            let [from, to] = at.map(|at| at.clamp(0.0, side as f64));
            from as usize..(to.ceil() as usize).max(from as usize)
        };
        // An edge also changes the cell after those that it crosses.
        let (columns, rows) = (cells(reached[0]), cells(reached[1]));
        let columns = columns.start..(columns.end + 1).min(side);
        let mut sum = 0.0;
        for row in 0..side {
            let cells = |columns: Range<usize>| row * side + columns.start..row * side + columns.end;
            sum += self.steps[row];
            let mut share = sum + self.left[row];
            let touched = &mut self.touched[row];
            if !rows.contains(&row) {
                if shares.add(share, cells(0..side)) {
                    *touched = 0..side;
                }
                continue;
            }
            let mut reached = columns.clone();
            if shares.add(share, cells(0..columns.start)) {
                reached.start = 0;
            }
            let changes = &mut self.changes[row * (side + 1)..(row + 1) * (side + 1)];
            for column in columns.clone() {
                share += changes[column];
                shares.add(share, cells(column..column + 1));
            }
            if shares.add(share, cells(columns.end..side)) {
                reached.end = side;
            }
            *touched = touched.start.min(reached.start)..touched.end.max(reached.end);
            changes[columns.start..].fill(0.0);
        }
    }

    /// Adds an edge that crosses the left side at `y`, above or below the centre of the first row.
    fn cross_left_side(&mut self, y: f64, direction: f64, is_above: bool) {
        let side = self.side as f64;
        let y = if is_above { y.clamp(0.5, side) } else { y.clamp(0.0, 0.5) };
        let row = (y as usize).min(self.side - 1);
        let above = (row + 1) as f64 - y;
        if is_above {
            self.left[row] += direction * above;
            self.steps[row + 1] += direction;
        } else {
            // Below the centre, only the first row changes.
            self.left[row] -= direction * (1.0 - above);
        }
    }

    /// Adds the change that an edge causes to its right, within the block.
    fn add_edge(&mut self, [[ax, ay], [bx, by]]: [[f64; 2]; 2], crossing: Option<f64>) {
        let side = self.side as f64;
        // A downward edge has the opposite sign.
        let (sign, [ax, ay], [bx, by]) =
            if ay <= by { (-1.0, [ax, ay], [bx, by]) } else { (1.0, [bx, by], [ax, ay]) };
        let (mut low, mut high) = (ay.max(0.0), by.min(side));
        if low >= high || (ax <= 0.0 && bx <= 0.0) {
            return;
        }
        // An edge's segment left of the block matters only through its crossing of the left side.
        if let Some(y) = crossing {
            if ax <= 0.0 { low = low.max(y) } else { high = high.min(y) }
        }
        let at = |y: f64| (ax + (bx - ax) * ((y - ay) / (by - ay))).max(0.0);
        let mut row = low as usize;
        while row < self.side && (row as f64) < high {
            let (from, to) = (low.max(row as f64), high.min((row + 1) as f64));
            if from < to {
                self.add_in_row(row, [at(from), at(to)], sign * (to - from));
            }
            row += 1;
        }
    }

    /// Adds the segment of an edge within a row: its ends, and its signed height.
    fn add_in_row(&mut self, row: usize, [start, end]: [f64; 2], height: f64) {
        let changes = &mut self.changes[row * (self.side + 1)..(row + 1) * (self.side + 1)];
        let (least, most) = (start.min(end), start.max(end));
        let (first, last) = (least as usize, (most.ceil() as usize).max(least as usize + 1));
        for column in first..last.min(self.side) {
            let (from, to) = (least.max(column as f64), most.min((column + 1) as f64));
            let part = if most > least { height * (to - from) / (most - least) } else { height };
            let middle = (from + to) / 2.0 - column as f64;
            changes[column] += part * (1.0 - middle);
            changes[column + 1] += part * middle;
        }
    }
}
