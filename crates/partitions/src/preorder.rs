//! Binary trees in preorder: a dividing node is followed by its first side, so it needs no link to
//! it.

/// Node of a binary tree: an inner node that divides, or a leaf.
#[derive(Clone, Debug, PartialEq)]
pub enum BinaryNode<D, L> {
    /// Inner node with two sides. The first side begins at the next node.
    Divided {
        /// Divider of the two sides.
        by: D,
        /// Index of the node at which the second side begins.
        second: usize,
    },
    /// Leaf.
    Leaf(L),
}

/// Builder of a tree in preorder: each dividing node is followed by its first side and then by its
/// second one. A node with two equal leaves is replaced by a leaf at once, unless `is_needed` holds
/// for it.
pub(crate) struct PreorderBuilder<D, L> {
    nodes: Vec<BinaryNode<D, L>>,
    /// Nodes with an incomplete side, from the root down.
    open: Vec<usize>,
    is_needed: fn(&D) -> bool,
}

impl<D, L: Copy + PartialEq> PreorderBuilder<D, L> {
    /// Builder without nodes. Nodes for which `is_needed` holds are kept even above equal leaves.
    pub(crate) fn new(is_needed: fn(&D) -> bool) -> PreorderBuilder<D, L> {
        PreorderBuilder { nodes: Vec::new(), open: Vec::new(), is_needed }
    }

    /// Reserves capacity for `count` more nodes.
    pub(crate) fn reserve(&mut self, count: usize) {
        self.nodes.reserve(count);
    }

    /// Adds a dividing node.
    pub(crate) fn divide(&mut self, by: D) {
        self.open.push(self.nodes.len());
        // The index of the second side is set when the first side is complete. 0 means unset, since
        // the root is no second side.
        self.nodes.push(BinaryNode::Divided { by, second: 0 });
    }

    /// Adds a leaf, and closes all nodes that it completes.
    pub(crate) fn leaf(&mut self, leaf: L) {
        self.nodes.push(BinaryNode::Leaf(leaf));
        while let Some(&at) = self.open.last() {
            let end = self.nodes.len();
            let BinaryNode::Divided { by, second } = &mut self.nodes[at] else { return };
            if *second == 0 {
                *second = end;
                return;
            }
            self.open.pop();
            let is_needed = (self.is_needed)(by);
            if let [_, BinaryNode::Leaf(first), BinaryNode::Leaf(other)] = self.nodes[at..]
                && first == other
                && !is_needed
            {
                self.nodes.truncate(at);
                self.nodes.push(BinaryNode::Leaf(first));
            }
        }
    }

    /// Node count so far.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Returns the nodes. The tree must be complete.
    pub(crate) fn finish(self) -> Vec<BinaryNode<D, L>> {
        debug_assert!(self.open.is_empty() && !self.nodes.is_empty());
        self.nodes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_leaves_are_merged_up_to_the_root() {
        let mut tree = PreorderBuilder::new(|by: &char| *by == 'k');
        for symbol in "xyz11y11k22".chars() {
            match symbol.to_digit(10) {
                Some(leaf) => tree.leaf(leaf),
                None => tree.divide(symbol),
            }
        }
        // `z11` and `y11` become leaves, and `y` above them does too; needed nodes stay.
        let leaf = BinaryNode::Leaf;
        let divided = |by, second| BinaryNode::Divided { by, second };
        assert_eq!(tree.finish(), [divided('x', 2), leaf(1), divided('k', 4), leaf(2), leaf(2)]);
    }
}
