//! Hands out the uniform blocks of a box of cells, as fast as records can be read.

use super::extents::Reach;
use super::reader::{Autumnal, Node};
use crate::Result;
use crate::space::Bounds;
use crate::store::goblin::Layout;
use crate::tree::Child;
use crate::value::Value;

/// The states of eight LEAF children.
const ALL_LEAVES: u32 = 0x5555;

/// A box of cells, and who is told of its blocks: their first cell, cells along each axis, and value.
struct Blocks<'a, F> {
    bounds: &'a Bounds,
    each: F,
}

/// A node above the cells that are asked for.
#[derive(Clone, Copy)]
struct Above {
    node: Node,
    /// Its first cell.
    min: [u64; 3],
    /// Levels above the cells.
    levels: u8,
}

impl<D: Layout, V: Value> Autumnal<D, V> {
    /// Hands out the blocks of a box of cells of a level that are not VOID: first cell, cells along each axis, value.
    ///
    /// # Errors
    /// If the file is damaged there.
    pub(crate) fn blocks(
        &self,
        level: u8,
        bounds: &Bounds,
        each: impl FnMut([u64; 3], [usize; 3], V),
    ) -> Result<()> {
        let side = 1u64 << level;
        let space = Bounds { min: [0; 3], max: [side, side, if D::AXES > 2 { side } else { 1 }] };
        let mut blocks = Blocks { bounds, each };
        match self.root_place() {
            Child::Inner { node, .. } if level > 0 => {
                let root = Above { node, min: [0; 3], levels: level };
                match self.extents().seen() {
                    Some(seen) => self.blocks_below(seen, root, &mut blocks),
                    None => self.blocks_below(self.extents(), root, &mut blocks),
                }
            }
            place => {
                place.value().into_iter().for_each(|value| blocks.part(&space, value));
                Ok(())
            }
        }
    }

    fn blocks_below<'a, R, F>(&self, reach: R, above: Above, blocks: &mut Blocks<'_, F>) -> Result<()>
    where
        R: Reach<'a>,
        F: FnMut([u64; 3], [usize; 3], V),
    {
        let record = self.record_in(reach, above.node)?;
        let form = &self.archive.form;
        let levels = above.levels - 1;
        let side = 1u64 << levels;
        let extent = [side, side, if D::AXES > 2 { side } else { 1 }];
        let mut next = form.head();
        for step in 0..D::CHILDREN {
            let state = record.states >> (2 * step) & 3;
            let field = next;
            match state {
                0 => continue,
                1 => next += size_of::<V::Wire>(),
                _ => next += form.pointer_size(state),
            }
            let min: [u64; 3] =
                std::array::from_fn(|axis| above.min[axis] + ((step as u64 >> axis & 1) << levels));
            let space = || Bounds { min, max: std::array::from_fn(|axis| min[axis] + extent[axis]) };
            if blocks.bounds.intersect(&space()).is_empty() {
                continue;
            }
            let value = if state == 1 {
                Self::value_in(&record.bytes, field)
            } else {
                let node = self.follow(&record, field, state, above.node.height)?;
                if levels > 0 && blocks.bounds.contains(&space()) {
                    self.all_blocks_below(reach, Above { node, min, levels }, &mut blocks.each)?;
                    continue;
                }
                if levels > 0 {
                    self.blocks_below(reach, Above { node, min, levels }, blocks)?;
                    continue;
                }
                self.representative_in(reach, node.address)?
            };
            blocks.part(&space(), value);
        }
        Ok(())
    }

    /// The same of a node all of which is in the box: what windows spend their time on.
    fn all_blocks_below<'a, R, F>(&self, reach: R, above: Above, each: &mut F) -> Result<()>
    where
        R: Reach<'a>,
        F: FnMut([u64; 3], [usize; 3], V),
    {
        let record = self.record_in(reach, above.node)?;
        let form = &self.archive.form;
        let levels = above.levels - 1;
        let side = 1usize << levels;
        let size = [side, side, if D::AXES > 2 { side } else { 1 }];
        let [x, y, z] = above.min;
        let place = |step: usize| {
            let bit = |axis: usize| (step as u64 >> axis & 1) << levels;
            [x + bit(0), y + bit(1), if D::AXES > 2 { z + bit(2) } else { z }]
        };
        let mut next = form.head();
        // Most records where there is detail, and nothing to guess about them.
        if record.states == ALL_LEAVES >> (16 - 2 * D::CHILDREN) {
            for step in 0..D::CHILDREN {
                each(place(step), size, Self::value_in(&record.bytes, next));
                next += size_of::<V::Wire>();
            }
            return Ok(());
        }
        for step in 0..D::CHILDREN {
            let state = record.states >> (2 * step) & 3;
            let field = next;
            let min = place(step);
            match state {
                0 => {}
                1 => {
                    next += size_of::<V::Wire>();
                    each(min, size, Self::value_in(&record.bytes, field));
                }
                _ => {
                    next += form.pointer_size(state);
                    let node = self.follow(&record, field, state, above.node.height)?;
                    if levels > 0 {
                        self.all_blocks_below(reach, Above { node, min, levels }, each)?;
                    } else {
                        each(min, size, self.representative_in(reach, node.address)?);
                    }
                }
            }
        }
        Ok(())
    }
}

impl<F> Blocks<'_, F> {
    /// What of a block is in the box.
    fn part<V>(&mut self, space: &Bounds, value: V)
    where
        F: FnMut([u64; 3], [usize; 3], V),
    {
        let part = space.intersect(self.bounds);
        if !part.is_empty() {
            (self.each)(part.min, part.size().map(|cells| cells as usize), value);
        }
    }
}
