//! A mosaic as a source: nodes of a single file are forwarded, others are subdivided, down to
//! blocks of cells that are drawn.

use super::{Mosaic, MosaicNode};
use crate::ops::blocks::{Block, block_levels};
use crate::ops::tree_file::other_node;
use crate::query::tally_of;
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{Value, ZoneStats};
use spinney_base::{Result, TreeType};

impl Mosaic {
    fn block_level(&self) -> u8 {
        self.header.depth().saturating_sub(block_levels(self.header.form.dimension))
    }

    /// Node at the block level, or above it. The representative of a node of several files is left
    /// out, and computed on request.
    fn node(&self, code: Code) -> Result<Child<MosaicNode>> {
        let above = self.header.depth() - code.level();
        match self.meeting(&code.bounds(self.header.depth()))[..] {
            [] => Ok(Child::Void),
            // Invariant: if only one file has cells in a node, and begins at the border of a node
            // of that size, the node is one of the file's own, with all descendants. Its values,
            // averages and counts are those of the mosaic.
            [number] if self.lies_on_nodes(number, above) => self.node_of_file(number, code),
            _ => Ok(Child::Inner { representative: Value::ZERO, node: MosaicNode::Several(code) }),
        }
    }

    /// Node that is one of a file's own.
    fn node_of_file(&self, number: u32, code: Code) -> Result<Child<MosaicNode>> {
        let (entry, file) = (self.entry(number), self.file(number)?);
        let above = self.header.depth() - code.level();
        let (axes, cell) = (self.header.form.axes(), code.cell());
        let first = |axis: usize| if axis < axes { (entry.bounds.min[axis] >> above) as u32 } else { 0 };
        let own = std::array::from_fn(|axis| cell[axis] - first(axis));
        let Some(own) = Code::from_cell(self.header.form.dimension, entry.depth - above, own) else {
            return Ok(Child::Void);
        };
        let (mut child, mut children) = (file.root()?, no_children());
        for level in 0..own.level() {
            let Child::Inner { node, .. } = &child else { break };
            file.children(node, &mut children)?;
            child = std::mem::take(&mut children[own.step(level)]);
        }
        Ok(child.map_node(|node| MosaicNode::File(number, node)))
    }

    /// Representative of an INNER node, computed if it was left out.
    pub(in crate::ops) fn representative(&self, node: &MosaicNode, given: Value) -> Result<Value> {
        let MosaicNode::Several(code) = node else { return Ok(given) };
        let min = code.cell().map(u64::from);
        let (mut value, mut valid) = (vec![0; self.header.form.width()], [false]);
        let bounds = Bounds { min, max: min.map(|cell| cell + 1) };
        self.draw_at(code.level(), &bounds, &mut value, &mut valid)?;
        Ok(if valid[0] { Value::from_bytes(&value) } else { given })
    }

    /// [`Source::children`], as nodes of a source that derives from this tree.
    pub(in crate::ops) fn children_as<N>(
        &self,
        node: &MosaicNode,
        children: &mut Children<N>,
        node_of: impl Fn(MosaicNode) -> N,
    ) -> Result<()> {
        let mut found = no_children();
        self.children(node, &mut found)?;
        for (child, found) in children.iter_mut().zip(&found).take(self.header.form.children()) {
            *child = found.map_node(&node_of);
        }
        Ok(())
    }
}

impl Source for Mosaic {
    type Node = MosaicNode;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<MosaicNode>> {
        if self.header.depth() > 0 {
            return self.node(Code::root(self.header.form.dimension));
        }
        let cell = Bounds { min: [0; 3], max: [1; 3] };
        Ok(Child::uniform(self.draw_cells(cell)?.value([0; 3], self.header.form.width())))
    }

    fn children(&self, node: &MosaicNode, children: &mut Children<MosaicNode>) -> Result<()> {
        let code = match node {
            MosaicNode::Several(code) => *code,
            MosaicNode::File(number, node) => {
                let number = *number;
                if number as usize >= self.entries.len() {
                    return Err(other_node(&self.path));
                }
                let wrap = |node| MosaicNode::File(number, node);
                return self.file(number)?.children_with(node, children, wrap);
            }
        };
        if code.level() < self.block_level() {
            for (step, child) in children[..self.header.form.children()].iter_mut().enumerate() {
                *child = self.node(code.child(step))?;
            }
            return Ok(());
        }
        let (form, depth) = (self.header.form, self.header.depth());
        let mut found = no_children();
        self.blocks.children((depth, self.block_level()), code, &mut found, &|code| {
            Block::new(form, (code, depth - code.level()), &mut |above, bounds, values, valid| {
                // (Representatives of nodes above the cells are computed on request.)
                if above == 0 { self.draw_at(depth, bounds, values, valid) } else { Ok(()) }
            })
        })?;
        for (child, found) in children.iter_mut().zip(&found).take(form.children()) {
            *child = found.map_node(MosaicNode::Several);
        }
        Ok(())
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        self.draw_at(self.header.depth(), bounds, values, valid).map(|()| true)
    }

    fn cells(&self, node: &MosaicNode, levels: u8) -> Result<Option<CellBlock>> {
        match node {
            MosaicNode::File(number, node) => self.file(*number)?.cells(node, levels),
            MosaicNode::Several(code) if code.level() >= self.block_level() => {
                let drawn = self.draw_cells(code.bounds(self.header.depth()))?;
                Ok(Some(CellBlock { present: drawn.valid, values: drawn.values }))
            }
            MosaicNode::Several(_) => Ok(None),
        }
    }

    fn check_unchanged(&self) -> Result<()> {
        Mosaic::check_unchanged(self)
    }

    fn tally(&self, node: &MosaicNode) -> Result<Option<ZoneStats>> {
        match node {
            MosaicNode::Several(code) => self.exact_tally(*code),
            MosaicNode::File(number, node) => {
                let own = node.code.bounds(self.entry(*number).depth);
                tally_of(&*self.file(*number)?, &own, self.header.counts_classes()).map(Some)
            }
        }
    }
}
