//! Cells of a block that a shape covers, by their centres or by contact, as bits in rows.

use super::edge::{Edge, PARTS, Point, centre};

/// Bits of a square block of cells, row by row.
pub(super) struct Mask {
    /// Number of cells along a side.
    side: usize,
    /// Words per row.
    words: usize,
    bits: Vec<u64>,
}

impl Mask {
    /// Creates an empty mask.
    pub(super) fn new(side: usize) -> Mask {
        let words = side.div_ceil(64);
        Mask { side, words, bits: vec![0; words * side] }
    }

    /// Sets or clears all cells.
    pub(super) fn fill(&mut self, is_in: bool) {
        self.bits.fill(if is_in { !0 } else { 0 });
    }

    /// Sets some cells of a row.
    fn insert(&mut self, row: usize, columns: std::ops::Range<usize>) {
        let row = &mut self.bits[row * self.words..(row + 1) * self.words];
        for column in columns {
            row[column / 64] |= 1 << (column % 64);
        }
    }

    /// Calls `show` with the index of each set cell, row by row.
    pub(super) fn each(&self, mut show: impl FnMut(usize)) {
        for (row, words) in self.bits.chunks_exact(self.words).enumerate() {
            for (word, bits) in words.iter().enumerate() {
                let mut bits = match self.side - word * 64 {
                    rest @ ..64 => *bits & ((1 << rest) - 1),
                    _ => *bits,
                };
                while bits != 0 {
                    show(row * self.side + word * 64 + bits.trailing_zeros() as usize);
                    bits &= bits - 1;
                }
            }
        }
    }

    /// Sets the cells whose centres are inside a polygon, given its edges in the block, the block's
    /// first cell, and whether that cell's centre is inside.
    pub(super) fn centres<'a>(
        &mut self,
        edges: impl Iterator<Item = &'a Edge>,
        cell: Point,
        is_inside: bool,
    ) {
        self.fill(false);
        let side = self.side as i64;
        let first = cell.map(centre);
        // A bit of the first column is the difference of a row's first cell from the row before.
        // Bits of other columns are differences from the column before.
        if is_inside {
            self.flip(0, 0);
        }
        for edge in edges {
            let [left, right] = edge.range(0);
            if left <= first[0] && first[0] < right && edge.is_above(first) {
                let row = first_row_above(edge, first, side);
                if row < side {
                    self.flip(row, 0);
                }
            }
            let [low, high] = edge.range(1);
            let row_at = |y: i64| (y - first[1] + PARTS - 1).div_euclid(PARTS).clamp(0, side);
            for row in row_at(low)..row_at(high) {
                let column = edge.column([first[0], first[1] + row * PARTS], side);
                if column > 0 && column < side {
                    self.flip(row, column);
                }
            }
        }
        let mut is_inside = false;
        for row in self.bits.chunks_exact_mut(self.words) {
            is_inside ^= row[0] & 1 == 1;
            row[0] = row[0] & !1 | u64::from(is_inside);
            let mut before = 0;
            for word in row {
                // Prefix parity: each bit becomes the parity of all bits up to it.
                for shift in [1, 2, 4, 8, 16, 32] {
                    *word ^= *word << shift;
                }
                *word ^= before;
                before = if *word >> 63 == 1 { !0 } else { 0 };
            }
        }
    }

    fn flip(&mut self, row: i64, column: i64) {
        self.bits[row as usize * self.words + column as usize / 64] ^= 1 << (column % 64);
    }

    /// Sets the cells whose interior edges meet; for lines, the cells that contain any of their
    /// points.
    pub(super) fn touch<'a>(&mut self, edges: impl Iterator<Item = &'a Edge>, cell: Point, is_line: bool) {
        let side = self.side as i64;
        let origin = cell.map(|cell| cell * PARTS);
        let clamp = |cell: i64| cell.clamp(0, side);
        // An edge that ends on the side of a cell does not enter it, unless it is a point.
        let end =
            |at: i64, is_in: bool| if is_in { at.div_euclid(PARTS) + 1 } else { -(-at).div_euclid(PARTS) };
        for edge in edges {
            let [low, high] = edge.range(1).map(|y| y - origin[1]);
            for row in clamp(low.div_euclid(PARTS))..clamp(end(high, is_line)) {
                let [least, most] = within_row(edge, origin[1] + row * PARTS).map(|x| x - origin[0]);
                // A cell contains its left and upper sides. An edge that continues or ends in the
                // next row has its last point there.
                let goes_on = high >= (row + 1) * PARTS && edge.leads_right_and_up() && least < most;
                let columns = clamp(least.div_euclid(PARTS))..clamp(end(most, is_line && !goes_on));
                self.insert(row as usize, columns.start as usize..columns.end as usize);
            }
        }
    }

    /// Sets the cells whose centres are at most `radius` from an edge.
    pub(super) fn near<'a>(&mut self, edges: impl Iterator<Item = &'a Edge>, cell: Point, radius: i64) {
        let (side, first) = (self.side as i64, cell.map(centre));
        // Cell numbers, including those before and after the block.
        let clamp = |cells: i64| cells.clamp(0, side);
        for edge in edges {
            let [low, high] = edge.range(1).map(|y| y - first[1]);
            let Edge { a, b } = edge.rising(1);
            let (run, rise) = ((b[0] - a[0]) as f64, (b[1] - a[1]) as f64);
            let rows = clamp((low - radius).div_euclid(PARTS))..clamp((high + radius).div_euclid(PARTS) + 1);
            for row in rows {
                let y = first[1] + row * PARTS;
                // The segment of the edge near the row bounds the columns to check; one more on
                // each side allows for rounding.
                let at = |y: i64| {
                    let part = if rise > 0.0 { ((y - a[1]) as f64 / rise).clamp(0.0, 1.0) } else { 0.0 };
                    (a[0] - first[0]) as f64 + run * part
                };
                let (start, end) = match rise > 0.0 {
                    true => (at(y - radius), at(y + radius)),
                    false => ((a[0] - first[0]) as f64, (b[0] - first[0]) as f64),
                };
                let column = |x: f64| (x / PARTS as f64).floor().clamp(-2.0, side as f64 + 2.0) as i64;
                let reach = radius as f64;
                let columns =
                    clamp(column(start.min(end) - reach) - 1)..clamp(column(start.max(end) + reach) + 2);
                for column in columns {
                    if edge.is_within(radius, [first[0] + column * PARTS, y]) {
                        self.insert(row as usize, column as usize..column as usize + 1);
                    }
                }
            }
        }
    }

    /// Sets the cell of each point in the block.
    pub(super) fn points<'a>(&mut self, points: impl Iterator<Item = &'a Edge>, cell: Point) {
        let side = self.side;
        for at in points.filter_map(|point| index_of(point.a, cell, side)) {
            self.insert(at / side, at % side..at % side + 1);
        }
    }
}

