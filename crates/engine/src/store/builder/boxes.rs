//! Boxes of cells, in the order in which trees are built from them.

use spinney_base::array;
use spinney_base::space::{Code, CodeRange, Dimension};

/// The requested cells of a tree: those of the nodes in a run. See
/// [`TreeWriter::run`](crate::store::TreeWriter::run).
#[derive(Clone, Copy, Debug)]
pub struct WantedCells {
    /// Quadtree or octree.
    pub dimension: Dimension,
    /// Levels of the tree.
    pub depth: u8,
    /// The run of nodes.
    pub run: CodeRange,
}

impl WantedCells {
    /// Returns the smallest node that contains a square or cube, whose side is a power of two and
    /// whose position is a multiple of its side; `None` if it is outside of the tree.
    fn node(self, first: [u64; 3], side: u64) -> Option<Code> {
        let height = self.depth.min(side.trailing_zeros() as u8);
        let mut cell = [0; 3];
        for (place, first) in cell.iter_mut().zip(first) {
            *place = u32::try_from(first >> height).ok()?;
        }
        Code::from_cell(self.dimension, self.depth - height, cell)
    }

    /// Returns whether some cells of a square or cube are requested. Its side is a power of two,
    /// and its first cell a multiple of the side.
    pub fn touches(self, first: [u64; 3], side: u64) -> bool {
        self.node(first, side).is_some_and(|node| self.run.touches(node))
    }

    /// Returns whether all cells of a square or cube are requested.
    fn contains(self, first: [u64; 3], side: u64) -> bool {
        self.node(first, side).is_some_and(|node| self.run.contains(node))
    }
}

/// The boxes of a raster's or volume's slabs, in FD order: squares or cubes of maximum size,
/// clipped to the extent. For a run of nodes, only boxes that intersect it.
///
/// ```
/// use spinney::Dimension;
/// use spinney::raw::space::CodeRange;
/// use spinney::raw::store::{SlabBoxes, WantedCells};
///
/// let all = WantedCells { dimension: Dimension::Quad, depth: 10, run: CodeRange::ALL };
/// let boxes = SlabBoxes::new([700, 300, 1], all, 512);
/// assert_eq!(boxes.collect::<Vec<_>>(), [([0, 0, 0], [512, 300, 1]), ([512, 0, 0], [188, 300, 1])]);
/// ```
#[derive(Clone, Debug)]
pub struct SlabBoxes {
    extent: [u64; 3],
    wanted: WantedCells,
    /// Maximum number of cells along a box's side.
    side: u64,
    /// Boxes still to be yielded, the next one last: first cell, and cells along a side. Larger
    /// ones are divided when they are taken.
    pending: Vec<([u64; 3], u64)>,
}

impl SlabBoxes {
    /// Returns the boxes of an extent that contain requested cells. Their sides have at most `side`
    /// cells, a power of two, but at least as many as the builder's blocks.
    pub fn new(extent: [u64; 3], wanted: WantedCells, side: u64) -> SlabBoxes {
        let side = side.max(SlabBoxes::least_side(wanted.dimension));
        let longest = extent.into_iter().max().unwrap_or(1).max(1);
        let whole = longest.checked_next_power_of_two().unwrap_or(1 << 63).max(side);
        SlabBoxes { extent, wanted, side, pending: vec![([0; 3], whole)] }
    }

    /// Returns the number of cells along a side of the smallest boxes, which are the builder's
    /// blocks.
    pub const fn least_side(dimension: Dimension) -> u64 {
        match dimension {
            Dimension::Quad => 256,
            Dimension::Oct => 64,
        }
    }
}

impl Iterator for SlabBoxes {
    type Item = ([u64; 3], [u64; 3]);

    /// Returns the next box: its first cell, and its number of cells along each axis.
    fn next(&mut self) -> Option<Self::Item> {
        let dimension = self.wanted.dimension;
        let axes = dimension.axes();
        loop {
            let (first, side) = self.pending.pop()?;
            if !self.wanted.touches(first, side) || (0..3).any(|axis| first[axis] >= self.extent[axis]) {
                continue;
            }
            // Invariant: a box has only requested cells, unless it is as small as a block. So the
            // cells that a shard builds limit what it reads.
            let is_whole = self.wanted.contains(first, side);
            if side <= self.side && (is_whole || side <= SlabBoxes::least_side(dimension)) {
                let size = array::from_fn(|axis| side.min(self.extent[axis] - first[axis]));
                return Some((first, size));
            }
            let half = side / 2;
            let child = |step: u64| {
                let along = |axis: usize| if axis < axes { half * (step >> axis & 1) } else { 0 };
                array::from_fn(|axis| first[axis] + along(axis))
            };
            // In reverse, because the last one is taken first.
            self.pending.extend((0..1 << axes).rev().map(|step| (child(step), half)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_cover_the_extent_once_and_in_order() {
        for (dimension, extent, depth, side) in [
            (Dimension::Quad, [1000, 600, 1], 10, 256),
            (Dimension::Quad, [1, 1, 1], 0, 1024),
            (Dimension::Quad, [3000, 1, 1], 12, 1024),
            (Dimension::Oct, [200, 100, 150], 9, 64),
        ] {
            let boxes: Vec<_> =
                SlabBoxes::new(extent, WantedCells { dimension, depth, run: CodeRange::ALL }, side).collect();
            let cells: u64 = boxes.iter().map(|(_, size)| size.iter().product::<u64>()).sum();
            assert_eq!(cells, extent.iter().product::<u64>());
            let code = |first: &[u64; 3]| Code::from_cell(dimension, depth, first.map(|cell| cell as u32));
            assert!(boxes.is_sorted_by_key(|(first, _)| code(first).map(Code::bits)));
        }
    }

    #[test]
    fn boxes_of_a_run_are_those_that_it_touches() {
        let node = |digits: &[usize]| Code::from_digits(Dimension::Quad, digits.iter().copied()).unwrap();
        let run = CodeRange::of(node(&[0, 3]), node(&[1])).unwrap();
        let wanted = WantedCells { dimension: Dimension::Quad, depth: 10, run };
        let boxes = SlabBoxes::new([1000, 900, 1], wanted, 1 << 20);
        assert_eq!(boxes.collect::<Vec<_>>(), [([256, 256, 0], [256, 256, 1]), ([512, 0, 0], [488, 512, 1])]);
    }
}
