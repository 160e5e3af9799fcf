//! Detects edges without a cell centre between them, by counting instead of visiting rows. Nodes
//! along long thin polygons are thus visited only where these cover cells.

use super::edge::{Edge, PARTS, Point};
use super::mask::first_row_above;

/// Returns whether all centres of a square of cells are on the same side of one edge, or of two,
/// which are all edges of a polygon there. `first` is the centre of the first cell. Returns false
/// if undecided: for intersecting edges, or more than two.
pub(super) fn have_no_centre_between(edges: &[&Edge], first: Point, side: i64) -> bool {
    match *edges {
        [one] => changes(one, first, side) == 0,
        [one, other] => {
            are_ordered(one, other) && changes(one, first, side) + changes(other, first, side) == 0
        }
        _ => false,
    }
}

/// Returns whether each of two edges is on one side of the other, and the area between them is
/// either left of both or right of both.
// Invariant: the winding numbers on both outer sides are then equal, and all others differ from
// them in the same direction. If the sum of all differences is 0, each is 0.
fn are_ordered(one: &Edge, other: &Edge) -> bool {
    let (of_other, of_one) =
        ([other.a, other.b].map(|at| side_of(one, at)), [one.a, one.b].map(|at| side_of(other, at)));
    let mut sides = of_other.into_iter().chain(of_one);
    sides.clone().all(|side| side >= 0) || sides.all(|side| side <= 0)
}

/// Returns the side of an edge's line on which a point is: 1 is left if y points up.
fn side_of(edge: &Edge, [x, y]: Point) -> i32 {
    let Edge { a, b } = edge;
    let product = |one: i64, other: i64| i128::from(one) * i128::from(other);
    let one = product(b[0] - a[0], y - a[1]);
    one.cmp(&product(b[1] - a[1], x - a[0])) as i32
}

/// Sums, over the centres of a square of cells, the change of the winding number that an edge
/// causes on the path from the first centre: up, then right.
fn changes(edge: &Edge, first: Point, side: i64) -> i128 {
    let mut sum = 0;
    let [left, right] = edge.range(0);
    if left <= first[0] && first[0] < right && edge.is_above(first) {
        let rows = side - first_row_above(edge, first, side);
        sum += i128::from(edge.direction(0)) * i128::from(side) * i128::from(rows);
    }
    let [low, high] = edge.range(1);
    let row_at = |y: i64| (y - first[1] + PARTS - 1).div_euclid(PARTS).clamp(0, side);
    let (low, high) = (row_at(low), row_at(high));
    // Rows in which some columns, but not all, are left of the edge; x increases or decreases with
    // the rows.
    let has_left =
        |row: i64, column: i64| edge.is_right_of([first[0] + column * PARTS, first[1] + row * PARTS]);
    let is_growing = edge.rising(1).b[0] >= edge.rising(1).a[0];
    let some = first_of(low, high, |row| has_left(row, 0) == is_growing);
    let all = first_of(low, high, |row| has_left(row, side - 1) == is_growing);
    let (start, end) = if is_growing { (some, all) } else { (all, some) };
    if start >= end {
        return sum;
    }
    let on_the_left = columns(edge, first, start, end - start);
    let on_the_right = i128::from(end - start) * i128::from(side) - on_the_left;
    sum - i128::from(edge.direction(1)) * on_the_right
}

/// Returns the first row from which on the predicate holds; `high` if it never does.
fn first_of(mut low: i64, mut high: i64, is_so: impl Fn(i64) -> bool) -> i64 {
    while low < high {
        let middle = low.midpoint(high);
        if is_so(middle) { high = middle } else { low = middle + 1 }
    }
    low
}

/// Counts the columns with their centre left of an edge, summed over rows that the edge crosses.
fn columns(edge: &Edge, first: Point, row: i64, rows: i64) -> i128 {
    let Edge { a, b } = edge.rising(1);
    let [run, rise] = [0, 1].map(|axis| i128::from(b[axis] - a[axis]));
    let parts = i128::from(PARTS);
    // In row j the edge is at column (start + j * run * PARTS) / (rise * PARTS); columns before
    // that are on its left.
    let start = i128::from(a[0] - first[0]) * rise + i128::from(first[1] + row * PARTS - a[1]) * run;
    -floor_sum(rows.into(), rise * parts, -run * parts, -start)
}

