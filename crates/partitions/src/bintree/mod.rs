//! Bintrees: quadtrees and octrees that halve a block along one axis at a time.
//!
//! The axes alternate, x first, or are chosen for the minimum number of nodes (`adaptive.rs`).
//! `text.rs` writes trees as DF-expressions, and parses these.

mod adaptive;
mod text;

pub use adaptive::MAX_CELLS;

use std::ops::ControlFlow;

use spinney_base::space::{Bounds, Code};
use spinney_base::value::Value;
use spinney_base::{Error, Result, TreeType};
use spinney_engine::tree::{CellBlock, Child, Children, Source, no_children};

use crate::preorder::{BinaryNode, PreorderBuilder};

/// Order of the axes along which a bintree halves its blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halving {
    /// Cyclic order: x, y, z (in volumes), then x again.
    Alternating,
    /// At each node, the axis with the fewest nodes below; the first one on a tie.
    Adaptive,
}

/// Node of a bintree: it halves its block along an axis (0 to 2), or is a leaf with one value
/// throughout; `None` is VOID. The first side has the lower coordinates.
pub type BintreeNode = BinaryNode<u8, Option<Value>>;

/// Bintree in memory. It is always condensed: no node has two leaves with equal values.
///
/// ```
/// use spinney::raw::partitions::Bintree;
/// use spinney::{Dimension, Rule, SampleType, TreeType, Value, ValueType};
/// use spinney::raw::tree::df;
///
/// let form = TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1));
/// let quadtree = df::from_text(form, "G B W B G W W W B", 2, Value::from([255u8]), Rule::Mean)?;
/// let bintree = Bintree::alternating(&quadtree, [4, 4, 1], 1000)?;
/// assert_eq!(bintree.to_text(), "bintree:alternating:xy:2:u8:4x4 GBGWGWGWB");
/// assert_eq!(Bintree::from_text(&bintree.to_text(), 1000)?, bintree);
/// // Halving along y first saves two nodes.
/// assert_eq!(Bintree::adaptive(&quadtree, [4, 4, 1])?.nodes().len(), 9);
/// # Ok::<(), spinney::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Bintree {
    form: TreeType,
    depth: u8,
    halving: Halving,
    extent: [u64; 3],
    nodes: Vec<BintreeNode>,
}

impl Bintree {
    /// Builds the bintree with alternating axes of a source. `extent` is the size of its raster or
    /// volume in cells. The source is traversed node by node, so memory is needed only for the
    /// resulting nodes.
    ///
    /// # Errors
    /// If the source fails, or there are more than `most` nodes.
    pub fn alternating<S: Source>(source: &S, extent: [u64; 3], most: usize) -> Result<Bintree> {
        enum PendingItem<N> {
            Halve(u8),
            Node(Child<N>),
        }
        let (form, depth) = (source.form(), source.depth());
        let axes = form.axes();
        let mut made = preorder_builder();
        let mut pending = vec![PendingItem::Node(source.root()?)];
        let mut children = no_children();
        while let Some(item) = pending.pop() {
            if made.len() >= most {
                return Err(too_many(most));
            }
            match item {
                PendingItem::Halve(axis) => made.divide(axis),
                PendingItem::Node(Child::Inner { node, .. }) => {
                    source.children(&node, &mut children)?;
                    // The stack is LIFO, hence the reverse order. Siblings are ordered so that x
                    // changes last.
                    for index in (0..form.children()).rev() {
                        let bits = index.reverse_bits() >> (usize::BITS as usize - axes);
                        pending.push(PendingItem::Node(std::mem::take(&mut children[bits])));
                        // A child is preceded by the halving of every block that begins with it.
                        let begun = (index.trailing_zeros() as usize).min(axes);
                        pending.extend((axes - begun..axes).rev().map(|axis| PendingItem::Halve(axis as u8)));
                    }
                }
                PendingItem::Node(uniform) => made.leaf(uniform.value()),
            }
        }
        source.check_unchanged()?;
        Ok(Bintree { form, depth, halving: Halving::Alternating, extent, nodes: made.finish() })
    }

    /// Dimension and value type.
    pub fn form(&self) -> TreeType {
        self.form
    }

