//! Hands out the uniform blocks of a box of cells, as fast as records can be read.

use super::extents::ByteAccess;
use super::reader::{Autumnal, Node};
use crate::Result;
use crate::space::{Bounds, Dimension};
use crate::store::container::record::LOW_STATE_BITS;
use crate::store::container::{LEAF, VOID};
use crate::tree::Child;
use crate::value::Value;

/// Takes a block: first cell, cells along each axis, value.
type EachBlock<'a> = dyn FnMut([u64; 3], [usize; 3], Value) + 'a;

/// A box of cells, and who is told of its blocks: their first cell, cells along each axis, and value.
struct Blocks<'a, F> {
    bounds: &'a Bounds,
    each: F,
}

/// An INNER node above the cells that are asked for.
#[derive(Clone, Copy)]
struct Above {
    node: Node,
    /// Its first cell.
    min: [u64; 3],
    /// Levels above the cells.
    levels: u8,
}

impl Above {
    /// Cells along each axis of the node's children.
    #[inline]
    fn child_size(&self, dimension: Dimension) -> [u64; 3] {
        let side = 1u64 << (self.levels - 1);
        [side, side, if dimension == Dimension::Oct { side } else { 1 }]
    }

    /// The first cell of a child. (A quadtree's children are all in the slice z = 0 of a node.)
    #[inline]
    fn child_min(&self, step: usize) -> [u64; 3] {
        std::array::from_fn(|axis| self.min[axis] + ((step as u64 >> axis & 1) << (self.levels - 1)))
    }
}

impl Autumnal {
    /// Hands out the blocks of a box of cells of a level that are not VOID: first cell, cells along each
    /// axis, value. All of them lie in the box and beside each other.
    ///
    /// (A block is often a single cell, for which a call that cannot be inlined costs more than all the rest:
    /// compiled for whoever draws windows, and meant for nobody else.)
    ///
    /// # Errors
    /// If the file is damaged there.
    pub(crate) fn blocks(
        &self,
        level: u8,
        bounds: &Bounds,
        mut each: impl FnMut([u64; 3], [usize; 3], Value),
    ) -> Result<()> {
        match self.root_child() {
            Child::Inner { node, .. } if level > 0 => {
                let root = Above { node, min: [0; 3], levels: level };
                match self.extents().mapped() {
                    Some(mapped) => self.blocks_below(mapped, root, &mut Blocks { bounds, each }),
                    None => {
                        // Beside asking the system for every record a call is nothing: once for whoever
                        // draws.
                        let each: &mut EachBlock<'_> = &mut each;
                        self.blocks_below(self.extents(), root, &mut Blocks { bounds, each })
                    }
                }
            }
            root => {
                let space = Bounds::space(self.layout().form.dimension, level);
                if let Some(value) = root.value() {
                    Blocks { bounds, each }.clipped(&space, value);
                }
                Ok(())
            }
        }
    }

    /// The blocks below a node some of which may be outside the box.
    fn blocks_below<'a, A, F>(&self, access: A, above: Above, blocks: &mut Blocks<'_, F>) -> Result<()>
    where
        A: ByteAccess<'a>,
        F: FnMut([u64; 3], [usize; 3], Value),
    {
        let record = self.record_in(access, above.node)?;
        let layout = self.layout();
        let dimension = layout.form.dimension;
        let levels = above.levels - 1;
        let size = above.child_size(dimension);
        let mut next = layout.head_size();
        for step in 0..layout.children() {
            let state = record.state(step);
            let field = next;
            match state {
                VOID => continue,
                LEAF => next += layout.width(),
                _ => next += layout.pointer_size(state),
            }
            let min = above.child_min(step);
            let space = Bounds { min, max: std::array::from_fn(|axis| min[axis] + size[axis]) };
            if blocks.bounds.intersect(&space).is_empty() {
                continue;
            }
            if state == LEAF {
                blocks.clipped(&space, self.value_in(&record.bytes, field));
                continue;
            }
            let node = self.follow(&record, field, state, above.node.height)?;
            let below = Above { node, min, levels };
            if levels == 0 {
                blocks.clipped(&space, self.representative_in(access, node.address)?);
            } else if blocks.bounds.contains(&space) {
                self.all_blocks_below(access, below, &mut blocks.each)?;
            } else {
                self.blocks_below(access, below, blocks)?;
            }
        }
        Ok(())
    }

    /// The blocks below a node all of which is in the box: what windows spend their time on.
    fn all_blocks_below<'a, A, F>(&self, access: A, above: Above, each: &mut F) -> Result<()>
    where
        A: ByteAccess<'a>,
        F: FnMut([u64; 3], [usize; 3], Value),
    {
        let record = self.record_in(access, above.node)?;
        let layout = self.layout();
        let (width, children) = (layout.width(), layout.children());
        let levels = above.levels - 1;
        let size = above.child_size(layout.form.dimension).map(|cells| cells as usize);
        let mut next = layout.head_size();
        // Most records where there is detail, and nothing to guess about them.
        if record.states == (LOW_STATE_BITS >> (32 - 2 * children)) * u32::from(LEAF) {
            for step in 0..children {
                each(above.child_min(step), size, self.value_in(&record.bytes, next));
                next += width;
            }
            return Ok(());
        }
        for step in 0..children {
            let state = record.state(step);
            let field = next;
            let min = above.child_min(step);
            match state {
                VOID => {}
                LEAF => {
                    next += width;
                    each(min, size, self.value_in(&record.bytes, field));
                }
                _ => {
                    next += layout.pointer_size(state);
                    let node = self.follow(&record, field, state, above.node.height)?;
                    if levels > 0 {
                        let below = Above { node, min, levels };
                        self.all_blocks_below(access, below, each)?;
                    } else {
                        each(min, size, self.representative_in(access, node.address)?);
                    }
                }
            }
        }
        Ok(())
    }
}

impl<F: FnMut([u64; 3], [usize; 3], Value)> Blocks<'_, F> {
    /// Hands out the part of a block that is in the box.
    fn clipped(&mut self, space: &Bounds, value: Value) {
        let part = space.intersect(self.bounds);
        if !part.is_empty() {
            (self.each)(part.min, part.size().map(|cells| cells as usize), value);
        }
    }
}
