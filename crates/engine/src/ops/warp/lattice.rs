//! Source positions of a lattice of target points: exact for some, by polynomials between them.

use super::mapping::CellMap;

/// Maximum error of polynomials, in source cells.
const CLOSE: f64 = 1e-4;
/// Points along a side of a rectangle that is computed point by point.
const FEW: usize = 4;

/// Positions in source cells of target points in rows. Undefined positions are NaN.
pub(super) enum Lattice {
    /// Source columns depend on target columns only, and rows on rows.
    Separable {
        /// Position of each column.
        columns: Vec<f64>,
        /// Position of each row.
        rows: Vec<f64>,
    },
    /// Any map.
    Points {
        /// Points in a row.
        width: usize,
        /// Row by row.
        points: Vec<[f64; 2]>,
    },
}

/// Rectangle of a block's points: its first column and row, and its size.
pub(super) type LatticeWindow = ([usize; 2], [usize; 2]);

impl Lattice {
    /// Part of a block's lattice. The block's first point is `first`, in target cells; points are
    /// one cell apart. A point's position does not depend on the requested part.
    pub(super) fn new(map: &CellMap, first: [f64; 2], block: [usize; 2], part: LatticeWindow) -> Lattice {
        let (at, [width, height]) = part;
        if map.is_separable() {
            return Lattice::separable(
                map,
                [0, 1].map(|axis| first[axis] + at[axis] as f64),
                [width, height],
            );
        }
        let mut filling = Filling { map, first, part, points: vec![[f64::NAN; 2]; width * height] };
        filling.fill(([0, 0], block));
        let mut points = filling.points;
        if let Some(turn) = map.whole_turn() {
            let mut near = TurnUnwrapper::new(turn);
            for row in points.chunks_exact_mut(width) {
                near.move_near_last(&mut row[0][0]);
                let mut along = near;
                row.iter_mut().for_each(|point| along.move_near_last(&mut point[0]));
            }
        }
        Lattice::Points { width, points }
    }

    /// Lattice of a map that is separable by columns and rows.
    fn separable(map: &CellMap, first: [f64; 2], size: [usize; 2]) -> Lattice {
        // (If one row is undefined, so are all columns in it, but another row may be defined.)
        let place = |at: f64, axis: usize| {
            let last = size[1 - axis] - 1;
            let mut others = [0, last / 2, last].into_iter().map(|other| other as f64);
            let found = others.find_map(|other| {
                let steps = if axis == 0 { [at, other] } else { [other, at] };
                map.to_source([first[0] + steps[0], first[1] + steps[1]])
            });
            found.map_or(f64::NAN, |place| place[axis])
        };
        // A cell may be as wide as the world if there are few of them; a quarter of a cell is not.
        let parts = if size[0] <= FEW { 4 } else { 1 };
        let mut near = map.whole_turn().map(TurnUnwrapper::new);
        let mut columns = Vec::with_capacity(size[0]);
        for part in 0..=(size[0] - 1) * parts {
            let mut column = place(part as f64 / parts as f64, 0);
            near.iter_mut().for_each(|near| near.move_near_last(&mut column));
            if part % parts == 0 {
                columns.push(column);
            }
        }
        Lattice::Separable { columns, rows: (0..size[1]).map(|row| place(row as f64, 1)).collect() }
    }

    /// Multiplies all positions by a factor, for cells of another size.
    pub(super) fn scale(&mut self, factor: f64) {
        match self {
            Lattice::Separable { columns, rows } => {
                columns.iter_mut().chain(rows).for_each(|number| *number *= factor);
            }
            Lattice::Points { points, .. } => {
                points.as_flattened_mut().iter_mut().for_each(|number| *number *= factor)
            }
        }
    }

    /// Minimum and maximum position along each axis; `None` if no point has a position.
    pub(super) fn bounds(&self) -> Option<([f64; 2], [f64; 2])> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut meet = |axis: usize, number: f64| {
            // (`min` and `max` ignore NaN.)
            (low[axis], high[axis]) = (low[axis].min(number), high[axis].max(number));
        };
        match self {
            Lattice::Separable { columns, rows } => {
                columns.iter().for_each(|column| meet(0, *column));
                rows.iter().for_each(|row| meet(1, *row));
            }
            Lattice::Points { points, .. } => {
                points.iter().filter(|[x, y]| x.is_finite() && y.is_finite()).for_each(|[x, y]| {
                    meet(0, *x);
                    meet(1, *y);
                })
            }
        }
        (low[0] <= high[0] && low[1] <= high[1]).then_some((low, high))
    }

    /// Position of a point.
    #[inline]
    pub(super) fn at(&self, x: usize, y: usize) -> [f64; 2] {
        match self {
            Lattice::Separable { columns, rows } => [columns[x], rows[y]],
            Lattice::Points { width, points } => points[y * width + x],
        }
    }
}

/// Last column, next to which the next one lies: less than half a turn of the source apart.
#[derive(Clone, Copy)]
struct TurnUnwrapper {
    turn: f64,
    column: Option<f64>,
}

impl TurnUnwrapper {
    fn new(turn: i64) -> TurnUnwrapper {
        TurnUnwrapper { turn: turn as f64, column: None }
    }

