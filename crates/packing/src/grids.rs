//! Numbers of the nodes of a level in rows, with those at the border once more around them.

use crate::lanes::Lane;

/// Numbers of all nodes of a level.
#[derive(Default)]
pub(crate) struct Grid<T> {
    pub(crate) side: usize,
    pub(crate) axes: usize,
    numbers: Vec<T>,
}

impl<T: Lane> Grid<T> {
    pub(crate) fn new(side: usize, axes: usize) -> Grid<T> {
        let mut grid = Grid { side, axes, numbers: Vec::new() };
        grid.reset(side, axes);
        grid
    }

    /// Makes it one of another level, whose numbers are any.
    pub(crate) fn reset(&mut self, side: usize, axes: usize) {
        (self.side, self.axes) = (side, axes);
        let count = (side + 2).pow(axes as u32);
        if self.numbers.len() < count {
            self.numbers.resize(count, T::default());
        }
    }

    /// A copy without the numbers that are left of larger levels.
    pub(crate) fn copy(&self) -> Grid<T> {
        let count = (self.side + 2).pow(self.axes as u32);
        Grid { side: self.side, axes: self.axes, numbers: self.numbers[..count].to_vec() }
    }

    /// Index of the first node of a row, moved by a step.
    #[inline(always)]
    fn start(&self, [y, z]: [usize; 2], step: [isize; 3]) -> usize {
        let wide = self.side + 2;
        let z = if self.axes == 3 { (z + 1).wrapping_add_signed(step[2]) } else { 0 };
        (z * wide + (y + 1).wrapping_add_signed(step[1])) * wide + 1usize.wrapping_add_signed(step[0])
    }

    /// The neighbours of a row of nodes, which lie a step away, each along an axis by one at most.
    #[inline(always)]
    pub(crate) fn row(&self, row: [usize; 2], step: [isize; 3]) -> &[T] {
        let start = self.start(row, step);
        &self.numbers[start..start + self.side]
    }

    #[inline(always)]
    pub(crate) fn row_mut(&mut self, row: [usize; 2]) -> &mut [T] {
        let start = self.start(row, [0; 3]);
        &mut self.numbers[start..start + self.side]
    }

    /// All numbers, with those of the border.
    pub(crate) fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// Rows by y and z, in the order of their nodes.
    pub(crate) fn rows(&self) -> impl Iterator<Item = [usize; 2]> + use<T> {
        rows(self.side, self.axes)
    }

    /// Repeats the numbers at the border around all.
    pub(crate) fn pad(&mut self) {
        let (side, wide) = (self.side, self.side + 2);
        let plane = wide * wide;
        let planes = if self.axes == 3 { 1..side + 1 } else { 0..1 };
        for numbers in self.numbers[planes.start * plane..planes.end * plane].chunks_exact_mut(plane) {
            for row in numbers[wide..plane - wide].chunks_exact_mut(wide) {
                (row[0], row[side + 1]) = (row[1], row[side]);
            }
            numbers.copy_within(wide..2 * wide, 0);
            numbers.copy_within(side * wide..(side + 1) * wide, (side + 1) * wide);
        }
        if self.axes == 3 {
            self.numbers.copy_within(plane..2 * plane, 0);
            self.numbers.copy_within(side * plane..(side + 1) * plane, (side + 1) * plane);
        }
    }
}

/// Rows of a level by y and z, in the order of their nodes.
pub(crate) fn rows(side: usize, axes: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..if axes == 3 { side } else { 1 }).flat_map(move |z| (0..side).map(move |y| [y, z]))
}
