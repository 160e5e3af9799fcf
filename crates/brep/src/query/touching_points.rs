//! Points of planar rings that are within edges of rings: where rings touch themselves or each
//! other without a common vertex.

type Point = [f64; 3];

/// A uniform grid of squares, and the points in each.
struct Squares {
    low: [f64; 2],
    /// Side of a square.
    side: f64,
    columns: usize,
    rows: usize,
    /// Start of each square's points in `points`, and the end of the last one's.
    starts: Vec<usize>,
    points: Vec<u32>,
}

impl Squares {
    /// Creates about as many squares as points.
    fn of(points: &[[f64; 2]]) -> Squares {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            low = [0, 1].map(|axis| low[axis].min(point[axis]));
            high = [0, 1].map(|axis| high[axis].max(point[axis]));
        }
        let size = [0, 1].map(|axis| (high[axis] - low[axis]).max(f64::MIN_POSITIVE));
        // (Limits the number along an axis, for long and thin extents.)
        let side = (size[0] * size[1] / points.len() as f64)
            .sqrt()
            .max(size[0].max(size[1]) / points.len().min(1 << 16) as f64);
        let [columns, rows] = size.map(|size| (size / side) as usize + 1);
        let mut squares = Squares { low, side, columns, rows, starts: Vec::new(), points: Vec::new() };
        let mut starts = vec![0; columns * rows + 1];
        points.iter().for_each(|point| starts[squares.square(point) + 1] += 1);
        (1..starts.len()).for_each(|square| starts[square] += starts[square - 1]);
        squares.points = vec![0; points.len()];
        let mut next = starts.clone();
        for (number, point) in (0..).zip(points) {
            let square = squares.square(point);
            squares.points[next[square]] = number;
            next[square] += 1;
        }
        squares.starts = starts;
        squares
    }

    fn place(&self, at: f64, axis: usize) -> usize {
        let count = [self.columns, self.rows][axis];
        (((at - self.low[axis]) / self.side).max(0.0) as usize).min(count - 1)
    }

    fn square(&self, point: &[f64; 2]) -> usize {
        self.place(point[1], 1) * self.columns + self.place(point[0], 0)
    }

    /// Visits the numbers of all points in squares that are within a distance of an edge.
    fn each_near(&self, [a, b]: [[f64; 2]; 2], distance: f64, each: &mut dyn FnMut(u32)) {
        let (a, b) = if a[0] <= b[0] { (a, b) } else { (b, a) };
        let at = |x: f64| match b[0] > a[0] {
            true => a[1] + (b[1] - a[1]) * ((x - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0),
            false => a[1],
        };
        for column in self.place(a[0] - distance, 0)..=self.place(b[0] + distance, 0) {
            let left = self.low[0] + column as f64 * self.side;
            let (mut from, mut to) = (at(left - distance), at(left + self.side + distance));
            if b[0] - a[0] <= 2.0 * distance {
                (from, to) = (a[1], b[1]);
            }
            let (low, high) = (from.min(to) - distance, from.max(to) + distance);
            let row = |row: usize| row * self.columns + column;
            for row in (self.place(low, 1)..=self.place(high, 1)).map(row) {
                self.points[self.starts[row]..self.starts[row + 1]].iter().for_each(|number| each(*number));
            }
        }
    }
}

/// Inserts points of all rings into edges that pass them within a distance. Each ring ends with its
/// first point; `axes` are those of the plane.
///
/// Cost: O(n) for n points, and O(n^1.5) if all edges are as long as the rings are wide.
pub(super) fn insert(rings: &mut [Vec<Point>], axes: [Point; 2], distance: f64) {
    let flat = |point: &Point| axes.map(|along| (0..3).map(|axis| along[axis] * point[axis]).sum::<f64>());
    let all: Vec<Point> = rings.iter().flat_map(|ring| &ring[1..]).copied().collect();
    if all.is_empty() {
        return;
    }
    let positions: Vec<[f64; 2]> = all.iter().map(flat).collect();
    let squares = Squares::of(&positions);
    let mut within: Vec<(f64, u32)> = Vec::new();
    for ring in rings {
        let mut found = Vec::new();
        for (number, ends) in ring.windows(2).enumerate() {
            let [a, b] = [flat(&ends[0]), flat(&ends[1])];
            let along = [b[0] - a[0], b[1] - a[1]];
            let length = along[0].hypot(along[1]);
            within.clear();
            squares.each_near([a, b], distance, &mut |point| {
                let from = [0, 1].map(|axis| positions[point as usize][axis] - a[axis]);
                let way = (from[0] * along[0] + from[1] * along[1]) / length;
                let away = (from[0] * along[1] - from[1] * along[0]).abs() / length;
                if away <= distance && way > distance && way < length - distance {
                    within.push((way, point));
                }
            });
            within.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            found.extend(within.iter().map(|(_, point)| (number + 1, all[*point as usize])));
        }
        if found.is_empty() {
            continue;
        }
        let mut found = found.into_iter().peekable();
        let mut longer = Vec::with_capacity(ring.len() + 1);
        for (number, point) in ring.iter().enumerate() {
            while let Some((_, point)) = found.next_if(|(before, _)| *before == number) {
                longer.push(point);
            }
            longer.push(*point);
        }
        *ring = longer;
    }
}
