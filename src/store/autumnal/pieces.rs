//! Hands out what is in a box of cells: uniform blocks, and runs of records.

use super::extents::ByteAccess;
use super::reader::{Autumnal, Node};
use crate::space::Bounds;
use crate::store::container::{LEAF, VOID};
use crate::tree::Child;
use crate::value::Value;
use crate::{Error, Result};

/// A part of a box of cells.
pub(crate) enum Piece<'r> {
    /// A uniform block, or a node at the level of the cells.
    Uniform(Value),
    /// Records of a node and of all that is below it, and levels from the node down to the cells; and what to say if they
    /// contradict each other.
    Run(&'r [u8], u8, &'r dyn Fn() -> Error),
}

/// Takes pieces with the box of their cells, which may stick out of that which was asked for.
type EachPiece<'a> = dyn FnMut(&Bounds, Piece<'_>) -> Result<()> + 'a;

impl Autumnal {
    /// Hands out the pieces that a box of cells of a level is made of, but for those that are VOID.
    ///
    /// # Errors
    /// If the file is damaged there, or `each` fails.
    pub(crate) fn pieces(&self, level: u8, bounds: &Bounds, each: &mut EachPiece<'_>) -> Result<()> {
        let space = Bounds::space(self.layout().form.dimension, level);
        match self.root_child() {
            Child::Inner { node, .. } if level > 0 => match self.extents().mapped() {
                Some(mapped) => self.pieces_below(mapped, (node, level), &space, (bounds, each)),
                None => self.pieces_below(self.extents(), (node, level), &space, (bounds, each)),
            },
            root => root.value().map_or(Ok(()), |value| each(&space, Piece::Uniform(value))),
        }
    }

    /// The pieces below a node so many levels above the cells, whose cells are `space`.
    fn pieces_below<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        (node, levels): (Node, u8),
        space: &Bounds,
        (bounds, each): (&Bounds, &mut EachPiece<'_>),
    ) -> Result<()> {
        let layout = self.layout();
        if layout.is_run(node.height) {
            let run = self.run_in(access, node)?;
            let bad_run = || self.bad_run(node.address);
            return each(space, Piece::Run(self.run_records(&run), levels, &bad_run));
        }
        let record = self.record_in(access, node)?;
        let dimension = layout.form.dimension;
        let mut next = layout.head_size();
        for step in 0..layout.children() {
            let state = record.state(step);
            let field = next;
            match state {
                VOID => continue,
                LEAF => next += layout.width(),
                _ => next += layout.pointer_size(state),
            }
            let space = space.child(dimension, step);
            if bounds.intersect(&space).is_empty() {
                continue;
            }
            if state == LEAF {
                each(&space, Piece::Uniform(self.value_in(&record.bytes, field)))?;
                continue;
            }
            let node = self.follow(&record, field, state, node.height)?;
            if levels == 1 {
                each(&space, Piece::Uniform(self.representative_in(access, node)?))?;
            } else {
                self.pieces_below(access, (node, levels - 1), &space, (bounds, each))?;
            }
        }
        Ok(())
    }
}
