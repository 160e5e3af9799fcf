//! Bounding box of a tree's cells that are not VOID.

use super::affine::View;
use crate::tree::{CellBlock, Child, Source, no_children};
use spinney_base::Result;
use spinney_base::sort;
use spinney_base::space::{Bounds, Code};

/// Bounding box of all cells that are not VOID; `None` if all are VOID. For each side of the box,
/// visits only nodes that may reach further than what was found so far, the furthest first.
///
/// # Errors
/// If the file is corrupt.
pub fn data_box(view: &View) -> Result<Option<Bounds>> {
    let mut bounds = Bounds::of_extent(view.extent());
    for axis in 0..view.form().axes() {
        let Some(min) = furthest(view, axis, false)? else { return Ok(None) };
        let Some(max) = furthest(view, axis, true)? else { return Ok(None) };
        (bounds.min[axis], bounds.max[axis]) = (min, max);
    }
    Ok(Some(bounds))
}

/// Number of levels above the cells below which all cells are read at once, since this is faster
/// than visiting nodes.
const BLOCK_LEVELS: u8 = 6;

/// Reach along an axis of the block's cells that are in the extent and not VOID; `None` if there
/// are none.
fn reach_in(block: &CellBlock, space: &Bounds, extent: &Bounds, axis: usize, is_max: bool) -> Option<u64> {
    let [width, height, _] = space.size();
    let cells = block.present.iter().enumerate().filter(|(_, present)| **present).map(|(index, _)| {
        let index = index as u64;
        let steps = [index % width, index / width % height, index / width / height];
        std::array::from_fn::<u64, 3, _>(|axis| space.min[axis] + steps[axis])
    });
    let inside = cells.filter(|cell| (0..3).all(|axis| cell[axis] < extent.max[axis]));
    inside.map(|cell| if is_max { cell[axis] + 1 } else { u64::MAX - cell[axis] }).max()
}

/// Minimum or maximum bound, along an axis, of all cells that are not VOID.
fn furthest(view: &View, axis: usize, is_max: bool) -> Result<Option<u64>> {
    let extent = Bounds::of_extent(view.extent());
    // Upper bound of the reach of a node's cells within the extent; `None` if there are none.
    let reach = |code: Code| {
        let bounds = code.bounds(view.depth()).intersect(&extent);
        let reach = if is_max { bounds.max[axis] } else { u64::MAX - bounds.min[axis] };
        (!bounds.is_empty()).then_some(reach)
    };
    let mut found = None;
    let mut children = no_children();
    let root = Code::root(view.form().dimension);
    let mut pending = vec![(reach(root), root, view.root()?)];
    while let Some((reach_of_node, code, child)) = pending.pop() {
        if matches!(child, Child::Void) || reach_of_node <= found {
            continue;
        }
        match child {
            Child::Inner { node, .. } if code.level() < view.depth() => {
                let levels = view.depth() - code.level();
                if levels <= BLOCK_LEVELS
                    && let Some(block) = view.cells(&node, levels)?
                {
                    found = found.max(reach_in(&block, &code.bounds(view.depth()), &extent, axis, is_max));
                    continue;
                }
                view.children(&node, &mut children)?;
                let below = children[..view.form().children()].iter_mut().map(std::mem::take).enumerate();
                let start = pending.len();
                pending.extend(below.map(|(step, child)| (reach(code.child(step)), code.child(step), child)));
                // The last one is popped first.
                sort::by_wide_key(&mut pending[start..], |(reach, ..)| {
                    reach.map_or(0, |reach| u128::from(reach) + 1)
                });
            }
            _ => found = reach_of_node,
        }
    }
    Ok(found.map(|reach| if is_max { reach } else { u64::MAX - reach }))
}
