//! How much of each cell of a block a polygon has.

use std::ops::Range;

use super::edge::{Edge, PARTS, Point, centre};

/// Share of a cell that rounding alone may leave, or take away: a share is a sum of differences of coordinates in cells of the block, each off by 2^-52 of
/// how far the edge's ends are away; ends a million cells away are off by 2^-32.
const ROUNDING: f64 = 1e-9;

/// A share without what rounding alone may have left, or taken away.
pub(super) fn settled(share: f64) -> f64 {
    match share {
        share if share < ROUNDING => 0.0,
        share if share > 1.0 - ROUNDING => 1.0,
        share => share,
    }
}

/// Shares that polygons cover of the cells of a block.
pub(super) struct Shares {
    sums: Vec<f64>,
    /// Number of polygons that cover a part of each cell, up to 2; [`FULL`] if one covers all of it.
    polygons: Vec<u8>,
}

/// A cell that one polygon covers.
const FULL: u8 = u8::MAX;

impl Shares {
    pub(super) fn new(cells: usize) -> Shares {
        Shares { sums: vec![0.0; cells], polygons: vec![0; cells] }
    }

    /// Adds a share to those of some cells; returns whether it is one.
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

    /// The sum of what was added to a cell since the last call, and how many polygons it is of: 1 for one that covers all of it. The sum of
    /// several is that of their union if they do not overlap.
    pub(super) fn take(&mut self, cell: usize) -> (f64, u8) {
        let sum = std::mem::take(&mut self.sums[cell]);
        match std::mem::take(&mut self.polygons[cell]) {
            FULL => (1.0, 1),
            count => (sum, count),
        }
    }
}

/// Room to measure polygons in a square of cells.
pub(super) struct Coverage {
    side: usize,
    /// Differences of each cell's share from that of the cell before it, in rows of one more; nothing but zeros between measurements.
    changes: Vec<f64>,
    /// Parts of each row that are inside along the block's left side.
    left: Vec<f64>,
    /// The change, from a row on, of what is inside along the left side.
    steps: Vec<f64>,
    /// Columns of each row in which something was added since somebody asked.
    touched: Vec<Range<usize>>,
}

impl Coverage {
    pub(super) fn new(side: usize) -> Coverage {
        let row = || vec![0.0; side + 1];
        let touched = vec![side..0; side];
        Coverage { side, changes: vec![0.0; (side + 1) * side], left: row(), steps: row(), touched }
    }

    /// Cells along a side of the block.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Notes that something is added to some columns of a row.
    pub(super) fn touch(&mut self, row: usize, columns: Range<usize>) {
        let touched = &mut self.touched[row];
        *touched = touched.start.min(columns.start)..touched.end.max(columns.end);
    }

    /// The columns of a row in which something was added since this was asked; outside of them nothing was.
    pub(super) fn take_touched(&mut self, row: usize) -> Range<usize> {
        std::mem::replace(&mut self.touched[row], self.side..0)
    }

    /// Adds the shares that a polygon has of the cells of a block, row after row, by the edges that it has there, the block's first cell, and how
    /// many times the polygon winds round the centre of that. Exact but for rounding, if rings do not cross each other.
    ///
    /// The left side is gone up first, on which each edge that is met changes what is inside; then each edge changes what is on its right.
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
        // (Exactly: a wrong number here would be wrong for whole rows, where rounding below moves a share by no more than that.)
        let way: i32 = edges.clone().map(|edge| edge.on_the_way_right(on_side, centre(cell[0]))).sum();
        self.steps[0] = f64::from(winding - way);
        // Columns and rows that edges reach, from and to.
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
        // (An edge changes the cell behind those that it passes through, too.)
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

    /// Takes an edge into account that crosses the left side at some height, above the first row's centre or below it.
    fn cross_left_side(&mut self, y: f64, direction: f64, is_above: bool) {
        let side = self.side as f64;
        let y = if is_above { y.clamp(0.5, side) } else { y.clamp(0.0, 0.5) };
        let row = (y as usize).min(self.side - 1);
        let above = (row + 1) as f64 - y;
        if is_above {
            self.left[row] += direction * above;
            self.steps[row + 1] += direction;
        } else {
            // (What is below it is the first row's.)
            self.left[row] -= direction * (1.0 - above);
        }
    }

    /// Adds what an edge changes on its right, within the block.
    fn add_edge(&mut self, [[ax, ay], [bx, by]]: [[f64; 2]; 2], crossing: Option<f64>) {
        let side = self.side as f64;
        // (Down it is the other way round.)
        let (sign, [ax, ay], [bx, by]) =
            if ay <= by { (-1.0, [ax, ay], [bx, by]) } else { (1.0, [bx, by], [ax, ay]) };
        let (mut low, mut high) = (ay.max(0.0), by.min(side));
        if low >= high || (ax <= 0.0 && bx <= 0.0) {
            return;
        }
        // What lies left of the block is no more than its crossing of the side.
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

    /// Adds a piece of an edge within a row: its ends, and how much of the row it passes, with a sign.
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
