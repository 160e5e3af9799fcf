//! Binary trees in preorder: behind a node that divides comes what is on its first side, without a link to it.

/// A node: it divides by something, or is a leaf.
#[derive(Clone, Debug, PartialEq)]
pub enum BinaryNode<D, L> {
    /// Two sides. The first one begins with the next node.
    Divided {
        /// Where it divides.
        by: D,
        /// Number of the node with which the second side begins.
        second: usize,
    },
    /// No more detail.
    Leaf(L),
}

/// A tree that grows in preorder: each node that divides is followed by its first side and then by its second one. Nodes with two equal
/// leaves become leaves at once, but for those that have something of their own.
pub(crate) struct Growing<D, L> {
    nodes: Vec<BinaryNode<D, L>>,
    /// Nodes whose sides are not both there, from the root down.
    open: Vec<usize>,
    is_needed: fn(&D) -> bool,
}

impl<D, L: Copy + PartialEq> Growing<D, L> {
    /// A tree without nodes; those for which `is_needed` holds stay, also above equal leaves.
    pub(crate) fn new(is_needed: fn(&D) -> bool) -> Growing<D, L> {
        Growing { nodes: Vec::new(), open: Vec::new(), is_needed }
    }

    /// Makes room for so many nodes.
    pub(crate) fn reserve(&mut self, count: usize) {
        self.nodes.reserve(count);
    }

    /// Adds a node that divides.
    pub(crate) fn divide(&mut self, by: D) {
        self.open.push(self.nodes.len());
        // (The number of the second side is known when the first one is complete. No second side is the root.)
        self.nodes.push(BinaryNode::Divided { by, second: 0 });
    }

    /// Adds a leaf, and closes all nodes that are complete by it.
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

    /// Number of nodes so far.
    pub(crate) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The nodes of the tree, which has to be complete.
    pub(crate) fn finish(self) -> Vec<BinaryNode<D, L>> {
        debug_assert!(self.open.is_empty() && !self.nodes.is_empty());
        self.nodes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_leaves_become_one_all_the_way_up() {
        let mut tree = Growing::new(|by: &char| *by == 'k');
        for symbol in "xyz11y11k22".chars() {
            match symbol.to_digit(10) {
                Some(leaf) => tree.leaf(leaf),
                None => tree.divide(symbol),
            }
        }
        // `z11` and `y11` are leaves, and `y` above them; what is needed stays.
        let leaf = BinaryNode::Leaf;
        let divided = |by, second| BinaryNode::Divided { by, second };
        assert_eq!(tree.finish(), [divided('x', 2), leaf(1), divided('k', 4), leaf(2), leaf(2)]);
    }
}