/// Returns the index of the block's cell that contains a point.
pub(super) fn index_of(point: Point, cell: Point, side: usize) -> Option<usize> {
    let [x, y] = [0, 1].map(|axis| point[axis].div_euclid(PARTS) - cell[axis]);
    let is_inside = |at: i64| (0..side as i64).contains(&at);
    (is_inside(x) && is_inside(y)).then(|| y as usize * side + x as usize)
}

/// Returns the first row whose centre, in the column of a point, is not below an edge that is above
/// the point.
pub(super) fn first_row_above(edge: &Edge, first: Point, rows: i64) -> i64 {
    let is_above = |row: i64| edge.is_above([first[0], first[1] + row * PARTS]);
    // There are few rows: bisection is fast, and has no rounding.
    let (mut low, mut high) = (0, rows);
    while low + 1 < high {
        let middle = (low + high) / 2;
        if is_above(middle) { low = middle } else { high = middle }
    }
    high
}

/// Returns the minimum and maximum x of an edge within a row of cells that starts at `low`, rounded
/// outwards.
fn within_row(edge: &Edge, low: i64) -> [i64; 2] {
    let (high, Edge { a, b }) = (low + PARTS, edge.rising(1));
    let (dx, dy) = (i128::from(b[0] - a[0]), i128::from(b[1] - a[1]));
    let at = |y: i64| {
        let run = i128::from(y - a[1]) * dx;
        [run.div_euclid(dy), -(-run).div_euclid(dy)].map(|x| a[0] + x as i64)
    };
    let ends = [a, b].map(|corner| match corner[1] {
        y if y < low => at(low),
        y if y > high => at(high),
        _ => [corner[0]; 2],
    });
    let [[a, b], [c, d]] = ends;
    [a.min(b).min(c).min(d), a.max(b).max(c).max(d)]
}
