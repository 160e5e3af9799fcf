//! Copies of the segments of a base model in which nothing changes but face numbers.

use super::arena::Arena;
use super::base::BaseModel;
use super::upper::Upper;
use crate::{Faces, ModelNode, ModelNodeState};
use spinney_base::Result;

impl Upper<'_> {
    /// Copies the segment that begins at a node without changes, and all segments below it: only
    /// the lists of face numbers are rewritten. Returns `false` if the segment lists faces that are
    /// not kept: then nothing was copied.
    pub(super) fn copy_segment(
        &mut self,
        base: &BaseModel<'_>,
        node: &ModelNode<'_>,
        out: &mut Arena,
    ) -> Result<bool> {
        let face = |face: u32| base.faces.number(face.into());
        let exact = |face: u32| base.exact.number(face.into());
        if node.level() > base.model.grid().depth() {
            return Err(base.wrong(node));
        }
        // (Nodes below the maximum depth are joined.)
        if base.root.level + base.model.grid().depth() > self.depth {
            return Ok(false);
        }
        let code = base.cell_of(node, 0).code();
        let Some(bytes) = node.renumbered_segment(&face, &exact) else {
            return Ok(false);
        };
        self.copy_below(base, node, out)?;
        out.segments.push((code, bytes));
        self.store(out)?;
        Ok(true)
    }

    /// Counts the nodes of a copied segment from one of its nodes down, and copies the segments
    /// below.
    fn copy_below(&mut self, base: &BaseModel<'_>, node: &ModelNode<'_>, out: &mut Arena) -> Result<()> {
        match node.state() {
            ModelNodeState::Void => out.counts.void += 1,
            ModelNodeState::Full => out.counts.full += 1,
            ModelNodeState::Leaf { kind, .. } => out.counts.count(kind),
            ModelNodeState::Inner => {
                out.counts.inner += 1;
                self.visited += 1;
                if self.visited.is_multiple_of(1 << 10) {
                    self.progress.check()?;
                }
                for child in 0..8 {
                    let child = base.model.child(node, child)?;
                    match child.begins_segment() {
                        // (Its parent refers to it by CUT in any case.)
                        true if self.copy_segment(base, &child, out)? => {}
                        true => self.rebuild_segment(base, &child, out)?,
                        false => self.copy_below(base, &child, out)?,
                    }
                }
            }
        }
        Ok(())
    }

    /// Copies a segment node by node, into a segment however small it is.
    fn rebuild_segment(&mut self, base: &BaseModel<'_>, node: &ModelNode<'_>, out: &mut Arena) -> Result<()> {
        let mark = out.mark();
        let word = self.copy(base, node, out)?;
        if word != crate::store::segment::CUT {
            out.cut(base.cell_of(node, 0).code(), mark, word);
        }
        self.store(out)
    }
}
