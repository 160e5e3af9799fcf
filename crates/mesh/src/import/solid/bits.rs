//! Occupied cells of a block as bits, and the states of the nodes above them.

/// Cube of cells with at most 64 cells per axis, one bit each.
///
/// A row of cells along x is one word; rows are numbered `z * side + y`.
pub(super) struct Bits {
    /// Base-2 logarithm of the side.
    pub(super) height: u8,
    pub(super) rows: Vec<u64>,
}

impl Bits {
    pub(super) fn new(height: u8) -> Bits {
        Bits { height, rows: vec![0; 1 << (2 * height)] }
    }

    /// Mask of the cells from `from` up to, but not including, `to`.
    #[inline]
    pub(super) fn run(from: usize, to: usize) -> u64 {
        let below = |end: usize| if end >= 64 { u64::MAX } else { (1 << end) - 1 };
        below(to) & !below(from)
    }

    #[inline]
    pub(super) fn get(&self, [x, y, z]: [usize; 3]) -> bool {
        self.rows[z << self.height | y] >> x & 1 != 0
    }

    #[inline]
    pub(super) fn set(&mut self, [x, y, z]: [usize; 3]) {
        self.rows[z << self.height | y] |= 1 << x;
    }

    /// Nodes of the next level up: set if all (`all`), or any, of their eight children are set.
    fn up(&self, all: bool) -> Bits {
        let side = 1usize << self.height;
        let half = side / 2;
        let mut up = Bits::new(self.height - 1);
        for (row, word) in up.rows.iter_mut().enumerate() {
            let (y, z) = (2 * (row % half), 2 * (row / half));
            let at = z * side + y;
            let four = [self.rows[at], self.rows[at + 1], self.rows[at + side], self.rows[at + side + 1]];
            // Pairs along x meet in the even bits; the four rows are the pairs along y and z.
            *word = if all {
                let both = four.into_iter().fold(u64::MAX, |sum, row| sum & row);
                even_bits(both & both >> 1)
            } else {
                let one = four.into_iter().fold(0, |sum, row| sum | row);
                even_bits(one | one >> 1)
            };
        }
        up
    }
}

/// Compacts the even bits: moves bit `2 i` to bit `i`, as in decoding a Morton code.
#[inline]
fn even_bits(mut word: u64) -> u64 {
    word &= 0x5555_5555_5555_5555;
    word = (word | word >> 1) & 0x3333_3333_3333_3333;
    word = (word | word >> 2) & 0x0f0f_0f0f_0f0f_0f0f;
    word = (word | word >> 4) & 0x00ff_00ff_00ff_00ff;
    word = (word | word >> 8) & 0x0000_ffff_0000_ffff;
    (word | word >> 16) & 0x0000_0000_ffff_ffff
}

/// Cells of a block, and their values in bit order unless all are equal.
pub(super) struct Cells {
    pub(super) bits: Bits,
    pub(super) values: Option<Vec<u32>>,
}

impl Cells {
    /// Adds cells of the same block. If both have a cell, `join` merges their values.
    pub(super) fn add(&mut self, other: &Cells, join: impl Fn(u32, u32) -> u32) {
        let side = 1usize << self.bits.height;
        for (row, more) in other.bits.rows.iter().enumerate() {
            let mut left = *more;
            if let (Some(values), Some(others)) = (&mut self.values, &other.values) {
                while left != 0 {
                    let (x, at) = (left.trailing_zeros(), row * side + left.trailing_zeros() as usize);
                    left &= left - 1;
                    let is_there = self.bits.rows[row] >> x & 1 != 0;
                    values[at] = if is_there { join(values[at], others[at]) } else { others[at] };
                }
            }
            self.bits.rows[row] |= more;
        }
    }
}

/// Pyramid of a block's nodes over its cells: which are empty, uniform or mixed.
pub(super) struct Pyramid {
    /// Nodes that have something below them, by height above the cells.
    any: Vec<Bits>,
    /// Nodes with one value throughout.
    uniform: Vec<Bits>,
    /// Cell values in bit order, unless all are equal.
    values: Option<Vec<u32>>,
    height: u8,
}

