//! Hands out what is in a box of cells: uniform blocks, and runs of records.

use super::extents::ByteAccess;
use super::node::AutumnalNode;
use super::reader::Autumnal;
use crate::store::records::{RunChildren, RunNode, Runs};
use crate::tree::Child;
use spinney_base::io::batch::{defer_missing, finish_deferred};
use spinney_base::space::Bounds;
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_container::{INNER, LEAF, VOID};

/// A part of a box of cells.
pub enum Piece<'r> {
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
    pub fn pieces(&self, level: u8, bounds: &Bounds, each: &mut EachPiece<'_>) -> Result<()> {
        let space = Bounds::space(self.layout().form.dimension, level);
        match self.root_child() {
            Child::Inner { node, .. } if level > 0 => match self.extents().mapped() {
                Some(mapped) => self.pieces_below(mapped, (node, level), &space, (bounds, each)),
                None => self.pieces_below(self.extents(), (node, level), &space, (bounds, each)),
            },
            root => root.value().map_or(Ok(()), |value| each(&space, Piece::Uniform(value))),
        }
    }

    /// The pieces below a node with a record, so many levels above the cells, whose cells are `space`.
    fn pieces_below<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        (node, levels): (AutumnalNode, u8),
        space: &Bounds,
        (bounds, each): (&Bounds, &mut EachPiece<'_>),
    ) -> Result<()> {
        let record = self.record_in(access, node)?;
        let layout = self.layout();
        let Some(below) = layout.heights.below(record.height).filter(|_| levels > layout.heights.run) else {
            let bad_run = || self.bad_run(node.address);
            return each(space, Piece::Run(record.run(), levels, &bad_run));
        };
        // Levels between nodes with records.
        let stride = record.height - below;
        let dimension = layout.form.dimension;
        let mut open = vec![(RunNode::default(), 0, *space)];
        let (mut children, mut is_unread) = (RunChildren::default(), false);
        for above in (0..stride).rev() {
            let mut deeper = Vec::new();
            for (place, path, space) in open {
                let read = layout.run.run_children(record.run(), place, &mut children);
                read.ok_or_else(|| self.bad_run(node.address))?;
                for (step, child) in children[..dimension.children()].iter().enumerate() {
                    let space = space.child(dimension, step);
                    let path = path * dimension.children() + step;
                    if child.state == VOID || bounds.intersect(&space).is_empty() {
                        continue;
                    }
                    if child.state == LEAF {
                        each(&space, Piece::Uniform(child.value))?;
                    } else if above > 0 {
                        // (Nothing is cut off above the run's bottom.)
                        if child.state != INNER {
                            return Err(self.bad_run(node.address));
                        }
                        deeper.push((child.node, path, space));
                    } else {
                        let next = self.follow(&record, path)?;
                        let next = next.ok_or_else(|| self.no_pointer(node.address))?;
                        let below =
                            self.pieces_below(access, (next, levels - stride), &space, (bounds, each));
                        defer_missing(below, &mut is_unread)?;
                    }
                }
            }
            open = deeper;
        }
        finish_deferred(is_unread)
    }
}
