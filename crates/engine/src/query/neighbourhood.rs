//! A block of cells and the cells around it: its faces, and the occupancy gradients at the faces.

/// Levels of a block, which has 32 x 32 x 32 cells.
pub(super) const BLOCK: u8 = 5;
/// Radius in cells of the ball that a face's normal comes from. It is larger than for rendering,
/// because a face biases the normal at its own centre towards its axis.
const REACH: usize = 4;
/// Number of cells along an edge of the neighbourhood.
const SIDE: usize = (1 << BLOCK) + 2 * REACH;

/// Occupancy of a block and of all cells within [`REACH`] of it.
pub(super) struct Neighbourhood {
    /// First cell along each axis.
    min: [i64; 3],
    /// Occupancy of the cells, 255 for full; x fastest, then y, then z.
    fills: Vec<i16>,
    /// Cells in the solid: bit x of row `z * SIDE + y`.
    solid: Vec<u64>,
    /// Whether all cells in the solid are full and all others empty. The bits then suffice.
    is_binary: bool,
}

impl Neighbourhood {
    pub(super) fn new() -> Neighbourhood {
        Neighbourhood {
            min: [0; 3],
            fills: vec![0; SIDE * SIDE * SIDE],
            solid: vec![0; SIDE * SIDE],
            is_binary: true,
        }
    }

    /// Moves to the block that starts at a cell, and empties all cells.
    pub(super) fn clear(&mut self, block: [i64; 3]) {
        self.min = block.map(|min| min - REACH as i64);
        self.fills.fill(0);
        self.solid.fill(0);
        self.is_binary = true;
    }

    /// Returns whether a cube of `2^height` cells along each axis intersects the neighbourhood.
    pub(super) fn meets(&self, min: [i64; 3], height: u8) -> bool {
        (0..3).all(|axis| {
            min[axis] < self.min[axis] + SIDE as i64 && min[axis] + (1 << height) > self.min[axis]
        })
    }

    /// Fills a cube of `2^height` cells along each axis.
    pub(super) fn paint(&mut self, min: [i64; 3], height: u8, is_solid: bool, fill: u8) {
        let within = |at: i64, axis: usize| (at - self.min[axis]).clamp(0, SIDE as i64) as usize;
        let from: [usize; 3] = std::array::from_fn(|axis| within(min[axis], axis));
        let to: [usize; 3] = std::array::from_fn(|axis| within(min[axis] + (1 << height), axis));
        let width = to[0].saturating_sub(from[0]);
        if width == 0 {
            return;
        }
        self.is_binary &= fill == if is_solid { 255 } else { 0 };
        let bits = if is_solid { (u64::MAX >> (64 - width)) << from[0] } else { 0 };
        for z in from[2]..to[2] {
            for y in from[1]..to[1] {
                let row = z * SIDE + y;
                self.solid[row] |= bits;
                self.fills[row * SIDE + from[0]..][..width].fill(i16::from(fill));
            }
        }
    }

    /// Passes the faces across an axis between cells inside and outside of the solid to `each`, for
    /// some planes of a block with `side` cells along each axis. A face is given by the cell whose
    /// low side it is.
    pub(super) fn each_face(
        &self,
        axis: usize,
        side: usize,
        planes: std::ops::Range<usize>,
        mut each: impl FnMut([usize; 3]),
    ) {
        let all = 0..side;
        let of = |of: usize| if of == axis { planes.clone() } else { all.clone() };
        let columns = of(0);
        let mask = (u64::MAX >> (64 - columns.len())) << (REACH + columns.start);
        for z in of(2) {
            for y in of(1) {
                let row = (z + REACH) * SIDE + y + REACH;
                let before = match axis {
                    0 => self.solid[row] << 1,
                    1 => self.solid[row - 1],
                    _ => self.solid[row - SIDE],
                };
                let mut faces = (self.solid[row] ^ before) & mask;
                while faces != 0 {
                    let x = faces.trailing_zeros() as usize;
                    faces &= faces - 1;
                    each([x, y + REACH, z + REACH]);
                }
            }
        }
    }

    /// Returns the direction in which occupancy grows at the low side of a cell, of any length, as
    /// [`Field::gradient`](super::field::Field::gradient) does.
    pub(super) fn gradient(&self, ball: &Ball, [x, y, z]: [usize; 3]) -> [f64; 3] {
        if self.is_binary {
            return ball
                .moments_of_bits(&self.solid[(z - REACH) * SIDE + y - REACH..], x - REACH)
                .map(f64::from);
        }
        let at = ((z - REACH) * SIDE + y - REACH) * SIDE + x - REACH;
        let mut fills = [0i16; MOST * WIDTH];
        for (start, row) in ball.starts.iter().zip(fills.chunks_exact_mut(WIDTH)) {
            row.copy_from_slice(&self.fills[at + start..][..WIDTH]);
        }
        ball.weights.each_ref().map(|weights| f64::from(dot(&fills, weights)))
    }
}