/// Returns the sum of floor((a * i + b) / m) for i from 0 to n - 1, in as many iterations as
/// Euclid's algorithm.
// Invariant: rows and columns are at most 2^29 and coordinates 2^46 grid units, so a, b and m are
// below 2^93, and no product with a row overflows an i128.
fn floor_sum(mut n: i128, mut m: i128, mut a: i128, mut b: i128) -> i128 {
    let mut sum = 0;
    loop {
        sum += n * (n - 1) / 2 * a.div_euclid(m) + n * b.div_euclid(m);
        (a, b) = (a.rem_euclid(m), b.rem_euclid(m));
        let last = a * n + b;
        if last < m {
            return sum;
        }
        (n, b) = (last / m, last % m);
        (m, a) = (a, m);
    }
}

#[cfg(test)]
mod tests {
    use super::super::edge::centre;
    use super::*;

    struct Random(u64);

    impl Random {
        fn below(&mut self, end: i64) -> i64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 33) as i64) % end
        }
    }

    #[test]
    fn sums_are_those_of_all_rows() {
        let mut random = Random(5);
        for _ in 0..2000 {
            let (n, m) = (random.below(20) as i128, 1 + random.below(30) as i128);
            let (a, b) = (random.below(200) as i128 - 100, random.below(200) as i128 - 100);
            let expected: i128 = (0..n).map(|i| (a * i + b).div_euclid(m)).sum();
            assert_eq!(floor_sum(n, m, a, b), expected, "{n} {m} {a} {b}");
        }
    }

    /// Compares with a test of every centre. Edges on a coarse grid often pass through centres, and
    /// along each other.
    #[test]
    fn edges_have_no_centre_between_where_all_have_one_parity() {
        let mut random = Random(9);
        let (side, mut alike, mut unlike, mut unknown) = (8, 0, 0, 0);
        for round in 0..60_000 {
            let grid = [PARTS / 2, PARTS / 4, PARTS, 1][round % 4];
            let mut point = |spread: i64| {
                [0, 1].map(|_| (random.below(spread * PARTS) - spread * PARTS / 3) / grid * grid)
            };
            let (a, b, near) = (point(30), point(30), point(2).map(|at| at / 3));
            // Wedges with arbitrary tips, long thin ones, and strips.
            let (c, d) = match round % 3 {
                0 => (b, point(30)),
                1 => (b, [a[0] + near[0], a[1] + near[1]]),
                _ => ([b[0] + near[0], b[1] + near[1]], [a[0] + near[1], a[1] + near[0]]),
            };
            let pair = [Edge { a, b }, Edge { a: c, b: d }];
            let cell = [random.below(5), random.below(5)];
            // Skip edges that end in the square without continuing there.
            let is_in = |at: Point| {
                (0..2).all(|axis| (cell[axis] * PARTS..=(cell[axis] + side) * PARTS).contains(&at[axis]))
            };
            if a == b || c == d || is_in(a) || is_in(d) || b != c && (is_in(b) || is_in(c)) {
                continue;
            }
            let first = cell.map(centre);
            // Parity along the path up and then right.
            let are_alike = |edges: &[&Edge]| {
                let is_changed = |x: i64, y: i64| {
                    let at = [first[0], first[1] + y * PARTS];
                    let changes = edges.iter().map(|edge| {
                        edge.on_the_way_up(first, at[1]) + edge.on_the_way_right(at, first[0] + x * PARTS)
                    });
                    changes.sum::<i32>() % 2 != 0
                };
                !(0..side).any(|y| (0..side).any(|x| is_changed(x, y)))
            };
            let [one, other] = &pair;
            let lists: &[&[&Edge]] = if is_in(b) { &[&[one, other]] } else { &[&[one, other], &[one]] };
            for edges in lists {
                match (are_alike(edges), have_no_centre_between(edges, first, side)) {
                    (true, true) => alike += 1,
                    (false, false) => unlike += 1,
                    (true, false) => unknown += 1,
                    (false, true) => panic!("{edges:?} {cell:?}"),
                }
            }
        }
        assert!(alike > 10_000 && unlike > 10_000 && unknown < alike / 10, "{alike} {unlike} {unknown}");
    }
}
