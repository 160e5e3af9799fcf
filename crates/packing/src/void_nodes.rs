//! VOID nodes of a dense block, derived from the state bits of its bottom nodes.

use spinney_container::RecordLayout;

use crate::grids::Shape;

/// VOID nodes of a dense block, level by level from its root down.
pub(crate) struct VoidNodes {
    pub(crate) nodes: Vec<Vec<bool>>,
    /// VOID children of each node above the bottom, as a bit per child.
    pub(crate) children: Vec<Vec<u8>>,
}

impl VoidNodes {
    /// Derives the nodes from the bits of the bottom nodes.
    pub(crate) fn new(layout: &RecordLayout, levels: u8, bits: &[u8]) -> VoidNodes {
        let axes = layout.dimension.axes();
        let bottom = (0..layout.dimension.cells(levels) as usize)
            .map(|at| bits[at / 8] >> (at % 8) & 1 == 0)
            .collect();
        let mut all = VoidNodes { nodes: vec![bottom], children: Vec::new() };
        for level in (0..levels).rev() {
            let (side, below) = (1 << level, &all.nodes[all.nodes.len() - 1]);
            let shape = Shape { side, axes, count: 1 };
            let mut children = vec![0; layout.dimension.cells(level) as usize];
            for (index, [y, z]) in shape.rows().enumerate() {
                let out = &mut children[index * side..][..side];
                for child in 0..layout.children() {
                    let row = (2 * z + (child >> 2)) * 2 * side + 2 * y + (child >> 1 & 1);
                    let void = below[row * 2 * side..][..2 * side].iter().skip(child & 1).step_by(2);
                    out.iter_mut().zip(void).for_each(|(out, void)| *out |= u8::from(*void) << child);
                }
            }
            let whole = u8::MAX >> (8 - layout.children());
            all.nodes.push(children.iter().map(|children: &u8| *children == whole).collect());
            all.children.push(children);
        }
        all.nodes.reverse();
        all.children.reverse();
        all
    }
}