    /// Moves a column by whole turns next to the last one.
    fn move_near_last(&mut self, column: &mut f64) {
        if column.is_finite() {
            let near = *self.column.get_or_insert(*column);
            *column += self.turn * ((near - *column) / self.turn).round();
            self.column = Some(*column);
        }
    }
}

/// Points of a block, part of which is being computed.
struct Filling<'a> {
    map: &'a CellMap,
    /// First point of the block.
    first: [f64; 2],
    part: LatticeWindow,
    /// Positions of the part's points.
    points: Vec<[f64; 2]>,
}

impl Filling<'_> {
    /// Fills the intersection of a rectangle with the requested part: by a polynomial if that is
    /// accurate enough, else recursively in four quarters.
    fn fill(&mut self, (at, size): LatticeWindow) {
        let (start, wanted) = self.part;
        let from = [0, 1].map(|axis| at[axis].max(start[axis]));
        let end = [0, 1].map(|axis| (at[axis] + size[axis]).min(start[axis] + wanted[axis]));
        if from[0] >= end[0] || from[1] >= end[1] {
            return;
        }
        let (map, first) = (self.map, self.first);
        let place =
            |x: f64, y: f64| map.to_source([first[0] + at[0] as f64 + x, first[1] + at[1] as f64 + y]);
        let [width, height] = size;
        let few = width <= FEW || height <= FEW;
        let span = [(width - 1) as f64, (height - 1) as f64];
        let patch = if few { None } else { Patch::new(&|[u, v]| place(u * span[0], v * span[1]), CLOSE) };
        if few || patch.is_some() {
            for y in from[1]..end[1] {
                let row = (y - start[1]) * wanted[0] + from[0] - start[0];
                let down = (y - at[1]) as f64;
                let polynomials = patch.as_ref().map(|patch| patch.row(down / span[1]));
                for (x, point) in (from[0]..end[0]).zip(&mut self.points[row..]) {
                    let along = (x - at[0]) as f64;
                    *point = match polynomials {
                        Some(row) => {
                            let u = along / span[0];
                            row.map(|[a, b, c]| a + u * (b + u * c))
                        }
                        None => place(along, down).unwrap_or([f64::NAN; 2]),
                    };
                }
            }
            return;
        }
        let (half, rest) = ([width / 2, height / 2], [width - width / 2, height - height / 2]);
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let pick = |axis: usize, second: usize| match second {
                0 => (at[axis], half[axis]),
                _ => (at[axis] + half[axis], rest[axis]),
            };
            let ((x, width), (y, height)) = (pick(0, x), pick(1, y));
            self.fill(([x, y], [width, height]));
        }
    }
}

/// Polynomial of degree two along each axis for each of the two coordinates, over the unit square.
pub(super) struct Patch {
    /// Factors of `u^i v^j` at `[axis][j][i]`.
    factors: [[[f64; 3]; 3]; 2],
}

impl Patch {
    /// Polynomial through nine positions of a map of the unit square, if its error is at most
    /// `close` at five others; also `None` if one of them is undefined.
    pub(super) fn new(place: &dyn Fn([f64; 2]) -> Option<[f64; 2]>, close: f64) -> Option<Patch> {
        let mut values = [[[0.0; 3]; 3]; 2];
        for (j, v) in [0.0, 0.5, 1.0].into_iter().enumerate() {
            for (i, u) in [0.0, 0.5, 1.0].into_iter().enumerate() {
                let [x, y] = place([u, v])?;
                (values[0][j][i], values[1][j][i]) = (x, y);
            }
        }
        let quadratic = |[a, b, c]: [f64; 3]| [a, 4.0 * b - 3.0 * a - c, 2.0 * (a + c) - 4.0 * b];
        let factors = values.map(|rows| {
            let rows = rows.map(quadratic);
            let columns: [[f64; 3]; 3] =
                std::array::from_fn(|i| quadratic([rows[0][i], rows[1][i], rows[2][i]]));
            std::array::from_fn(|j| std::array::from_fn(|i| columns[i][j]))
        });
        let patch = Patch { factors };
        for [u, v] in [[0.25, 0.25], [0.75, 0.2], [0.2, 0.75], [0.8, 0.8], [0.45, 0.4]] {
            let (expected, [x, y]) = (place([u, v])?, patch.row(v).map(|[a, b, c]| a + u * (b + u * c)));
            if (x - expected[0]).abs() > close || (y - expected[1]).abs() > close {
                return None;
            }
        }
        Some(patch)
    }

    /// Polynomial of each coordinate along a row.
    #[inline]
    fn row(&self, v: f64) -> [[f64; 3]; 2] {
        self.factors.map(|rows| std::array::from_fn(|i| rows[0][i] + v * (rows[1][i] + v * rows[2][i])))
    }

    /// Box around all positions, by the polynomial's Bernstein form.
    pub(super) fn bounds(&self) -> ([f64; 2], [f64; 2]) {
        let bernstein = |[a, b, c]: [f64; 3]| [a, a + b / 2.0, a + b + c];
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (axis, rows) in self.factors.iter().enumerate() {
            let rows = rows.map(bernstein);
            let columns = (0..3).map(|i| bernstein([rows[0][i], rows[1][i], rows[2][i]]));
            for number in columns.flatten() {
                (low[axis], high[axis]) = (low[axis].min(number), high[axis].max(number));
            }
        }
        (low, high)
    }
}
