//! Set operations by merging trees (B. Naylor, J. Amanatides, W. Thibault, *Merging BSP trees
//! yields polyhedral set operations*, 1990).
//!
//! The merged tree divides as the first one does, and its cells as the second one does. Lines and
//! planes of one tree do not split the other into copies: the traversal of a region skips nodes
//! that do not cut it.

use spinney_base::{Error, Progress, Result, SetOperation};

use super::region::Region;
use super::{Bsp, BspNode, Division};
use crate::preorder::{BinaryNode, PreorderBuilder};

impl Bsp {
    /// Computes a set operation on this tree and another one.
    ///
    /// # Errors
    /// If one tree is of the plane and the other of space, or on cancellation.
    pub fn combine(&self, other: &Bsp, operation: SetOperation, progress: &dyn Progress) -> Result<Bsp> {
        if self.dimension != other.dimension {
            return Err(Error::invalid(
                "BSP trees",
                "one of the plane and one of space",
                "two of the same dimension",
            ));
        }
        let result = |a: bool, b: bool| operation.contains(a, b);
        let mut made = PreorderBuilder::new(|_: &Division| false);
        let mut pending = vec![(0, 0, Region::space(self.dimension))];
        while let Some((a, b, region)) = pending.pop() {
            progress.check()?;
            let (by, second, is_first) = match (&self.nodes[a], &other.nodes[b]) {
                (BinaryNode::Leaf(a), BinaryNode::Leaf(b)) => {
                    made.leaf(result(*a, *b));
                    continue;
                }
                (BinaryNode::Leaf(a), _) if result(*a, false) == result(*a, true) => {
                    made.leaf(result(*a, true));
                    continue;
                }
                (_, BinaryNode::Leaf(b)) if result(false, *b) == result(true, *b) => {
                    made.leaf(result(true, *b));
                    continue;
                }
                (BinaryNode::Divided { by, second }, _) => (by, *second, true),
                (_, BinaryNode::Divided { by, second }) => (by, *second, false),
            };
            let back = if is_first { (a + 1, b) } else { (a, b + 1) };
            let front = if is_first { (second, b) } else { (a, second) };
            match region.sides(&by.plane) {
                [true, true] => {
                    made.divide(Division { plane: by.plane, fragments: Vec::new() });
                    let ([back_part, front_part], _) = region.cut(&by.plane);
                    pending.push((front.0, front.1, front_part));
                    pending.push((back.0, back.1, back_part));
                }
                [is_back, _] => {
                    let (a, b) = if is_back { back } else { front };
                    pending.push((a, b, region));
                }
            }
        }
        Ok(Bsp { dimension: self.dimension, nodes: made.finish() })
    }

    /// Returns the tree with inside and outside exchanged.
    pub fn complement(&self) -> Bsp {
        let turned = |node: &BspNode| match node {
            BinaryNode::Leaf(is_inside) => BinaryNode::Leaf(!is_inside),
            divided => divided.clone(),
        };
        Bsp { dimension: self.dimension, nodes: self.nodes.iter().map(turned).collect() }
    }
}
