//! Spatial index of the files: boxes by the FD codes of the nodes around them.

use spinney_base::space::{Bounds, Code, Dimension};

/// Boxes that can be searched by intersection with a box. Memory: at most 4 entries (8 in octrees)
/// of 16 bytes per box.
pub(super) struct Index {
    dimension: Dimension,
    depth: u8,
    /// Nodes that intersect a box and are no smaller than it, with the box's index; sorted.
    /// Invariant: two boxes that intersect share a cell, which is in a node of each. One of these
    /// two nodes contains the other.
    nodes: Vec<(u64, u32)>,
}

/// Level of the smallest nodes that are no smaller than a box of cells, along each axis.
fn level_of(bounds: &Bounds, (dimension, depth): (Dimension, u8)) -> u8 {
    let side = bounds.size()[..dimension.axes()].iter().copied().max().unwrap_or(1).max(1);
    depth.saturating_sub(side.next_power_of_two().ilog2() as u8)
}

/// Nodes of that level that intersect a box: at most two along each axis.
fn nodes_around(bounds: &Bounds, (dimension, depth): (Dimension, u8)) -> Vec<Code> {
    let level = level_of(bounds, (dimension, depth));
    let above = depth - level;
    let first = bounds.min.map(|cell| cell >> above);
    let last = bounds.max.map(|cell| cell.saturating_sub(1) >> above);
    let mut nodes = Vec::new();
    let z = if dimension == Dimension::Oct { first[2]..=last[2] } else { 0..=0 };
    for z in z {
        for y in first[1]..=last[1] {
            for x in first[0]..=last[0] {
                nodes.extend(Code::from_cell(dimension, level, [x as u32, y as u32, z as u32]));
            }
        }
    }
    nodes
}

impl Index {
    /// Index of boxes in a space.
    pub(super) fn new(boxes: impl Iterator<Item = Bounds>, dimension: Dimension, depth: u8) -> Index {
        let around = |(number, bounds): (usize, Bounds)| {
            let nodes = nodes_around(&bounds, (dimension, depth));
            nodes.into_iter().map(move |code| (code.bits(), number as u32))
        };
        let mut nodes: Vec<(u64, u32)> = boxes.enumerate().flat_map(around).collect();
        nodes.sort_unstable();
        Index { dimension, depth, nodes }
    }

    /// Indices of the boxes that may intersect a box, ascending: all that do, and some nearby ones.
    /// Time: a search per level, plus the number of results.
    pub(super) fn near(&self, bounds: &Bounds) -> Vec<u32> {
        let mut found = Vec::new();
        let mut take = |first: u64, last: u64| {
            let start = self.nodes.partition_point(|(bits, _)| *bits < first);
            let inside = self.nodes[start..].iter().take_while(|(bits, _)| *bits <= last);
            found.extend(inside.map(|(_, number)| *number));
        };
        let around = nodes_around(bounds, (self.dimension, self.depth));
        let mut above: Vec<u64> = Vec::new();
        for code in around {
            take(code.bits(), code.last_bits());
            let mut code = code;
            while let Some(parent) = code.parent() {
                above.push(parent.bits());
                code = parent;
            }
        }
        above.sort_unstable();
        above.dedup();
        above.into_iter().for_each(|bits| take(bits, bits));
        found.sort_unstable();
        found.dedup();
        found
    }
}
