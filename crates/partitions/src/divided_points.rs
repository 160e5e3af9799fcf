//! Trees that are divided at their points: point quadtrees and octrees (Finkel and Bentley 1974),
//! and k-d trees (Bentley 1975), which halve blocks along one axis after the other.

use spinney_base::space::Dimension;

/// How a node divides its space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointDivision {
    /// Along all axes at once, into four or eight parts.
    AllAxes,
    /// Along one axis, x below the root, then y, z if there is one, x and so on.
    OneAxis,
}

/// Tree that is divided at its points.
#[derive(Clone, Debug)]
pub struct DividedPoints {
    axes: usize,
    division: PointDivision,
    nodes: Vec<Node>,
}

#[derive(Clone, Debug)]
struct Node {
    point: [i32; 3],
    /// Number of equal points.
    count: u64,
    /// Indices of the children; 0 if there is none. (The root is no node's child.)
    children: [u32; 8],
}

/// Node of a tree in preorder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DividedPoint {
    /// Number of nodes above it.
    pub depth: usize,
    /// Side of the node above, a bit per divided axis, the lowest for the first: 0 is west, north
    /// or below, 1 is east, south or above. A point on a dividing plane is east, north or above.
    pub side: usize,
    /// The point.
    pub point: [i32; 3],
    /// Number of equal points.
    pub count: u64,
}

impl DividedPoints {
    /// Builds a tree. Points are inserted in a pseudo-random order that depends on nothing but
    /// their coordinates: the tree is a function of their set, and its depth is logarithmic on
    /// average.
    pub fn of(dimension: Dimension, division: PointDivision, mut points: Vec<[i32; 3]>) -> DividedPoints {
        let axes = dimension.axes();
        points.iter_mut().for_each(|point| point[axes..].fill(0));
        points.sort_by_key(|point| (mixed(*point), *point));
        let mut tree = DividedPoints { axes, division, nodes: Vec::new() };
        points.into_iter().for_each(|point| tree.insert(point));
        tree
    }

    /// Inserts a point, after all others: the cost is the depth there.
    fn insert(&mut self, point: [i32; 3]) {
        let new = Node { point, count: 1, children: [0; 8] };
        if self.nodes.is_empty() {
            return self.nodes.push(new);
        }
        let (mut at, mut depth) = (0, 0);
        loop {
            if self.nodes[at].point == point {
                self.nodes[at].count += 1;
                return;
            }
            let side = self.side(depth, self.nodes[at].point, point);
            let last = self.nodes.len() as u32;
            let child = &mut self.nodes[at].children[side];
            if *child == 0 {
                *child = last;
                return self.nodes.push(new);
            }
            (at, depth) = (*child as usize, depth + 1);
        }
    }

    /// Side of a point relative to that of a node. Rows begin in the north, so that the children of
    /// a quadtree are NW, NE, SW and SE.
    fn side(&self, depth: usize, around: [i32; 3], point: [i32; 3]) -> usize {
        let is_second = |axis: usize| match axis {
            1 => point[1] < around[1],
            _ => point[axis] >= around[axis],
        };
        match self.division {
            PointDivision::AllAxes => (0..self.axes).map(|axis| usize::from(is_second(axis)) << axis).sum(),
            PointDivision::OneAxis => usize::from(is_second(depth % self.axes)),
        }
    }

    /// Returns the nodes in preorder, with the children of each in the order of their sides.
    pub fn nodes(&self) -> Vec<DividedPoint> {
        let mut nodes = Vec::with_capacity(self.nodes.len());
        let mut open: Vec<(usize, usize, usize)> =
            (!self.nodes.is_empty()).then_some((0, 0, 0)).into_iter().collect();
        while let Some((at, depth, side)) = open.pop() {
            let Node { point, count, children } = &self.nodes[at];
            nodes.push(DividedPoint { depth, side, point: *point, count: *count });
            let children = children.iter().enumerate().rev().filter(|(_, child)| **child > 0);
            open.extend(children.map(|(side, child)| (*child as usize, depth + 1, side)));
        }
        nodes
    }
}

/// Pseudo-random number of a point.
fn mixed(point: [i32; 3]) -> u64 {
    point.iter().fold(0x9E37_79B9_7F4A_7C15, |mixed: u64, number| {
        let mixed = (mixed ^ u64::from(number.cast_unsigned())).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (mixed ^ mixed >> 29).wrapping_mul(0x94D0_49BB_1331_11EB) ^ mixed >> 32
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn points(count: u64, side: u64) -> Vec<[i32; 3]> {
        let number = |seed: u64| (mixed([seed as i32, 7, 7]) % side) as i32;
        (0..count).map(|at| [number(3 * at), number(3 * at + 1), number(3 * at + 2)]).collect()
    }

    /// Each node lies on its side of all nodes above.
    #[test]
    fn points_are_on_their_sides() {
        let divisions = [PointDivision::AllAxes, PointDivision::OneAxis];
        for (dimension, division) in [Dimension::Quad, Dimension::Oct]
            .into_iter()
            .flat_map(|dimension| divisions.map(|own| (dimension, own)))
        {
            for (count, side) in [(0, 5), (1, 5), (2000, 1 << 30), (500, 6)] {
                let mut given = points(count, side);
                let tree = DividedPoints::of(dimension, division, given.clone());
                let nodes = tree.nodes();
                let mut above: Vec<&DividedPoint> = Vec::new();
                for node in &nodes {
                    above.truncate(node.depth);
                    let mut chain = above.clone();
                    chain.push(node);
                    for (depth, pair) in chain.windows(2).enumerate() {
                        assert_eq!(tree.side(depth, pair[0].point, node.point), pair[1].side);
                    }
                    above.push(node);
                }
                let mut expected: BTreeMap<[i32; 3], u64> = BTreeMap::new();
                for point in &given {
                    let z = if dimension == Dimension::Oct { point[2] } else { 0 };
                    *expected.entry([point[0], point[1], z]).or_default() += 1;
                }
                let found: BTreeMap<[i32; 3], u64> =
                    nodes.iter().map(|node| (node.point, node.count)).collect();
                assert_eq!((found, nodes.len()), (expected.clone(), expected.len()));
                let depth = nodes.iter().map(|node| node.depth).max().unwrap_or(0);
                assert!(depth <= 40, "{depth}");
                given.reverse();
                assert_eq!(DividedPoints::of(dimension, division, given).nodes(), nodes);
            }
        }
    }

    #[test]
    fn sorted_points_make_no_list() {
        let line = (0..50_000).map(|at| [at, at, at]).collect();
        let nodes = DividedPoints::of(Dimension::Oct, PointDivision::OneAxis, line).nodes();
        assert!(nodes.iter().all(|node| node.depth < 60));
    }
}
