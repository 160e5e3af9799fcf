//! Predictive quadtree construction, after C. A. Shaffer and H. Samet, "Optimal quadtree
//! construction algorithms" (1987): cells arrive row by row, and a block's first cell predicts its
//! value until another cell differs.
//!
//! If a cell differs from its leaf's value, the leaf is subdivided until the cell is the first one
//! of a leaf, which takes the cell's value. Each node subdivided on the way contains an earlier
//! cell with the old value, so it is not a leaf in the final tree either: every node that is
//! created stays, and none is merged. In addition to the tree, the algorithm keeps a list of active
//! nodes: for each column, the node visited last.

use spinney::raw::tree::CellBlock;
use spinney::tree::{Child, Children, Source};
use spinney::{Code, TreeType, Value};

/// A quadtree of cells of any kind, with all nodes in memory: the root, followed by the children of
/// each subdivided node in groups of four.
pub(crate) struct PredictiveTree<T> {
    depth: u8,
    values: Vec<T>,
    /// The first child of each node; 0 for a leaf.
    children: Vec<u32>,
    /// The parent of each group of four.
    parents: Vec<u32>,
}

/// A node that contains a cell of a column, with the levels below it and one of its rows.
#[derive(Clone, Copy)]
struct Active {
    node: u32,
    height: u8,
    row: u32,
}

impl<T: Copy + Eq> PredictiveTree<T> {
    /// Builds the tree of rows of cells, from the tree's first row on; cells beyond them are
    /// `outside`.
    pub(crate) fn of(cells: &[T], width: usize, outside: T) -> PredictiveTree<T> {
        let height = cells.len() / width;
        let depth = width.max(height).next_power_of_two().ilog2() as u8;
        let mut tree =
            PredictiveTree { depth, values: vec![cells[0]], children: vec![0], parents: Vec::new() };
        let mut active = vec![Active { node: 0, height: depth, row: 0 }; 1 << depth];
        let mut row = vec![outside; 1 << depth];
        for y in 0..1 << depth {
            match cells.get(y * width..(y + 1) * width) {
                Some(cells) => row[..width].copy_from_slice(cells),
                None => row.fill(outside),
            }
            tree.add_row(y as u32, &row, &mut active);
        }
        tree
    }

    /// Returns the number of nodes; three quarters plus one quarter of a node are leaves.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    fn add_row(&mut self, y: u32, row: &[T], active: &mut [Active]) {
        let mut x = 0;
        while x < row.len() {
            let leaf = self.leaf_at(active[x], x as u32, y);
            active[x] = leaf;
            // A leaf starts where the previous one ends, or at the cell for which it was created.
            let end = x + (1 << leaf.height);
            let same = leading(&row[x..end], self.values[leaf.node as usize]);
            x += same;
            if x < end {
                active[x] = self.predict(leaf, x as u32, y, row[x]);
            }
        }
    }

    /// Returns the leaf of a cell, starting from any node that contains a cell of its column in
    /// this or an earlier row.
    fn leaf_at(&self, mut at: Active, x: u32, y: u32) -> Active {
        while at.row >> at.height != y >> at.height {
            at =
                Active { node: self.parents[(at.node as usize - 1) / 4], height: at.height + 1, row: at.row };
        }
        while self.children[at.node as usize] != 0 {
            at = self.child_at(at, x, y);
        }
        Active { row: y, ..at }
    }

    fn child_at(&self, at: Active, x: u32, y: u32) -> Active {
        let height = at.height - 1;
        let child = (y >> height & 1) << 1 | x >> height & 1;
        Active { node: self.children[at.node as usize] + child, height, row: y }
    }

    /// Subdivides a leaf until a cell is the first one of a leaf, which takes its value.
    fn predict(&mut self, mut leaf: Active, x: u32, y: u32, value: T) -> Active {
        while (x | y) & ((1 << leaf.height) - 1) != 0 {
            let node = leaf.node as usize;
            self.children[node] = self.values.len() as u32;
            self.values.extend([self.values[node]; 4]);
            self.children.extend([0; 4]);
            self.parents.push(leaf.node);
            leaf = self.child_at(leaf, x, y);
        }
        self.values[leaf.node as usize] = value;
        leaf
    }
}

/// Counts the leading cells with a value.
fn leading<T: Copy + Eq>(cells: &[T], value: T) -> usize {
    let is_same = |chunk: &&[T]| chunk.iter().fold(true, |same, cell| same & (*cell == value));
    let same = 64 * cells.chunks_exact(64).take_while(is_same).count();
    same + cells[same..].iter().take_while(|cell| **cell == value).count()
}

/// A predicted tree as a source. Files recompute the representatives.
pub(crate) struct PredictedSource<T> {
    pub(crate) tree: PredictiveTree<T>,
    pub(crate) form: TreeType,
    /// Returns a cell's value; `None` is VOID.
    pub(crate) value: fn(T) -> Option<Value>,
}

impl<T: Copy + Eq + Sync> PredictedSource<T> {
    fn child(&self, node: usize, code: Code) -> Child<Code> {
        match (self.tree.children[node], (self.value)(self.tree.values[node])) {
            (0, value) => Child::uniform(value),
            (_, value) => Child::Inner { representative: value.unwrap_or_default(), node: code },
        }
    }

    /// Returns the first child of an inner node.
    fn first_child(&self, code: Code) -> usize {
        code.digits()
            .fold(self.tree.children[0] as usize, |first, step| self.tree.children[first + step] as usize)
    }

    /// Fills a square of a block of cells, starting at index `at`.
    fn fill(&self, block: &mut CellBlock, node: usize, at: usize, side: usize, columns: usize) {
        if let first @ 1.. = self.tree.children[node] as usize {
            let half = side / 2;
            for child in 0..4 {
                self.fill(
                    block,
                    first + child,
                    at + (child & 1) * half + (child >> 1) * half * columns,
                    half,
                    columns,
                );
            }
        } else if let Some(value) = (self.value)(self.tree.values[node]) {
            let width = self.form.width();
            for row in 0..side {
                let cells = at + row * columns..at + row * columns + side;
                block.present[cells.clone()].fill(true);
                for cell in block.values[cells.start * width..cells.end * width].chunks_exact_mut(width) {
                    cell.copy_from_slice(&value.to_bytes()[..width]);
                }
            }
        }
    }
}

impl<T: Copy + Eq + Sync> Source for PredictedSource<T> {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.tree.depth
    }

    fn root(&self) -> spinney::Result<Child<Code>> {
        Ok(self.child(0, Code::root(self.form.dimension)))
    }

    fn children(&self, code: &Code, children: &mut Children<Code>) -> spinney::Result<()> {
        let first = self.first_child(*code);
        (0..4).for_each(|step| children[step] = self.child(first + step, code.child(step)));
        Ok(())
    }

    fn cells(&self, code: &Code, levels: u8) -> spinney::Result<Option<CellBlock>> {
        let (first, side) = (self.first_child(*code), 1 << levels);
        let mut block = CellBlock::void(side * side, self.form.width());
        for child in 0..4 {
            let at = (child & 1) * side / 2 + (child >> 1) * side / 2 * side;
            self.fill(&mut block, first + child, at, side / 2, side);
        }
        Ok(Some(block))
    }
}
