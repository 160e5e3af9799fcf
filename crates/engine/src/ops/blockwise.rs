//! Trees that a [`BlockSource`] computes block by block: for sources that the engine has no code
//! for, such as rasterized features.

use std::path::{Path, PathBuf};

use super::blocks::{Block, Blocks, block_levels};
use crate::store::builder::ReusableSource;
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::space::{Bounds, Code};
use spinney_base::{Result, TreeType};
use spinney_container::{Header, Metadata};

/// Computes the cells of a tree.
pub trait BlockSource: Send + Sync {
    /// Node at the block level (eight levels above the cells, or five in an octree) or above it;
    /// only the root if the tree has fewer levels.
    ///
    /// # Errors
    /// If it cannot be computed.
    fn node(&self, code: Code) -> Result<Child<Code>>;

    /// Cells of an INNER node at the block level.
    ///
    /// # Errors
    /// If they cannot be computed.
    fn block(&self, code: Code) -> Result<CellBlock>;
}

/// Tree that is computed block by block, on request, with the header and metadata that its file
/// would have. Memory: sixteen blocks, to speed up traversals by node.
pub struct Blockwise {
    tree: Box<dyn BlockSource>,
    name: PathBuf,
    header: Header,
    metadata: Metadata,
    blocks: Blocks,
}

impl Blockwise {
    /// Tree with a name for messages.
    pub fn new(tree: Box<dyn BlockSource>, name: &Path, header: Header, metadata: Metadata) -> Blockwise {
        Blockwise { tree, name: name.into(), header, metadata, blocks: Blocks::default() }
    }

    /// Name for messages.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Header that a file of the tree would have.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Metadata that a file of the tree would have.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn block_level(&self) -> u8 {
        self.header.depth().saturating_sub(block_levels(self.header.form.dimension))
    }

    /// Block with the nodes above its cells.
    fn pyramid(&self, code: Code) -> Result<Block> {
        let cells = self.tree.block(code)?;
        let height = self.header.depth() - code.level();
        Block::new(self.header.form, (code, height), &mut |above, _: &Bounds, values, valid| {
            // (Nodes above the cells get the value of a cell as representative.)
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
        self.tree.node(Code::root(self.header.form.dimension))
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
