//! Nodes of other files that were copied already, so that a file that stores equal subtrees once is copied record by
//! record and not node by node.

use std::collections::HashMap;

use super::built_node::BuiltNode;
use super::remembered::Remembered;
use crate::store::builder::RecordRef;
use spinney_base::io::FileId;
use spinney_base::space::Code;
use spinney_base::value::Value;

/// Nodes of other files and what they have become.
pub(super) struct Copied {
    /// Those on the way, by the nodes that are made of them.
    begun: HashMap<Code, RecordRef>,
    done: Remembered<(FileId, u64), BuiltNode>,
}

impl Copied {
    /// None yet, and room for what fits into so many bytes.
    pub(super) fn new(memory: u64) -> Copied {
        Copied { begun: HashMap::new(), done: Remembered::new(memory) }
    }

    /// Finds what a node has become, if that is known; else the node that is made of it will tell.
    pub(super) fn find(&mut self, code: Code, node: RecordRef) -> Option<BuiltNode> {
        let Some(found) = self.done.get(node.height, &(node.file, node.address)) else {
            self.begun.insert(code, node);
            return None;
        };
        let mut found = found.clone();
        found.part.code = code;
        Some(found)
    }

    /// A node is made, and in the file.
    pub(super) fn made(&mut self, code: Code, made: &BuiltNode) {
        if let Some(node) = self.begun.remove(&code) {
            let classes = made.part.tally.classes.len() * size_of::<(Value, u64)>();
            let more = classes + made.part.records.len();
            self.done.insert(node.height, (node.file, node.address), made.clone(), more as u64);
        }
    }
}
