//! An index some of whose sources were changed, added or removed.

use crate::store::builder::{ReusableSource, StoredNode};
use crate::store::goblin::{Goblin, GoblinNode, ReferencedCells};
use crate::store::{BuildOptions, TreeWriter};
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::io::ReadBackend;
use spinney_base::space::{Code, Region};
use spinney_base::value::Value;
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::Header;

/// Writes the next layer of an index from one of an old index, with new cells in the regions for
/// which `is_new` holds. Other nodes are those of the old index, whose segments are copied, so that
/// only new cells are read. `cells` are those of the new index, with the bytes that describe them
/// and the number of the layer. The options have the new depth, which is at least the old one. The
/// cells of both indexes are at the same columns and rows.
///
/// # Errors
/// If the old index or new cells cannot be read, or the file cannot be written.
pub fn write_updated_layer(
    file: &mut TreeWriter,
    old: &Goblin,
    (cells, is_new): (NewCells<'_>, &(dyn Fn(&Region) -> bool + Sync)),
    (options, extent): (&BuildOptions, [u64; 3]),
    progress: &dyn Progress,
) -> Result<()> {
    let header = options.header(old.header().form, extent)?;
    let source = UpdatedIndex { old, header: &header, cells, is_new };
    file.source_with(&source, extent, options, progress, &mut |_| {}).map(|_| ())
}

/// The cells of a new index, the bytes that describe them, and the number of a layer.
type NewCells<'a> = (&'a dyn ReferencedCells, &'a dyn ReadBackend, usize);

/// A layer of an index with new cells in some regions.
struct UpdatedIndex<'a> {
    old: &'a Goblin,
    header: &'a Header,
    cells: NewCells<'a>,
    /// Returns whether some cells of a region are new.
    is_new: &'a (dyn Fn(&Region) -> bool + Sync),
}

/// An INNER node of an updated index.
#[derive(Clone, Copy, Debug)]
enum UpdatedNode {
    /// A node of the old index.
    Same(GoblinNode),
    /// A node above the blocks with new cells below it.
    Mixed(Code),
    /// A block with new cells.
    Block(Code),
}

impl UpdatedIndex<'_> {
    fn child(&self, code: Code) -> Result<Child<UpdatedNode>> {
        let region = self.header.region_of(code);
        if region.is_empty() {
            return Ok(Child::Void);
        }
        let inner = |node| Child::Inner { representative: Value::ZERO, node };
        let deeper = self.header.depth() - self.old.header().depth();
        let block = self.header.shape.block_level();
        // (Builders do not copy a root. If it is a block, its cells are read, by the new index's
        // names of sources.)
        let is_only_block = code.level() == deeper && self.old.header().shape.block_level() == 0;
        if (self.is_new)(&region) || code.level() < deeper || is_only_block {
            let node = if code.level() < block { UpdatedNode::Mixed(code) } else { UpdatedNode::Block(code) };
            return Ok(inner(node));
        }
        if (0..deeper).any(|level| code.step(level) != 0) {
            return Ok(Child::Void);
        }
        // The same node, below a root that is fewer levels above it.
        let root = Code::root(code.dimension());
        let old = (deeper..code.level()).fold(root, |node, level| node.child(code.step(level)));
        Ok(self.old.child_at(old)?.map_node(UpdatedNode::Same))
    }
}

impl Source for UpdatedIndex<'_> {
    type Node = UpdatedNode;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<UpdatedNode>> {
        self.child(Code::root(self.header.form.dimension))
    }

    fn children(&self, node: &UpdatedNode, children: &mut Children<UpdatedNode>) -> Result<()> {
        let count = self.header.form.children();
        match node {
            UpdatedNode::Same(node) => {
                let mut same = no_children();
                self.old.children(node, &mut same)?;
                for (child, same) in children.iter_mut().zip(same).take(count) {
                    *child = same.map_node(UpdatedNode::Same);
                }
            }
            UpdatedNode::Mixed(code) => {
                for (step, child) in children[..count].iter_mut().enumerate() {
                    *child = self.child(code.child(step))?;
                }
            }
            // (The builder takes all cells of a block at once.)
            UpdatedNode::Block(code) => {
                let part = format!("node {code}");
                return Err(Error::corrupt(self.old.path(), part, "a block in parts", "all of its cells"));
            }
        }
        Ok(())
    }

    fn cells(&self, node: &UpdatedNode, levels: u8) -> Result<Option<CellBlock>> {
        let code = match node {
            UpdatedNode::Same(node) => return self.old.cells(node, levels),
            UpdatedNode::Mixed(_) => return Ok(None),
            UpdatedNode::Block(code) => *code,
        };
        let (cells, bytes, layer) = self.cells;
        let region = self.header.region_of(code);
        let slab = cells.read(bytes, layer, region)?;
        let width = self.header.form.width();
        let nodata = cells.nodata(layer).map(|value| value.to_bytes()[..width].to_vec());
        let side = 1usize << levels;
        let mut block = CellBlock::void(side * side, width);
        for row in 0..region.height as usize {
            let (from, to) = (row * region.width as usize, row * side);
            let count = region.width as usize;
            block.values[to * width..][..count * width]
                .copy_from_slice(&slab.bytes[from * width..][..count * width]);
            for column in 0..count {
                let is_valid = slab.valid.as_ref().is_none_or(|valid| valid[from + column]);
                let value = &slab.bytes[(from + column) * width..][..width];
                block.present[to + column] = is_valid && nodata.as_deref() != Some(value);
            }
        }
        Ok(Some(block))
    }

    fn check_unchanged(&self) -> Result<()> {
        self.old.check_unchanged()
    }
}

impl ReusableSource for UpdatedIndex<'_> {
    fn stored(&self, node: &UpdatedNode) -> Option<StoredNode<'_>> {
        match node {
            UpdatedNode::Same(node) => self.old.stored(node),
            UpdatedNode::Mixed(_) | UpdatedNode::Block(_) => None,
        }
    }
}
