//! Numbers of the nodes of a level in rows, with those at the border once more around them.

use crate::lanes::Lane;

/// The nodes of a level of blocks of equal size, which are side by side along x: so that rows are long where blocks are small.
///
/// Between two blocks are two columns: the border of each. Rows of nodes have them, too, with numbers that nothing depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Nodes of a block along each axis.
    pub(crate) side: usize,
    pub(crate) axes: usize,
    /// Blocks, at least one.
    pub(crate) count: usize,
}

impl Shape {
    /// Nodes of a row, with the columns between blocks.
    pub(crate) fn width(self) -> usize {
        self.count * (self.side + 2) - 2
    }

    /// Nodes of all rows.
    pub(crate) fn nodes(self) -> usize {
        self.width() * self.side.pow(self.axes as u32 - 1)
    }

    /// The children of all nodes.
    pub(crate) fn below(self) -> Shape {
        Shape { side: 2 * self.side, ..self }
    }

    /// Rows by y and z, in the order of their nodes.
    pub(crate) fn rows(self) -> impl Iterator<Item = [usize; 2]> {
        let Shape { side, axes, .. } = self;
        (0..if axes == 3 { side } else { 1 }).flat_map(move |z| (0..side).map(move |y| [y, z]))
    }

    /// The nodes of a row by block, without the columns between.
    pub(crate) fn blocks<N>(self, row: &[N]) -> impl Iterator<Item = &[N]> {
        row.chunks(self.side + 2).map(move |block| &block[..self.side])
    }

    pub(crate) fn blocks_mut<N>(self, row: &mut [N]) -> impl Iterator<Item = &mut [N]> {
        row.chunks_mut(self.side + 2).map(move |block| &mut block[..self.side])
    }
}

/// Numbers of all nodes of a level.
#[derive(Default)]
pub(crate) struct Grid<T> {
    pub(crate) shape: Shape,
    numbers: Vec<T>,
}

impl<T: Lane> Grid<T> {
    /// Makes it one of another level, whose numbers are any.
    pub(crate) fn reset(&mut self, shape: Shape) {
        self.shape = shape;
        let count = self.count();
        if self.numbers.len() < count {
            self.numbers.resize(count, T::default());
        }
    }

    /// Numbers with those of the border.
    fn count(&self) -> usize {
        (self.shape.width() + 2) * (self.shape.side + 2).pow(self.shape.axes as u32 - 1)
    }

    /// A copy without the numbers that are left of larger levels.
    pub(crate) fn copy(&self) -> Grid<T> {
        Grid { shape: self.shape, numbers: self.numbers[..self.count()].to_vec() }
    }

    /// Index of the first node of a row, moved by a step.
    #[inline(always)]
    fn start(&self, [y, z]: [usize; 2], step: [isize; 3]) -> usize {
        let Shape { side, axes, .. } = self.shape;
        let z = if axes == 3 { (z + 1).wrapping_add_signed(step[2]) } else { 0 };
        let row = z * (side + 2) + (y + 1).wrapping_add_signed(step[1]);
        row * (self.shape.width() + 2) + 1usize.wrapping_add_signed(step[0])
    }

    /// The neighbours of a row of nodes, which lie a step away, each along an axis by one at most.
    #[inline(always)]
    pub(crate) fn row(&self, row: [usize; 2], step: [isize; 3]) -> &[T] {
        let start = self.start(row, step);
        &self.numbers[start..start + self.shape.width()]
    }

    #[inline(always)]
    pub(crate) fn row_mut(&mut self, row: [usize; 2]) -> &mut [T] {
        let start = self.start(row, [0; 3]);
        let width = self.shape.width();
        &mut self.numbers[start..start + width]
    }

    /// All numbers, with those of the border.
    pub(crate) fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// Repeats the numbers at the border around each block.
    pub(crate) fn pad(&mut self) {
        let Shape { side, axes, .. } = self.shape;
        let wide = self.shape.width() + 2;
        let plane = (side + 2) * wide;
        let planes = if axes == 3 { 1..side + 1 } else { 0..1 };
        for numbers in self.numbers[planes.start * plane..planes.end * plane].chunks_exact_mut(plane) {
            for row in numbers[wide..plane - wide].chunks_exact_mut(wide) {
                for block in row.chunks_exact_mut(side + 2) {
                    (block[0], block[side + 1]) = (block[1], block[side]);
                }
            }
            numbers.copy_within(wide..2 * wide, 0);
            numbers.copy_within(side * wide..(side + 1) * wide, (side + 1) * wide);
        }
        if axes == 3 {
            self.numbers.copy_within(plane..2 * plane, 0);
            self.numbers.copy_within(side * plane..(side + 1) * plane, (side + 1) * plane);
        }
    }
}
