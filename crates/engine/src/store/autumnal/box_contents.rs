//! Yields the contents of a box of cells: uniform blocks and runs of records.

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

/// Content of a part of a box.
pub(crate) enum BoxContent<'r> {
    /// Uniform block, or a node at the level of the result's cells.
    Uniform(Value),
    /// Run of a node, levels from the node down to the cells of the result, and the error to return
    /// if the run contradicts itself.
    Records(&'r [u8], u8, &'r dyn Fn() -> Error),
}

/// Visitor of fragments and their boxes, which may extend beyond the requested box.
type BoxContentVisitor<'a> = dyn FnMut(&Bounds, BoxContent<'_>) -> Result<()> + 'a;

impl Autumnal {
    /// Passes the fragments of a box of nodes at `level` to `each`, except for VOID ones. These
    /// nodes are the cells of the result, whatever is below them.
    ///
    /// # Errors
    /// If the file is corrupt there, or `each` fails.
    pub(crate) fn visit_contents(
        &self,
        level: u8,
        bounds: &Bounds,
        each: &mut BoxContentVisitor<'_>,
    ) -> Result<()> {
        let space = Bounds::space(self.layout().form.dimension, level);
        match self.root_child() {
            Child::Inner { node, .. } if level > 0 => match self.extents().mapped() {
                Some(mapped) => self.visit_contents_below(mapped, (node, level), &space, (bounds, each)),
                None => self.visit_contents_below(self.extents(), (node, level), &space, (bounds, each)),
            },
            root => root.value().map_or(Ok(()), |value| each(&space, BoxContent::Uniform(value))),
        }
    }

    /// Visits the fragments below a node with a record. The node is `levels` levels above the cells
    /// of the result, and `space` is its box.
    fn visit_contents_below<'a, A: ByteAccess<'a>>(
        &self,
        access: A,
        (node, levels): (AutumnalNode, u8),
        space: &Bounds,
        (bounds, each): (&Bounds, &mut BoxContentVisitor<'_>),
    ) -> Result<()> {
        let record = self.record_in(access, node)?;
        let layout = self.layout();
        let Some(target_height) =
            layout.heights.target_height(record.height).filter(|_| levels > layout.heights.run)
        else {
            let bad_run = || self.bad_run(node.address);
            return each(space, BoxContent::Records(record.run(), levels, &bad_run));
        };
        // Levels to the next nodes with records.
        let stride = record.height - target_height;
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
                        each(&space, BoxContent::Uniform(child.value))?;
                    } else if above > 0 {
                        // (Only the bottom level of a run has CUT children.)
                        if child.state != INNER {
                            return Err(self.bad_run(node.address));
                        }
                        deeper.push((child.node, path, space));
                    } else {
                        let next = self.follow(&record, path)?;
                        let next = next.ok_or_else(|| self.no_pointer(node.address))?;
                        let visited = self.visit_contents_below(
                            access,
                            (next, levels - stride),
                            &space,
                            (bounds, each),
                        );
                        defer_missing(visited, &mut is_unread)?;
                    }
                }
            }
            open = deeper;
        }
        finish_deferred(is_unread)
    }
}
