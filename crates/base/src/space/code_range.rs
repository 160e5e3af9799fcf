//! Runs of FD codes: regions of space that are contiguous in a file.

use super::bounds::Bounds;
use super::code::Code;
use super::dimension::Dimension;

/// The bits of a code that hold the level.
const LEVEL: u64 = 31;

/// A contiguous range of FD codes: all nodes whose subtree's codes lie within it.
///
/// It is a region of space that is cut along the order of files.
///
/// ```
/// use spinney::{Code, Dimension};
/// use spinney::raw::space::CodeRange;
/// let root = Code::root(Dimension::Quad);
/// let run = CodeRange::of(root.child(1), root.child(2).child(0)).unwrap();
/// assert!(run.contains(root.child(1).child(3)) && !run.contains(root.child(2)));
/// assert!(run.touches(root.child(2)) && !run.touches(root.child(3)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeRange {
    // Invariant: the codes of a subtree are the integers from its root's code on, with the level in
    // the lowest bits. So a node whose first and last code lie in the range has its whole subtree
    // there, and disjoint ranges share no node.
    /// Smallest code of the run, with a level of zero.
    first: u64,
    /// Largest code of the run, with all level bits set.
    last: u64,
}

impl CodeRange {
    /// The whole space.
    pub const ALL: CodeRange = CodeRange { first: 0, last: u64::MAX >> 1 };

    /// Returns the run from the first code below one node to the last code below another; `None` if
    /// it would be reversed.
    pub fn of(first: Code, last: Code) -> Option<CodeRange> {
        CodeRange::new(first.bits() & !LEVEL, last.last_bits())
    }

    /// Returns the run with these [ends](CodeRange::ends); `None` if they are invalid.
    pub fn new(first: u64, last: u64) -> Option<CodeRange> {
        let is_one =
            first & LEVEL == 0 && last & LEVEL == LEVEL && first <= last && last <= CodeRange::ALL.last;
        is_one.then_some(CodeRange { first, last })
    }

    /// Returns the smallest and the largest code of the run.
    ///
    /// A run directly follows another one if its first code is the other's last one plus 1.
    pub fn ends(self) -> [u64; 2] {
        [self.first, self.last]
    }

    /// Whether the run contains a node and its whole subtree.
    #[inline]
    pub fn contains(self, node: Code) -> bool {
        self.first <= node.bits() && node.last_bits() <= self.last
    }

    /// Whether the run overlaps a node's subtree.
    #[inline]
    pub fn touches(self, node: Code) -> bool {
        self.first <= node.last_bits() && node.bits() & !LEVEL <= self.last
    }

    /// Returns how many nodes at a level overlap the run.
    pub fn nodes(self, dimension: Dimension, level: u8) -> u64 {
        let shift = 63 - dimension.axes() as u32 * u32::from(level);
        (self.last >> shift) - (self.first >> shift) + 1
    }

    /// Returns how many cells of a box are in the run, in a tree of depth `depth`. The run must
    /// consist of whole cells of that depth.
    ///
    /// # Panics
    /// If `depth` exceeds the maximum depth.
    pub fn cells(self, dimension: Dimension, depth: u8, cells: &Bounds) -> u64 {
        self.cells_below(Code::root(dimension), depth, cells)
    }

    fn cells_below(self, node: Code, depth: u8, cells: &Bounds) -> u64 {
        // At each level at most two nodes are partially in the run, so the recursion is narrow.
        let inside = node.bounds(depth).intersect(cells);
        if inside.is_empty() || !self.touches(node) {
            return 0;
        }
        if self.contains(node) || node.level() == depth {
            return inside.volume();
        }
        let children = (0..node.dimension().children()).map(|child| node.child(child));
        children.fold(0, |sum: u64, child| sum.saturating_add(self.cells_below(child, depth, cells)))
    }

    /// Returns the smallest box around those cells of another box that are in the run, in a tree of
    /// depth `depth`; an empty box if there are none. The run must consist of whole cells of that
    /// depth.
    ///
    /// # Panics
    /// If `depth` exceeds the maximum depth.
    pub fn bounds(self, dimension: Dimension, depth: u8, cells: &Bounds) -> Bounds {
        self.bounds_below(Code::root(dimension), depth, cells).unwrap_or(Bounds { max: cells.min, ..*cells })
    }

    fn bounds_below(self, node: Code, depth: u8, cells: &Bounds) -> Option<Bounds> {
        let inside = node.bounds(depth).intersect(cells);
        if inside.is_empty() || !self.touches(node) {
            return None;
        }
        if self.contains(node) || node.level() == depth {
            return Some(inside);
        }
        let children = (0..node.dimension().children()).map(|child| node.child(child));
        let boxes = children.filter_map(|child| self.bounds_below(child, depth, cells));
        boxes.reduce(|all, next| all.hull(&next))
    }

    /// Whether the run contains each node at a level entirely or not at all.
    pub fn is_cut_at(self, dimension: Dimension, level: u8) -> bool {
        let below = (1u64 << (63 - dimension.axes() as u32 * u32::from(level))) - 1;
        self.first & below == 0 && self.last & below == below
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_have_nodes_with_all_that_is_below() {
        for dimension in [Dimension::Quad, Dimension::Oct] {
            let root = Code::root(dimension);
            assert!(CodeRange::ALL.contains(root) && CodeRange::ALL.touches(root));
            assert!(CodeRange::ALL.is_cut_at(dimension, 0) && CodeRange::ALL.nodes(dimension, 0) == 1);
            let deepest =
                (0..dimension.max_depth()).fold(root, |node, _| node.child(dimension.children() - 1));
            assert!(CodeRange::ALL.contains(deepest));
            // From the second child's first child to the third child's second child.
            let (first, last) = (root.child(1).child(0), root.child(2).child(1));
            let run = CodeRange::of(first, last).unwrap();
            assert!(run.contains(root.child(1)) && run.contains(last.child(3)) && run.contains(first));
            assert!(!run.contains(root.child(2)) && run.touches(root.child(2)) && run.touches(root));
            assert!(!run.touches(root.child(0)) && !run.touches(root.child(2).child(2)));
            assert_eq!(run.nodes(dimension, 2), dimension.children() as u64 + 2);
            assert!(run.is_cut_at(dimension, 2) && !run.is_cut_at(dimension, 1));
            let all = Bounds::space(dimension, 4);
            let cells = (dimension.children() as u64 + 2) * dimension.cells(2);
            assert_eq!(
                (run.cells(dimension, 4, &all), CodeRange::ALL.cells(dimension, 4, &all)),
                (cells, all.volume())
            );
            let corner = Bounds { min: [0; 3], max: [9, 4, 1] };
            assert_eq!(run.cells(dimension, 4, &corner), 4);
            assert_eq!(run.bounds(dimension, 4, &corner), Bounds { min: [8, 0, 0], max: [9, 4, 1] });
            assert_eq!(CodeRange::ALL.bounds(dimension, 4, &corner), corner);
            assert!(run.bounds(dimension, 4, &Bounds { min: [0; 3], max: [8, 4, 1] }).is_empty());
            let [first, last] = run.ends();
            assert_eq!(CodeRange::new(first, last), Some(run));
            assert_eq!(CodeRange::of(root.child(2), root.child(1)), None);
        }
        assert_eq!(CodeRange::new(1, 31), None);
        assert_eq!(CodeRange::new(0, 32), None);
        assert_eq!(CodeRange::new(0, u64::MAX), None);
    }
}
