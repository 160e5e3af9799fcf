//! Trees that somebody else makes, block by block: what the engine does not know how to make, such as features.

use std::path::{Path, PathBuf};

use super::blocks::{BLOCK_LEVELS, Block, Blocks};
use crate::store::builder::ReusableSource;
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::{Result, TreeType};
use spinney_container::{Header, Metadata};

/// Maker of the cells of a quadtree.
pub trait BlockSource: Send + Sync {
    /// A node at the level of blocks, eight levels above the cells, or above it; the root, if there are fewer levels.
    ///
    /// # Errors
    /// If it cannot be made.
    fn node(&self, code: Code) -> Result<Child<Code>>;

    /// The cells of an INNER node at the level of blocks.
    ///
    /// # Errors
    /// If they cannot be made.
    fn block(&self, code: Code) -> Result<CellBlock>;
}

/// A quadtree that is made block by block, when somebody asks for it; with the header and metadata that a file of it has. Memory: sixteen
/// blocks, for those who walk nodes.
pub struct Blockwise {
    tree: Box<dyn BlockSource>,
    name: PathBuf,
    header: Header,
    metadata: Metadata,
    blocks: Blocks,
}

impl Blockwise {
    /// A tree with a name for messages.
    ///
    /// # Panics
    /// If it is said to be an octree.
    pub fn new(tree: Box<dyn BlockSource>, name: &Path, header: Header, metadata: Metadata) -> Blockwise {
        assert_eq!(header.form.dimension, Dimension::Quad, "blocks are of quadtrees");
        Blockwise { tree, name: name.into(), header, metadata, blocks: Blocks::default() }
    }

    /// The name for messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// The header of a file of the tree.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The metadata of a file of the tree.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn block_level(&self) -> u8 {
        self.header.depth().saturating_sub(BLOCK_LEVELS[0])
    }

    /// A block with the nodes above its cells.
    fn pyramid(&self, code: Code) -> Result<Block> {
        let cells = self.tree.block(code)?;
        let height = self.header.depth() - code.level();
        Block::new(self.header.form, (code, height), &mut |above, _: &Bounds, values, valid| {
            // (What stands for a node above the cells is one of these.)
            if above == 0 {
                values.copy_from_slice(&cells.values);
                valid.copy_from_slice(&cells.present);
            }
            Ok(())
        })
    }
}

impl ReusableSource for Blockwise {}

impl Source for Blockwise {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<Code>> {
        self.tree.node(Code::root(Dimension::Quad))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        if node.level() >= self.block_level() {
            let levels = (self.header.depth(), self.block_level());
            return self.blocks.children(levels, *node, children, &|code| self.pyramid(code));
        }
        for (step, child) in children[..self.header.form.children()].iter_mut().enumerate() {
            *child = self.tree.node(node.child(step))?;
        }
        Ok(())
    }

    fn cells(&self, node: &Code, levels: u8) -> Result<Option<CellBlock>> {
        let is_block = node.level() == self.block_level() && node.level() + levels == self.header.depth();
        is_block.then(|| self.tree.block(*node)).transpose()
    }
}
