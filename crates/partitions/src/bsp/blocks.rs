//! BSP trees as quadtrees and octrees.

use spinney_base::space::Code;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Error, Result, TreeType};
use spinney_brep::MAX_BITS;
use spinney_engine::tree::{Child, Children, Source};

use super::Bsp;
use super::region::Region;
use crate::preorder::BinaryNode;

/// Quadtree of a BSP tree of the plane, or octree of one of space. Values are bytes: 255 is inside,
/// VOID is outside. Blocks are classified by the BSP cells they intersect, single cells by their
/// centres.
#[derive(Clone, Copy, Debug)]
pub struct BspBlocks<'a> {
    tree: &'a Bsp,
    depth: u8,
}

impl Bsp {
    /// Returns the tree as a source with `depth` levels, whose cells are one grid unit wide.
    ///
    /// # Errors
    /// If a quadtree or octree, or the grid, has fewer levels.
    pub fn blocks(&self, depth: u8) -> Result<BspBlocks<'_>> {
        let limit = self.dimension.max_depth().min(MAX_BITS);
        match depth <= limit {
            true => Ok(BspBlocks { tree: self, depth }),
            false => Err(Error::invalid("depth", depth.to_string(), format!("at most {limit}"))),
        }
    }
}

impl BspBlocks<'_> {
    fn block(&self, code: Code) -> Child<Code> {
        let bounds = code.bounds(self.depth);
        let nodes = &self.tree.nodes;
        let full = Value::from([255u8]);
        let uniform = |is_inside: bool| Child::uniform(is_inside.then_some(full));
        if code.level() == self.depth {
            // In trees of the plane, z has no effect.
            let centre = bounds.min.map(|at| 2 * i128::from(at) + 1);
            return uniform(matches!(nodes[self.tree.leaf_at(centre)], BinaryNode::Leaf(true)));
        }
        let [min, max] = [bounds.min, bounds.max].map(|end| end.map(|at| at as i32));
        let (mut found, mut pending) = (None, vec![(0, Region::of_box(min, max))]);
        while let Some((at, region)) = pending.pop() {
            match &nodes[at] {
                BinaryNode::Leaf(is_inside) if found.is_some_and(|found| found != *is_inside) => {
                    return Child::Inner { representative: full, node: code };
                }
                BinaryNode::Leaf(is_inside) => found = Some(*is_inside),
                BinaryNode::Divided { by, second } => match region.sides(&by.plane) {
                    [true, true] => {
                        let ([back, front], _) = region.cut(&by.plane);
                        pending.extend([(at + 1, back), (*second, front)]);
                    }
                    [is_back, _] => pending.push((if is_back { at + 1 } else { *second }, region)),
                },
            }
        }
        uniform(found == Some(true))
    }
}

impl Source for BspBlocks<'_> {
    type Node = Code;

    fn form(&self) -> TreeType {
        TreeType::new(self.tree.dimension, ValueType::new(SampleType::U8, 1))
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<Code>> {
        Ok(self.block(Code::root(self.tree.dimension)))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        for (step, child) in children.iter_mut().take(self.tree.dimension.children()).enumerate() {
            *child = self.block(node.child(step));
        }
        Ok(())
    }
}
