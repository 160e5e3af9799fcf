//! Numbers of the nodes of a level in rows, with a border that repeats the outermost numbers.

use crate::lanes::Lane;

/// Shape of a level of equally large blocks, which are side by side along x. So rows are long even
/// if blocks are small.
///
/// Two columns separate neighbouring blocks: the border of each.
///
/// Invariant: nothing depends on the numbers of these columns in rows without a border, which may
/// be left from earlier levels. Numbers of neighbours are read from [grids](Grid) alone, whose
/// borders [`Grid::pad`] has filled. Loops over rows without a border combine equal x only. Coding
/// and fitting skip the columns ([`Shape::blocks`]). Otherwise bytes would depend on the segments
/// that a thread has coded before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shape {
    /// Nodes of a block along each axis.
    pub(crate) side: usize,
    pub(crate) axes: usize,
    /// Number of blocks, at least 1.
    pub(crate) count: usize,
}

impl Shape {
    /// Returns the number of nodes of a row, including the columns between blocks.
    pub(crate) fn width(self) -> usize {
        self.count * (self.side + 2) - 2
    }

    /// Returns the number of nodes of all rows.
    pub(crate) fn nodes(self) -> usize {
        self.width() * self.side.pow(self.axes as u32 - 1)
    }

    /// Returns the shape of the children of all nodes.
    pub(crate) fn below(self) -> Shape {
        Shape { side: 2 * self.side, ..self }
    }

    /// Returns the y and z of all rows, in the order of their nodes.
    pub(crate) fn rows(self) -> impl Iterator<Item = [usize; 2]> {
        let Shape { side, axes, .. } = self;
        (0..if axes == 3 { side } else { 1 }).flat_map(move |z| (0..side).map(move |y| [y, z]))
    }

    /// Yields the nodes of a row block by block, without the columns between blocks.
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
    /// Changes the shape. The numbers are unspecified afterwards.
    pub(crate) fn reset(&mut self, shape: Shape) {
        self.shape = shape;
        let count = self.count();
        if self.numbers.len() < count {
            self.numbers.resize(count, T::default());
        }
    }

    /// Returns the number of elements, including the border.
    fn count(&self) -> usize {
        (self.shape.width() + 2) * (self.shape.side + 2).pow(self.shape.axes as u32 - 1)
    }

    /// Returns a copy without the elements that are left over from larger levels.
    pub(crate) fn copy(&self) -> Grid<T> {
        Grid { shape: self.shape, numbers: self.numbers[..self.count()].to_vec() }
    }

    /// Returns the index of a row's first node, moved by an offset in x, y and z.
    #[inline(always)]
    fn start(&self, [y, z]: [usize; 2], step: [isize; 3]) -> usize {
        let Shape { side, axes, .. } = self.shape;
        let z = if axes == 3 { (z + 1).wrapping_add_signed(step[2]) } else { 0 };
        let row = z * (side + 2) + (y + 1).wrapping_add_signed(step[1]);
        row * (self.shape.width() + 2) + 1usize.wrapping_add_signed(step[0])
    }

    /// Returns the neighbours of a row of nodes at an offset of at most 1 along each axis.
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

    /// Returns all elements, including the border.
    pub(crate) fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// Fills the border around each block with the outermost numbers.
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
