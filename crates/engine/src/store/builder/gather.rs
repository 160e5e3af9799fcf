//! Gathers the nodes of one block from a source: node by node, except for stored subtrees, which
//! are copied, and for small blocks of cells that the source can draw.

use std::ops::Range;

use zerocopy::FromBytes;

use super::block::Block;
use super::level::Level;
use super::reuse::ReusableSource;
use super::reused::ReusedRecords;
use super::stored_node::StoredNode;
use crate::store::records::dense::from_z_order;
use crate::store::records::{Record, RecordLayout, with_record_type};
use crate::tree::{CellBlock, Child, no_children};
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::Value;

/// An INNER node whose children have not been gathered yet.
enum Open<N> {
    /// A node of the source.
    Node(N),
    /// Drawn cells: index of their block, and index of the node's first cell.
    Cells(u32, u32),
}

/// Copied records and drawn cells so far, which the levels' nodes refer to by index.
struct Gathered {
    reused: ReusedRecords,
    drawn: Vec<DrawnCells>,
}

impl Block {
    /// Returns the block under `code`, whose root is the source's INNER node `node`. The records of
    /// a stored node are copied if `may_reuse` allows it, given the node and its number of levels
    /// above the cells.
    pub(super) fn from_source<S: ReusableSource>(
        source: &S,
        code: Code,
        height: u8,
        (representative, node): (Value, &S::Node),
        may_reuse: &dyn Fn(&StoredNode<'_>, u8) -> bool,
    ) -> Result<Self> {
        let form = source.form();
        let fan_out = form.children();
        let mut gathered =
            Gathered { reused: ReusedRecords::new(RecordLayout::new(form), height), drawn: Vec::new() };
        let mut root = Level::root(form);
        if let Some(stored) = source.stored(node).filter(|stored| may_reuse(stored, height))
            && let Some(node) = gathered.reused.take(0, stored.subtree()?.records(), height)
        {
            root.put_reused(form, representative, node);
            root.expanded = Some(Vec::new());
            return Ok(Block::new(form, code, height, vec![root], gathered.reused));
        }
        // Breadth first, because a block consists of levels in Z order: children are visited in the
        // order of their parents, so each level is sorted.
        let mut levels = vec![root];
        let mut nodes = vec![open(source, &mut gathered.drawn, node.clone(), height)?];
        let mut children = no_children();
        for below in (0..height).rev() {
            let mut level = Level::new(form, nodes.len() * fan_out);
            let mut expanded = Vec::new();
            let mut deeper = Vec::new();
            for (group, node) in nodes.iter().enumerate() {
                let first = group * fan_out;
                let node = match node {
                    Open::Node(node) => node,
                    Open::Cells(block, start) => {
                        let cells = &gathered.drawn[*block as usize];
                        let open = |start| Open::Cells(*block, start);
                        let more = (&mut expanded, &mut deeper, open);
                        cell_children(form, cells, *start, below, first, &mut level, more);
                        continue;
                    }
                };
                source.children(node, &mut children)?;
                for (index, child) in (first..).zip(&mut children[..fan_out]) {
                    match std::mem::take(child) {
                        Child::Void => {}
                        Child::Inner { representative, node } if below > 0 => {
                            let stored = source.stored(&node).filter(|stored| may_reuse(stored, below));
                            let reused = match stored {
                                Some(stored) => {
                                    gathered.reused.take(index, stored.subtree()?.records(), below)
                                }
                                None => None,
                            };
                            if let Some(reused) = reused {
                                level.put_reused(form, representative, reused);
                            } else {
                                expanded.push(index as u32);
                                deeper.push(open(source, &mut gathered.drawn, node, below)?);
                            }
                        }
                        Child::Leaf(value) | Child::Inner { representative: value, .. } => {
                            level.put_leaf(form, index, value);
                        }
                    }
                }
            }
            nodes = deeper;
            level.expanded = Some(expanded);
            levels.push(level);
            if nodes.is_empty() {
                break;
            }
        }
        Ok(Block::new(form, code, height, levels, gathered.reused))
    }
}

/// Returns a node of the source, or its cells if they are few and the source can draw them.
fn open<S: ReusableSource>(
    source: &S,
    drawn: &mut Vec<DrawnCells>,
    node: S::Node,
    levels: u8,
) -> Result<Open<S::Node>> {
    Ok(match source.cells(&node, levels)? {
        Some(cells) => {
            drawn.push(in_z_order(source.form(), levels, &cells));
            Open::Cells(drawn.len() as u32 - 1, 0)
        }
        None => Open::Node(node),
    })
}

/// Cells of a block in Z order.
pub(super) struct DrawnCells {
    pub(super) present: Vec<bool>,
    pub(super) values: Vec<u8>,
}

/// Converts the cells of a small block to Z order.
fn in_z_order(form: TreeType, levels: u8, rows: &CellBlock) -> DrawnCells {
    let mut cells =
        DrawnCells { present: vec![false; rows.present.len()], values: vec![0; rows.values.len()] };
    with_record_type!(RecordLayout::new(form), R => {
        let values = <[<R as Record>::Bytes]>::mut_from_bytes(&mut cells.values).expect("whole values");
        let from = <[<R as Record>::Bytes]>::ref_from_bytes(&rows.values).expect("whole values");
        from_z_order::<R, _>(usize::from(levels), |z, row| {
            values[z] = from[row];
            cells.present[z] = rows.present[row];
        });
    });
    cells
}

/// Adds the children of a node of drawn cells, whose first cell is `start`, to a level. Uniform
/// children become leaves; the first child has index `first`. All others are expanded: `open` makes
/// a handle from the index of their first cell.
pub(super) fn cell_children<D>(
    form: TreeType,
    cells: &DrawnCells,
    start: u32,
    below: u8,
    first: usize,
    level: &mut Level,
    (expanded, deeper, open): (&mut Vec<u32>, &mut Vec<D>, impl Fn(u32) -> D),
) {
    if below == 0 {
        // Most children are single cells, which are always uniform.
        let width = form.width();
        for (index, cell) in (first..).zip(start as usize..).take(form.children()) {
            if cells.present[cell] {
                let value = Value::read(&cells.values[cell * width..], width).expect("a value per cell");
                level.put_leaf(form, index, value);
            }
        }
        return;
    }
    let size = form.dimension.cells(below) as usize;
    for child in 0..form.children() {
        let start = start as usize + child * size;
        match uniform(cells, start..start + size, form.width()) {
            Some(value) => {
                value.into_iter().for_each(|value| level.put_leaf(form, first + child, value));
            }
            None => {
                expanded.push((first + child) as u32);
                deeper.push(open(start as u32));
            }
        }
    }
}

/// Returns the value of all these cells (`None` is VOID), if they are equal.
fn uniform(cells: &DrawnCells, range: Range<usize>, width: usize) -> Option<Option<Value>> {
    let present = &cells.present[range.clone()];
    let values = &cells.values[range.start * width..range.end * width];
    let is_there = present[0];
    // No early exit, so that many cells are compared at a time.
    let alike = present.iter().fold(true, |alike, other| alike & (*other == is_there));
    // Cells are all equal if they equal themselves shifted by one.
    let same = alike && (!is_there || values[width..] == values[..values.len() - width]);
    same.then(|| is_there.then(|| Value::from_bytes(&values[..width])))
}
