//! Groups of dense blocks with equally many levels, which are coded together: side by side, so that
//! rows are long for vectorized loops.

use spinney_container::{DenseKind, RecordLayout, VOID};

use crate::blocks::NumberBlock;
use crate::grids::Shape;
use crate::planes::VoidChildren;
use crate::void_nodes::VoidNodes;

/// Maximum number of bottom nodes of a group of several blocks. So a group needs no more memory
/// than the largest block of a quadtree.
const MAX_NODES: usize = 1 << 16;

/// Blocks with equally many levels, in their order.
pub(crate) struct Group {
    pub(crate) levels: u8,
    axes: usize,
    /// Indices of the blocks.
    pub(crate) blocks: Vec<usize>,
    /// VOID nodes of each block; empty if no node may be VOID.
    void: Vec<VoidNodes>,
    /// VOID children of all nodes; `None` if no node may be VOID.
    pub(crate) void_children: Option<VoidChildren>,
}

impl Group {
    /// Returns the groups of all blocks: those of many levels first, and of equally many levels
    /// those without VOID nodes first.
    pub(crate) fn all(layout: &RecordLayout, blocks: &[NumberBlock]) -> Vec<Group> {
        let may_be_void = |kind: DenseKind| kind.states().1 == Some(VOID);
        let key = |number: &usize| {
            (u8::MAX - blocks[*number].dense.levels, may_be_void(blocks[*number].dense.kind))
        };
        let mut numbers: Vec<usize> = (0..blocks.len()).collect();
        numbers.sort_by_key(key);
        let alike = numbers.chunk_by(|one, other| key(one) == key(other));
        let groups = alike.flat_map(|alike| {
            let (levels, has_void) = (blocks[alike[0]].dense.levels, key(&alike[0]).1);
            let most = (MAX_NODES / layout.dimension.cells(levels) as usize).max(1);
            alike.chunks(most).map(move |numbers| {
                let masks =
                    numbers.iter().map(|number| &blocks[*number].mask).take(if has_void { most } else { 0 });
                let void = masks.map(|mask| VoidNodes::new(layout, levels, mask)).collect();
                let axes = layout.dimension.axes();
                Group { levels, axes, blocks: numbers.to_vec(), void, void_children: None }
                    .with_void_children()
            })
        });
        groups.collect()
    }

    fn with_void_children(mut self) -> Group {
        if !self.void.is_empty() {
            let level = |level| {
                let shape = self.shape(level);
                // (The columns between blocks count as VOID.)
                let mut children = vec![u8::MAX; shape.nodes()];
                for (number, row) in children.chunks_mut(shape.width()).enumerate() {
                    for (to, void) in shape.blocks_mut(row).zip(&self.void) {
                        to.copy_from_slice(
                            &void.children[usize::from(level)][number * shape.side..][..shape.side],
                        );
                    }
                }
                children
            };
            self.void_children = Some((0..self.levels).map(level).collect());
        }
        self
    }

    /// Returns the shape of a level, counted from the roots of the blocks.
    pub(crate) fn shape(&self, level: u8) -> Shape {
        Shape { side: 1 << level, axes: self.axes, count: self.blocks.len() }
    }

    /// Returns which nodes of a block are VOID on a level, if any may be.
    pub(crate) fn void(&self, block: usize, level: u8) -> Option<&[bool]> {
        Some(&self.void.get(block)?.nodes[usize::from(level)])
    }
}
