//! Autumnal trees with a patch applied.

use std::sync::Arc;

use super::patch::{Change, Patch};
use crate::store::autumnal::{Autumnal, AutumnalNode};
use crate::store::builder::{RecordRef, ReusableSource, StoredNode};
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{Value, ZoneStats};

/// Commit with a patch applied. Unchanged nodes are those of the commit, with their stored records.
#[derive(Clone)]
pub struct Patched {
    file: Arc<Autumnal>,
    patch: Arc<dyn Patch>,
}

/// INNER node of a patched tree.
#[derive(Clone, Copy, Debug)]
pub enum PatchedNode {
    /// Unchanged node of the file.
    Same(AutumnalNode),
    /// Node with changes below it that is a LEAF or VOID (`None`) in the file.
    Uniform(Code, Option<Value>),
    /// Node with changes below it that is this INNER node in the file.
    Changed(Code, AutumnalNode),
}

impl Patched {
    /// Applies a patch to a commit.
    pub fn new(file: Arc<Autumnal>, patch: Arc<dyn Patch>) -> Patched {
        Patched { file, patch }
    }

    /// The file below the patch.
    pub fn file(&self) -> &Arc<Autumnal> {
        &self.file
    }

    /// Applies the patch to a node that is `child` in the file.
    fn changed(&self, code: Code, child: Child<AutumnalNode>) -> Child<PatchedNode> {
        match self.patch.change(code, &code.bounds(self.file.depth())) {
            Change::Keep => child.map_node(PatchedNode::Same),
            Change::Uniform(value) => Child::uniform(value),
            Change::Split => {
                let value = child.value();
                let node = match child {
                    Child::Inner { node, .. } => PatchedNode::Changed(code, node),
                    Child::Void | Child::Leaf(_) => PatchedNode::Uniform(code, value),
                };
                Child::Inner { representative: value.unwrap_or_default(), node }
            }
        }
    }
}

impl Source for Patched {
    type Node = PatchedNode;

    fn form(&self) -> TreeType {
        self.file.form()
    }

    fn depth(&self) -> u8 {
        self.file.depth()
    }

    fn root(&self) -> Result<Child<PatchedNode>> {
        Ok(self.changed(Code::root(self.form().dimension), self.file.root()?))
    }

    fn children(&self, node: &PatchedNode, children: &mut Children<PatchedNode>) -> Result<()> {
        let found: Children<AutumnalNode> = match node {
            PatchedNode::Same(node) | PatchedNode::Changed(_, node) => {
                let mut found = no_children();
                self.file.children(node, &mut found)?;
                found
            }
            PatchedNode::Uniform(_, value) => [Child::uniform(*value); 8],
        };
        let children = &mut children[..self.form().children()];
        for (step, (child, found)) in children.iter_mut().zip(&found).enumerate() {
            *child = match node {
                PatchedNode::Same(_) => found.map_node(PatchedNode::Same),
                PatchedNode::Uniform(code, _) | PatchedNode::Changed(code, _) => {
                    self.changed(code.child(step), *found)
                }
            };
        }
        Ok(())
    }

    fn cells(&self, node: &PatchedNode, levels: u8) -> Result<Option<CellBlock>> {
        match node {
            PatchedNode::Same(node) => self.file.cells(node, levels),
            PatchedNode::Uniform(..) | PatchedNode::Changed(..) => Ok(None),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        self.file.check_unchanged()
    }

    fn tally(&self, node: &PatchedNode) -> Result<Option<ZoneStats>> {
        match node {
            PatchedNode::Same(node) => self.file.tally(node),
            PatchedNode::Uniform(..) | PatchedNode::Changed(..) => Ok(None),
        }
    }
}

impl ReusableSource for Patched {
    fn stored(&self, node: &PatchedNode) -> Option<StoredNode<'_>> {
        match node {
            PatchedNode::Same(node) => self.file.stored(node),
            PatchedNode::Uniform(..) | PatchedNode::Changed(..) => None,
        }
    }

    fn kept(&self, node: &PatchedNode) -> Option<RecordRef> {
        match node {
            PatchedNode::Same(node) => self.file.kept(node),
            PatchedNode::Uniform(..) | PatchedNode::Changed(..) => None,
        }
    }
}
