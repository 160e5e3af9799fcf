//! Bintree with the fewest nodes.
//!
//! Halving produces blocks whose intervals, along each axis independently, result from repeated
//! halving: `2 n - 1` intervals for an axis of `n` cells. The minimum node count of a block follows
//! from those of its halves, along each axis in turn. Dynamic programming covers all blocks: about
//! four per cell of a raster, eight per cell of a volume.

use std::collections::HashMap;

use spinney_base::space::Code;
use spinney_base::value::Value;
use spinney_base::{Error, Result};
use spinney_engine::tree::{Child, Source, no_children};

use super::{Bintree, Halving, preorder_builder};

/// Maximum number of cells for [`Bintree::adaptive`]: a raster of 1024 x 1024, or a volume of 64 x
/// 64 x 64.
pub const MAX_CELLS: u64 = 1 << 20;

/// Flag of a block with one value throughout; the other bits are the value's index. Without the
/// flag, an entry is the block's minimum node count.
const UNIFORM: u32 = 1 << 31;

/// All blocks of a space. Intervals along an axis are numbered as in a binary heap: 1 is the entire
/// axis, `2 i` and `2 i + 1` are the halves of `i`, and `side + x` is cell `x`.
struct Blocks {
    axes: usize,
    side: usize,
    nodes: Vec<u32>,
}

type Block = [usize; 3];

impl Blocks {
    fn index(&self, [x, y, z]: Block) -> usize {
        (z * 2 * self.side + y) * 2 * self.side + x
    }

    /// Halves of a block along each axis on which it is longer than a cell.
    fn halves(&self, block: Block) -> impl Iterator<Item = (u8, [Block; 2])> {
        let (axes, side) = (self.axes, self.side);
        (0..axes).filter(move |axis| block[*axis] < side).map(move |axis| {
            let half = |which| {
                let mut half = block;
                half[axis] = 2 * block[axis] + which;
                half
            };
            (axis as u8, [half(0), half(1)])
        })
    }

    /// Minimum node count of a block.
    fn count(&self, block: Block) -> u32 {
        let found = self.nodes[self.index(block)];
        if found & UNIFORM == 0 { found } else { 1 }
    }

    /// Entry of a block computed from its halves, and the axis with the fewest nodes.
    fn best(&self, block: Block) -> (u32, u8) {
        let counted = self.halves(block).map(|(axis, [first, second])| {
            let [a, b] = [first, second].map(|half| self.nodes[self.index(half)]);
            if a == b && a & UNIFORM != 0 {
                (a, axis)
            } else {
                (1 + self.count(first) + self.count(second), axis)
            }
        });
        // If the halves along one axis have the same single value, those along every axis do. On a
        // tie, the first axis is chosen.
        counted.min_by_key(|(nodes, _)| *nodes).unwrap_or_default()
    }
}

impl Bintree {
    /// Builds the bintree with the minimum number of nodes among all that halve each block along
    /// some axis. The source has at most [`MAX_CELLS`] cells, including cells beyond `extent`.
    ///
    /// # Errors
    /// If the source fails, or has more cells.
    pub fn adaptive<S: Source>(source: &S, extent: [u64; 3]) -> Result<Bintree> {
        let (form, depth) = (source.form(), source.depth());
        let cells = form.dimension.cells(depth);
        if cells > MAX_CELLS {
            let found = format!("{} of {depth} levels", form.dimension.tree_name());
            let most = if form.axes() == 2 {
                "10 levels, 1024 x 1024 cells"
            } else {
                "6 levels, 64 x 64 x 64 cells"
            };
            return Err(Error::invalid("bintree of the fewest nodes", found, format!("at most {most}")));
        }
        let (axes, side) = (form.axes(), 1 << depth);
        let planes = if axes == 3 { 2 * side } else { 1 };
        let mut blocks = Blocks { axes, side, nodes: vec![0; planes * 4 * side * side] };
        let values = blocks.fill(source)?;
        // Descending order visits halves before the block they divide.
        for z in if axes == 3 { 1..2 * side } else { 0..1 }.rev() {
            for y in (1..2 * side).rev() {
                for x in (1..2 * side).rev() {
                    if x < side || y < side || (axes == 3 && z < side) {
                        let index = blocks.index([x, y, z]);
                        blocks.nodes[index] = blocks.best([x, y, z]).0;
                    }
                }
            }
        }
        let mut made = preorder_builder();
        let mut pending = vec![[1, 1, usize::from(axes == 3)]];
        while let Some(block) = pending.pop() {
            let found = blocks.nodes[blocks.index(block)];
            if found & UNIFORM != 0 {
                made.leaf(values[(found ^ UNIFORM) as usize]);
                continue;
            }
            let (_, best) = blocks.best(block);
            made.divide(best);
            let halves = blocks.halves(block).find(|(axis, _)| *axis == best);
            pending.extend(halves.into_iter().flat_map(|(_, [first, second])| [second, first]));
        }
        Ok(Bintree { form, depth, halving: Halving::Adaptive, extent, nodes: made.finish() })
    }
}

impl Blocks {
    /// Sets the entries of all single cells, and returns the values by index.
    fn fill<S: Source>(&mut self, source: &S) -> Result<Vec<Option<Value>>> {
        let form = source.form();
        let (mut values, mut numbers) = (Vec::new(), HashMap::new());
        let mut pending = vec![(Code::root(form.dimension), source.root()?)];
        let mut children = no_children();
        while let Some((code, child)) = pending.pop() {
            if let Child::Inner { node, .. } = child {
                source.children(&node, &mut children)?;
                let parts = children.iter_mut().take(form.children()).map(std::mem::take);
                pending.extend(parts.enumerate().map(|(step, child)| (code.child(step), child)));
                continue;
            }
            let value = child.value();
            let number = *numbers.entry(value).or_insert_with(|| {
                values.push(value);
                values.len() as u32 - 1
            });
            let cells = code.bounds(source.depth());
            let [xs, ys, zs] = [0, 1, 2].map(|axis| {
                let first = if axis < self.axes { self.side } else { 0 };
                first + cells.min[axis] as usize..first + cells.max[axis] as usize
            });
            for z in zs {
                for y in ys.clone() {
                    let row = self.index([xs.start, y, z]);
                    self.nodes[row..row + xs.len()].fill(UNIFORM | number);
                }
            }
        }
        source.check_unchanged()?;
        Ok(values)
    }
}