/// Cells per row of a ball.
const WIDTH: usize = 2 * REACH;
/// Maximum number of rows of a ball.
const MOST: usize = 56;

/// Weights of the cells in the ball around a cell's low side. They fall to 0 at the sphere.
pub(super) struct Ball {
    /// Start of each row, relative to the cell [`REACH`] cells before along each axis.
    starts: Vec<usize>,
    /// A cell's weight times its distance along each axis, times 8: integers.
    weights: Box<[[i16; MOST * WIDTH]; 3]>,
    /// The rows as rows of bits.
    rows: Vec<Row>,
    /// For each kind of row and each bit pattern of its cells: the sum of their weights in the
    /// lower half, and the sum of weights times distances along x in the upper half.
    sums: Vec<[i64; 1 << WIDTH]>,
    /// Axis that the face is across.
    axis: usize,
}

/// A row of cells in a ball.
struct Row {
    /// Row of bits, relative to the row [`REACH`] rows before along y and z.
    row: usize,
    /// Bit of the row's first cell, relative to the cell [`REACH`] cells before.
    shift: usize,
    /// Index in the table of pattern sums.
    kind: usize,
    /// Index along y and z.
    at: [usize; 2],
}

impl Ball {
    /// Creates the ball around the centre of a face across an axis.
    pub(super) fn of(axis: usize) -> Ball {
        let weights = Box::new([[0; MOST * WIDTH]; 3]);
        let mut ball = Ball { starts: Vec::new(), weights, rows: Vec::new(), sums: Vec::new(), axis };
        let mut kinds: Vec<i64> = Vec::new();
        let reach = REACH as i64;
        let first = if axis == 0 { -reach } else { 1 - reach };
        for (dz, dy) in (-reach..reach).flat_map(|dz| (-reach..reach).map(move |dy| (dz, dy))) {
            let rest = 4 * reach * reach - twice(axis, 2, dz).pow(2) - twice(axis, 1, dy).pow(2);
            if rest <= 0 {
                continue;
            }
            let row = ball.starts.len() * WIDTH;
            let mut cells = [(0, 0); WIDTH];
            for (step, cell) in cells.iter_mut().enumerate() {
                let away = [twice(axis, 0, first + step as i64), twice(axis, 1, dy), twice(axis, 2, dz)];
                let weight = (rest - away[0].pow(2)).max(0);
                *cell = (weight, weight * away[0]);
                for (weights, away) in ball.weights.iter_mut().zip(away) {
                    weights[row + step] = (weight * away) as i16;
                }
            }
            let [z, y, x] = [dz, dy, first].map(|cell| (cell + reach) as usize);
            ball.starts.push((z * SIDE + y) * SIDE + x);
            let kind = kinds.iter().position(|kind| *kind == rest).unwrap_or_else(|| {
                kinds.push(rest);
                ball.sums.push(std::array::from_fn(|pattern| {
                    let there = cells.iter().enumerate().filter(|(bit, _)| pattern >> bit & 1 > 0);
                    there.map(|(_, (weight, along))| weight + (along << 32)).sum()
                }));
                kinds.len() - 1
            });
            ball.rows.push(Row { row: z * SIDE + y, shift: x, kind, at: [y, z] });
        }
        ball
    }

    /// Returns the sums of weights times distances of the cells whose bits are set. The first bit
    /// of the first row is [`REACH`] cells before the face's cell.
    #[inline]
    fn moments_of_bits(&self, solid: &[u64], x: usize) -> [i32; 3] {
        let (mut all, mut lines) = (0, [[0i64; WIDTH]; 2]);
        for Row { row, shift, kind, at } in &self.rows {
            let pattern = solid[*row] >> (x + shift) & 0xff;
            let sums = self.sums[*kind][pattern as usize];
            all += sums;
            lines[0][at[0]] += sums;
            lines[1][at[1]] += sums;
        }
        let [y, z] = [1, 2].map(|along| {
            let weights = lines[along - 1].iter().map(|sums| *sums as i32);
            (0..)
                .zip(weights)
                .map(|(at, weight)| twice(self.axis, along, at - REACH as i64) as i32 * weight)
                .sum()
        });
        [(all >> 32) as i32, y, z]
    }
}

/// Returns twice the distance of a cell from the centre of a face across an axis; odd along that
/// axis.
fn twice(axis: usize, along: usize, cell: i64) -> i64 {
    2 * cell + i64::from(along == axis)
}

/// Returns the sum of products. It is below 2^31: weights are below 2^9 in magnitude, occupancies
/// below 2^8, and there are fewer than 2^9 products.
fn dot(numbers: &[i16; MOST * WIDTH], weights: &[i16; MOST * WIDTH]) -> i32 {
    numbers.iter().zip(weights).map(|(number, weight)| i32::from(*number) * i32::from(*weight)).sum()
}