    /// Cells of the raster or volume along each axis; cells beyond are VOID.
    pub fn extent(&self) -> [u64; 3] {
        self.extent
    }

    /// Nodes in preorder.
    pub fn nodes(&self) -> &[BintreeNode] {
        &self.nodes
    }

    /// Calls `take` for every leaf in order, with its cells.
    pub fn each_leaf(&self, take: &mut dyn FnMut(Bounds, Option<Value>)) {
        let _ = self.leaves_in(&self.space(), &mut |block, value| {
            take(block, value);
            ControlFlow::Continue(())
        });
    }

    fn space(&self) -> Bounds {
        Bounds::space(self.form.dimension, self.depth)
    }

    /// Calls `take` for every leaf that intersects a box, until it breaks.
    fn leaves_in(
        &self,
        wanted: &Bounds,
        take: &mut dyn FnMut(Bounds, Option<Value>) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let mut pending = vec![(0, self.space())];
        while let Some((at, block)) = pending.pop() {
            match self.nodes[at] {
                BinaryNode::Divided { by, second } => {
                    let [first, other] = halves(block, by);
                    let parts = [(second, other), (at + 1, first)].into_iter();
                    pending.extend(parts.filter(|(_, half)| !half.intersect(wanted).is_empty()));
                }
                BinaryNode::Leaf(value) => take(block, value)?,
            }
        }
        ControlFlow::Continue(())
    }

    /// Content of a block: one value throughout, or several values.
    fn block(&self, code: Code) -> Child<Code> {
        let mut found = None;
        let all_alike = self.leaves_in(&code.bounds(self.depth), &mut |_, value| match found
            .get_or_insert(value)
            == &value
        {
            true => ControlFlow::Continue(()),
            false => ControlFlow::Break(()),
        });
        match all_alike {
            ControlFlow::Continue(()) => Child::uniform(found.flatten()),
            ControlFlow::Break(()) => Child::Inner { representative: Value::ZERO, node: code },
        }
    }
}

/// Condensed quadtree or octree of the same cells, for writing files. Representatives are zeros.
impl Source for Bintree {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<Code>> {
        Ok(self.block(Code::root(self.form.dimension)))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        for (step, child) in children.iter_mut().take(self.form.children()).enumerate() {
            *child = self.block(node.child(step));
        }
        Ok(())
    }

    fn cells(&self, node: &Code, _: u8) -> Result<Option<CellBlock>> {
        let (wanted, width) = (node.bounds(self.depth), self.form.width());
        let mut cells = CellBlock::void(wanted.volume() as usize, width);
        let [columns, rows, _] = wanted.size();
        let _ = self.leaves_in(&wanted, &mut |block, value| {
            let Some(value) = value else { return ControlFlow::Continue(()) };
            let (bytes, block) = (value.to_bytes(), block.intersect(&wanted));
            for z in block.min[2] - wanted.min[2]..block.max[2] - wanted.min[2] {
                for y in block.min[1] - wanted.min[1]..block.max[1] - wanted.min[1] {
                    let start = ((z * rows + y) * columns + block.min[0] - wanted.min[0]) as usize;
                    let row = start..start + block.size()[0] as usize;
                    cells.present[row.clone()].fill(true);
                    let values = cells.values[row.start * width..row.end * width].chunks_exact_mut(width);
                    values.for_each(|cell| cell.copy_from_slice(&bytes[..width]));
                }
            }
            ControlFlow::Continue(())
        });
        Ok(Some(cells))
    }
}

fn preorder_builder() -> PreorderBuilder<u8, Option<Value>> {
    PreorderBuilder::new(|_| false)
}

/// Both halves of a block, the one with lower coordinates first.
fn halves(block: Bounds, axis: u8) -> [Bounds; 2] {
    let axis = usize::from(axis);
    let middle = block.min[axis].midpoint(block.max[axis]);
    let (mut first, mut second) = (block, block);
    (first.max[axis], second.min[axis]) = (middle, middle);
    [first, second]
}

fn too_many(most: usize) -> Error {
    Error::invalid("bintree", format!("more than {most} nodes"), format!("at most {most}"))
}

#[cfg(test)]
mod tests;
