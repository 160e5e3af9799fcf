//! Gathers the nodes of one block from a source: node by node, but for subtrees that a file has stored and
//! small blocks of cells that the source can draw.

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

/// An INNER node whose children are still to be gathered.
enum Open<N> {
    /// A node of the source.
    Node(N),
    /// Cells that were drawn: the number of their block, and the first of the node's.
    Cells(u32, u32),
}

/// Records taken over and cells drawn so far, to which nodes of the levels refer by number.
struct Gathered {
    reused: ReusedRecords,
    drawn: Vec<DrawnCells>,
}

impl Block {
    /// The block under `code`, whose root is the source's inner node `node`. Where `stored` allows it for a
    /// node of a file at so many levels above the cells, its records are taken over.
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
        // Breadth first, since a block is made of levels in Z order: children are visited in the order of
        // their parents, so that each level comes out sorted.
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

/// A node of the source, or its cells where these are few and the source can draw them.
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

/// The cells of a small block in Z order.
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

/// The children of a node of drawn cells, whose first cell is `start`: uniform ones become leaves of the
/// level, the first at index `first`, all others are opened, by what `open` makes of their first cells.
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
        // Most children are single cells, which are uniform whatever they are.
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

/// The value that all these cells have (`None` is VOID), if they are alike.
fn uniform(cells: &DrawnCells, range: Range<usize>, width: usize) -> Option<Option<Value>> {
    let present = &cells.present[range.clone()];
    let values = &cells.values[range.start * width..range.end * width];
    let is_there = present[0];
    // Without a way out in the middle, so that many are compared at a time.
    let alike = present.iter().fold(true, |alike, other| alike & (*other == is_there));
    // Cells that are alike are the same when moved by one.
    let same = alike && (!is_there || values[width..] == values[..values.len() - width]);
    same.then(|| is_there.then(|| Value::from_bytes(&values[..width])))
}