/// State of a node of a block.
pub(super) enum Content {
    Nothing,
    /// One value throughout; `None` if the block has no values because all its cells are equal.
    Uniform(Option<u32>),
    Mixed,
}

impl Pyramid {
    pub(super) fn new(Cells { bits: cells, values }: Cells) -> Pyramid {
        let height = cells.height;
        let mut any = Vec::with_capacity(height as usize + 1);
        let mut uniform = Vec::with_capacity(height as usize + 1);
        uniform.push(Bits { height, rows: cells.rows.clone() });
        any.push(cells);
        let mut pyramid = Pyramid { any, uniform, values, height };
        for level in 0..height as usize {
            pyramid.any.push(pyramid.any[level].up(false));
            let mut uniform = pyramid.uniform[level].up(true);
            pyramid.keep_alike(&mut uniform, level + 1);
            pyramid.uniform.push(uniform);
        }
        pyramid
    }

    /// Clears the nodes whose eight children are uniform but have different values.
    fn keep_alike(&self, uniform: &mut Bits, above: usize) {
        let Some(values) = &self.values else { return };
        let side = 1usize << uniform.height;
        for row in 0..uniform.rows.len() {
            let mut left = uniform.rows[row];
            while left != 0 {
                let node = [left.trailing_zeros() as usize, row % side, row / side];
                left &= left - 1;
                let value = |child: usize| {
                    let at =
                        std::array::from_fn(|axis| (2 * node[axis] + (child >> axis & 1)) << (above - 1));
                    values[self.index(at)]
                };
                if (1..8).any(|child| value(child) != value(0)) {
                    uniform.rows[row] &= !(1 << node[0]);
                }
            }
        }
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z << self.height | y) << self.height | x
    }

    /// State of the node `above` levels over the cells, at a position at its level.
    #[inline]
    pub(super) fn node(&self, above: u8, at: [usize; 3]) -> Content {
        if !self.any[above as usize].get(at) {
            Content::Nothing
        } else if self.uniform[above as usize].get(at) {
            let first = at.map(|at| at << above);
            Content::Uniform(self.values.as_ref().map(|values| values[self.index(first)]))
        } else {
            Content::Mixed
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_follow_from_cells() {
        for (height, seed) in [(1, 1u64), (2, 2), (3, 3), (6, 4)] {
            let side = 1usize << height;
            let mut cells = Bits::new(height);
            let mut random = seed;
            for z in 0..side {
                for y in 0..side {
                    for x in 0..side {
                        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                        // Full in one corner, empty in another, speckled between.
                        let sum = x + y + z;
                        if sum < side || (sum < 2 * side && random >> 63 != 0) {
                            cells.set([x, y, z]);
                        }
                    }
                }
            }
            let is_there: Vec<bool> =
                (0..side.pow(3)).map(|i| cells.get([i % side, i / side % side, i / side / side])).collect();
            let value = |i: usize| (i / 4096) as u32;
            let values = Some((0..side.pow(3)).map(value).collect());
            let pyramid = Pyramid::new(Cells { bits: cells, values });
            for above in 0..=height {
                let nodes = side >> above;
                for n in 0..nodes.pow(3) {
                    let at = [n % nodes, n / nodes % nodes, n / nodes / nodes];
                    let below: Vec<Option<u32>> = (0..1usize << (3 * above))
                        .map(|i| {
                            let mask = (1 << above) - 1;
                            let cell: [usize; 3] = std::array::from_fn(|axis| {
                                (at[axis] << above) | (i >> (axis as u8 * above) & mask)
                            });
                            let index = (cell[2] * side + cell[1]) * side + cell[0];
                            is_there[index].then_some(value(index))
                        })
                        .collect();
                    let alike = below.iter().all(|cell| *cell == below[0]);
                    match pyramid.node(above, at) {
                        Content::Nothing => assert!(alike && below[0].is_none()),
                        Content::Uniform(value) => assert!(alike && below[0] == value),
                        Content::Mixed => assert!(!alike),
                    }
                }
            }
        }
    }
}
