//! Neighbours of nodes: 8 in a quadtree, and 18 in an octree, across faces and edges.
//!
//! The children of a node and the cells around them form a *grid* of four cells along each axis, x
//! fastest, with the children in the middle. So the offsets from a child to its neighbours are the
//! same for all children.

/// Neighbour of a child in a direction.
#[derive(Clone, Copy, Default)]
pub(crate) struct Neighbour {
    /// Direction from the parent to the node that is, or contains, the neighbour; [`SIBLING`] if
    /// that node is the parent itself.
    pub(crate) towards: u8,
    /// Index of the neighbour among the children of that node.
    pub(crate) child: u8,
}

/// Direction of a neighbour with the same parent; larger than all others.
pub(crate) const SIBLING: u8 = MAX_DIRECTIONS as u8;
/// Maximum number of directions.
pub(crate) const MAX_DIRECTIONS: usize = 18;
/// Number of directions across faces of an octree's node. They come first.
pub(crate) const FACES: usize = 6;

/// Returns the directions of neighbours: first those along one axis, then those along two, each
/// group ordered by z, then y, then x.
const fn directions<const D: usize>() -> [[i8; 3]; D] {
    let is_flat = D == 8;
    let mut all = [[0; 3]; D];
    let (mut count, mut along) = (0, 1);
    while along <= 2 {
        let mut number = 0;
        while number < 27 {
            let offset = [number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1];
            let axes_used = (offset[0] != 0) as usize + (offset[1] != 0) as usize + (offset[2] != 0) as usize;
            if axes_used == along && (!is_flat || offset[2] == 0) {
                all[count] = [offset[0] as i8, offset[1] as i8, offset[2] as i8];
                count += 1;
            }
            number += 1;
        }
        along += 1;
    }
    assert!(count == D);
    all
}

/// Positions of the neighbours of nodes with `C` children, in `D` directions.
pub(crate) struct Around<const C: usize, const D: usize> {
    /// Neighbours of each child.
    pub(crate) of_child: [[Neighbour; D]; C],
    /// Per direction: the grid cells that the parent's neighbour covers, with the index of each
    /// among its children, and the number of these cells.
    pub(crate) cells: [([(u8, u8); 4], usize); D],
    /// Grid cell of each child.
    pub(crate) centers: [u8; C],
    /// Offsets from the first grid cell of a child's neighbourhood to its neighbours.
    pub(crate) offsets: [u8; D],
}

/// Returns the offset from the first grid cell of a child's neighbourhood to the child.
pub(crate) const fn to_center<const D: usize>() -> usize {
    if D == 8 { 5 } else { 21 }
}

impl<const C: usize, const D: usize> Around<C, D> {
    pub(crate) const fn new() -> Around<C, D> {
        let mut around = Around {
            of_child: [[Neighbour { towards: SIBLING, child: 0 }; D]; C],
            cells: [([(0, 0); 4], 0); D],
            centers: [0; C],
            offsets: [0; D],
        };
        let directions = directions::<D>();
        let axes = C.trailing_zeros() as usize;
        let mut child = 0;
        while child < C {
            let mut direction = 0;
            while direction < D {
                let (mut towards, mut there, mut axis) = ([0i8; 3], 0u8, 0);
                let (mut offset, mut center) = (0, 0);
                while axis < axes {
                    let own = (child >> axis & 1) as i8;
                    let at = own + directions[direction][axis];
                    towards[axis] = (at > 1) as i8 - (at < 0) as i8;
                    there |= ((at & 1) as u8) << axis;
                    offset += ((directions[direction][axis] + 1) as u8) << (2 * axis);
                    center += ((own + 1) as u8) << (2 * axis);
                    axis += 1;
                }
                around.offsets[direction] = offset;
                around.centers[child] = center;
                let mut found = 0;
                while found < D {
                    let d = directions[found];
                    if d[0] == towards[0] && d[1] == towards[1] && d[2] == towards[2] {
                        around.of_child[child][direction] = Neighbour { towards: found as u8, child: there };
                        around.add(found, (center + offset - to_center::<D>() as u8, there));
                    }
                    found += 1;
                }
                if towards[0] == 0 && towards[1] == 0 && towards[2] == 0 {
                    around.of_child[child][direction].child = there;
                }
                direction += 1;
            }
            child += 1;
        }
        around
    }

    /// Adds a cell of the neighbour in a direction, unless it has been added.
    const fn add(&mut self, direction: usize, cell: (u8, u8)) {
        let (cells, count) = &mut self.cells[direction];
        let mut at = 0;
        while at < *count {
            if cells[at].0 == cell.0 {
                return;
            }
            at += 1;
        }
        cells[*count] = cell;
        *count += 1;
    }
}

/// Returns which neighbours of a child are in a set of grid cells, in 8 bits. A quadtree has one
/// bit per neighbour. An octree has one bit per face neighbour, and two bits for a third of the
/// number of edge neighbours. `cells` is a mask that begins with the first cell of the child's
/// neighbourhood.
#[inline(always)]
pub(crate) fn pattern<const D: usize>(cells: u64) -> usize {
    const EDGES: u64 = {
        let (directions, mut edges, mut at) = (directions::<MAX_DIRECTIONS>(), 0, FACES);
        while at < MAX_DIRECTIONS {
            let [x, y, z] = directions[at];
            edges |= 1 << (21 + x + 4 * y + 16 * z);
            at += 1;
        }
        edges
    };
    let cells = if D == 8 {
        // (Cells 0, 1, 2, 4, 6, 8, 9 and 10 are around 5, the child's cell.)
        cells & 7 | cells >> 1 & 8 | cells >> 2 & 16 | cells >> 3 & 0xe0
    } else {
        // (Cells 5, 17, 20, 22, 25 and 37 are next to 21, the child's cell.)
        let faces = cells >> 5 & 1
            | cells >> 16 & 2
            | cells >> 18 & 4
            | cells >> 19 & 8
            | cells >> 21 & 16
            | cells >> 32 & 32;
        faces << 2 | u64::from((cells & EDGES).count_ones().min(11) / 3)
    };
    cells as usize
}
