//! The point quadtree: a block is divided at one of its points.

/// Quadtree divided at its points, in the order of their insertion.
#[derive(Clone, Debug, Default)]
pub(crate) struct PointQuadtree {
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    point: [f64; 2],
    /// Number of insertions.
    count: u64,
    /// Indices of the children NW, NE, SW and SE; 0 if there is none. (The root is no node's
    /// child.)
    children: [u32; 4],
}

/// Returns the quadrant of a point relative to another one: points on a dividing line are east, or
/// south.
fn quadrant(around: [f64; 2], point: [f64; 2]) -> usize {
    usize::from(point[0] >= around[0]) | usize::from(point[1] < around[1]) << 1
}

impl PointQuadtree {
    /// Inserts a point, whose coordinates must be numbers. The cost is the depth there: about log4
    /// of the number of points if these are inserted in random order, up to their number if in
    /// sorted order.
    pub(crate) fn insert(&mut self, point: [f64; 2]) {
        let new = Node { point, count: 1, children: [0; 4] };
        if self.nodes.is_empty() {
            return self.nodes.push(new);
        }
        let mut at = 0;
        loop {
            let last = self.nodes.len() as u32;
            let node = &mut self.nodes[at];
            if node.point == point {
                node.count += 1;
                return;
            }
            let child = &mut node.children[quadrant(node.point, point)];
            if *child == 0 {
                *child = last;
                return self.nodes.push(new);
            }
            at = *child as usize;
        }
    }

    /// Returns the number of points, including equal ones.
    pub(crate) fn len(&self) -> u64 {
        self.nodes.iter().map(|node| node.count).sum()
    }

    /// Returns whether there are no points.
    pub(crate) fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Returns how often a point was inserted.
    pub(crate) fn count(&self, point: [f64; 2]) -> u64 {
        let mut at = (!self.nodes.is_empty()).then_some(0);
        while let Some(node) = at.map(|at: usize| &self.nodes[at]) {
            if node.point == point {
                return node.count;
            }
            at = Some(node.children[quadrant(node.point, point)] as usize).filter(|child| *child > 0);
        }
        0
    }

    /// Returns the points in a window, its border included, in the order of insertion; equal ones
    /// repeatedly.
    pub(crate) fn window(&self, least: [f64; 2], most: [f64; 2]) -> Vec<[f64; 2]> {
        let mut found = Vec::new();
        let mut open: Vec<usize> = (!self.nodes.is_empty()).then_some(0).into_iter().collect();
        while let Some(at) = open.pop() {
            let Node { point, count, children } = &self.nodes[at];
            if (0..2).all(|axis| least[axis] <= point[axis] && point[axis] <= most[axis]) {
                found.push((at, *count));
            }
            for (side, child) in children.iter().enumerate().filter(|(_, child)| **child > 0) {
                let is_reached = (if side & 1 == 1 { most[0] >= point[0] } else { least[0] < point[0] })
                    && (if side & 2 == 2 { least[1] < point[1] } else { most[1] >= point[1] });
                if is_reached {
                    open.push(*child as usize);
                }
            }
        }
        found.sort_unstable();
        found
            .into_iter()
            .flat_map(|(at, count)| std::iter::repeat_n(self.nodes[at].point, count as usize))
            .collect()
    }

    /// Returns the number of nodes on the longest path.
    pub(crate) fn depth(&self) -> usize {
        let mut deepest = 0;
        let mut open: Vec<(usize, usize)> = (!self.nodes.is_empty()).then_some((0, 1)).into_iter().collect();
        while let Some((at, depth)) = open.pop() {
            deepest = deepest.max(depth);
            let children = self.nodes[at].children.iter().filter(|child| **child > 0);
            open.extend(children.map(|child| (*child as usize, depth + 1)));
        }
        deepest
    }
}
