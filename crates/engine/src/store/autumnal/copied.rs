//! Results for nodes that were built before, so that a file that stores equal subtrees once is
//! copied record by record and not node by node.

use std::collections::HashMap;

use super::built_node::BuiltNode;
use super::remembered::Remembered;
use crate::store::builder::RecordRef;
use spinney_base::io::FileId;
use spinney_base::space::Code;
use spinney_base::value::Value;

/// Source nodes and the nodes that were built from them.
pub(super) struct Copied {
    /// Source nodes in progress, by the codes of the nodes being built from them.
    begun: HashMap<Code, RecordRef>,
    done: Remembered<(FileId, u64), BuiltNode>,
}

impl Copied {
    /// Creates an empty map that may use `memory` bytes.
    pub(super) fn new(memory: u64) -> Copied {
        Copied { begun: HashMap::new(), done: Remembered::new(memory) }
    }

    /// Returns the result for a source node at `code` if it is known. Otherwise the node is
    /// recorded as in progress, until [`Self::made`] provides its result.
    pub(super) fn find(&mut self, code: Code, node: RecordRef) -> Option<BuiltNode> {
        let Some(found) = self.done.get(node.height, &(node.file, node.address)) else {
            self.begun.insert(code, node);
            return None;
        };
        let mut found = found.clone();
        found.subtree.code = code;
        Some(found)
    }

    /// Records that the node at `code` was built and written.
    pub(super) fn made(&mut self, code: Code, made: &BuiltNode) {
        if let Some(node) = self.begun.remove(&code) {
            let classes = made.subtree.tally.classes.len() * size_of::<(Value, u64)>();
            let more = classes + made.subtree.records.len();
            self.done.insert(node.height, (node.file, node.address), made.clone(), more as u64);
        }
    }
}
