//! Neighbours of nodes: the eight of a quadtree's node, and the eighteen of an octree's across faces and edges.

/// Where the neighbour of a child lies in a direction.
#[derive(Clone, Copy, Default)]
pub(crate) struct Step {
    /// The direction from the parent to the node that is or has the neighbour; [`SIBLING`] if the parent itself has it.
    pub(crate) towards: u8,
    /// The number of the neighbour among the children there.
    pub(crate) child: u8,
}

/// The direction of a neighbour that has the same parent.
pub(crate) const SIBLING: u8 = u8::MAX;

/// The directions of neighbours: first those along one axis, then those along two; of each by z, y, x.
const fn directions<const D: usize>(axes: usize) -> [[i8; 3]; D] {
    let mut all = [[0; 3]; D];
    let (mut count, mut along) = (0, 1);
    while along <= 2 {
        let mut number = 0;
        while number < 27 {
            let offset = [number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1];
            let axes_used = (offset[0] != 0) as usize + (offset[1] != 0) as usize + (offset[2] != 0) as usize;
            if axes_used == along && (axes == 3 || offset[2] == 0) {
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

/// Steps from each child in each direction.
pub(crate) const fn steps<const C: usize, const D: usize>() -> [[Step; D]; C] {
    let axes = C.trailing_zeros() as usize;
    let directions = directions::<D>(axes);
    let mut all = [[Step { towards: SIBLING, child: 0 }; D]; C];
    let mut child = 0;
    while child < C {
        let mut direction = 0;
        while direction < D {
            let (mut towards, mut there, mut axis) = ([0i8; 3], 0u8, 0);
            while axis < axes {
                let place = (child >> axis & 1) as i8 + directions[direction][axis];
                towards[axis] = if place < 0 {
                    -1
                } else if place > 1 {
                    1
                } else {
                    0
                };
                there |= ((place & 1) as u8) << axis;
                axis += 1;
            }
            let mut found = 0;
            let mut number = SIBLING;
            while found < D {
                let d = directions[found];
                if d[0] == towards[0] && d[1] == towards[1] && d[2] == towards[2] {
                    number = found as u8;
                }
                found += 1;
            }
            all[child][direction] = Step { towards: number, child: there };
            direction += 1;
        }
        child += 1;
    }
    all
}
