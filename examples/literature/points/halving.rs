//! The halving tree: blocks are halved along each axis until each has at most one distinct point.

/// Quadtree or octree that halves its space (a PR tree): the same points make the same tree,
/// whatever the order of insertion, and its blocks are those of any other tree over the same space.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HalvingTree {
    corner: [f64; 3],
    side: f64,
    axes: usize,
    /// Maximum number of levels below the root.
    most: usize,
    root: Block,
    len: u64,
}

#[derive(Clone, Debug, PartialEq)]
enum Block {
    /// Equal points, or the points of a block that is not divided further, sorted.
    Leaf(Vec<[f64; 3]>),
    Inner(Vec<Block>),
}

impl HalvingTree {
    /// Creates a tree without points over a square or a cube, given by its minimum corner and its
    /// side. It has 2 or 3 `axes`; `levels` limits the depth, and so the size of the smallest
    /// blocks.
    ///
    /// # Panics
    /// If there are neither 2 nor 3 axes, or more than 60 levels.
    pub(crate) fn new(corner: [f64; 3], side: f64, axes: usize, levels: usize) -> HalvingTree {
        assert!((2..=3).contains(&axes) && levels <= 60);
        HalvingTree { corner, side, axes, most: levels, root: Block::Leaf(Vec::new()), len: 0 }
    }

    /// Inserts a point; returns `false` if it is outside.
    pub(crate) fn insert(&mut self, point: [f64; 3]) -> bool {
        let is_inside =
            |axis: usize| self.corner[axis] <= point[axis] && point[axis] < self.corner[axis] + self.side;
        if !(0..self.axes).all(is_inside) {
            return false;
        }
        self.len += 1;
        let space = Space { corner: self.corner, side: self.side, axes: self.axes };
        self.root.insert(point, space, self.most);
        true
    }

    /// Returns the number of points, including equal ones.
    pub(crate) fn len(&self) -> u64 {
        self.len
    }

    /// Returns whether there are no points.
    pub(crate) fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the points in a box, its border included, in Z order.
    pub(crate) fn window(&self, least: [f64; 3], most: [f64; 3]) -> Vec<[f64; 3]> {
        let mut found = Vec::new();
        let space = Space { corner: self.corner, side: self.side, axes: self.axes };
        self.root.window(space, (least, most), &mut found);
        found
    }

    /// Returns the number of levels below the root.
    pub(crate) fn depth(&self) -> usize {
        self.root.depth()
    }

    /// Returns the number of leaves and of inner nodes.
    pub(crate) fn counts(&self) -> (usize, usize) {
        self.root.counts()
    }
}

/// Space of a block.
#[derive(Clone, Copy)]
struct Space {
    corner: [f64; 3],
    side: f64,
    axes: usize,
}

impl Space {
    fn child(&self, number: usize) -> Space {
        let half = self.side / 2.0;
        let mut corner = self.corner;
        for (axis, at) in corner.iter_mut().enumerate().take(self.axes) {
            *at += if number >> axis & 1 == 1 { half } else { 0.0 };
        }
        Space { corner, side: half, axes: self.axes }
    }

    fn child_of(&self, point: [f64; 3]) -> usize {
        let half = self.side / 2.0;
        (0..self.axes).map(|axis| usize::from(point[axis] >= self.corner[axis] + half) << axis).sum()
    }
}

// (Blocks are at most 60 levels deep, so that recursion is bounded.)
impl Block {
    fn insert(&mut self, point: [f64; 3], space: Space, levels: usize) {
        match self {
            Block::Inner(children) => {
                let child = space.child_of(point);
                children[child].insert(point, space.child(child), levels - 1);
            }
            Block::Leaf(points)
                if levels == 0 || points.is_empty() || same_place(points[0], point, space.axes) =>
            {
                let at = points.partition_point(|other| {
                    other
                        .iter()
                        .zip(&point)
                        .map(|(a, b)| a.total_cmp(b))
                        .find(|order| order.is_ne())
                        .is_some_and(|order| order.is_lt())
                });
                points.insert(at, point);
            }
            Block::Leaf(points) => {
                let points = std::mem::take(points);
                *self = Block::Inner(vec![Block::Leaf(Vec::new()); 1 << space.axes]);
                points.into_iter().chain([point]).for_each(|point| self.insert(point, space, levels));
            }
        }
    }

    fn window(&self, space: Space, (least, most): ([f64; 3], [f64; 3]), found: &mut Vec<[f64; 3]>) {
        let is_reached =
            |axis: usize| space.corner[axis] <= most[axis] && least[axis] < space.corner[axis] + space.side;
        if !(0..space.axes).all(is_reached) {
            return;
        }
        match self {
            Block::Leaf(points) => {
                let is_inside = |point: &&[f64; 3]| {
                    (0..3).all(|axis| least[axis] <= point[axis] && point[axis] <= most[axis])
                };
                found.extend(points.iter().filter(is_inside));
            }
            Block::Inner(children) => {
                for (number, child) in children.iter().enumerate() {
                    child.window(space.child(number), (least, most), found);
                }
            }
        }
    }

    fn depth(&self) -> usize {
        match self {
            Block::Leaf(_) => 0,
            Block::Inner(children) => 1 + children.iter().map(Block::depth).max().unwrap_or(0),
        }
    }

    fn counts(&self) -> (usize, usize) {
        match self {
            Block::Leaf(_) => (1, 0),
            Block::Inner(children) => {
                let all = children.iter().map(Block::counts);
                all.fold((0, 1), |(leaves, inner), (more, others)| (leaves + more, inner + others))
            }
        }
    }
}

fn same_place(a: [f64; 3], b: [f64; 3], axes: usize) -> bool {
    a[..axes] == b[..axes]
}
