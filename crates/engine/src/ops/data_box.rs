//! Bounding box of a tree's data: the smallest box around all that is not VOID.

use super::affine::View;
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::sort;
use spinney_base::space::{Bounds, Code};

/// The smallest box of cells around all that is not VOID; `None` if all is. Goes, for each side of the box, only into nodes
/// that may reach further than what was found, the furthest first.
///
/// # Errors
/// If the file is damaged.
pub fn data_box(view: &View) -> Result<Option<Bounds>> {
    let mut bounds = Bounds::picture(view.extent());
    for axis in 0..view.form().axes() {
        let Some(min) = furthest(view, axis, false)? else { return Ok(None) };
        let Some(max) = furthest(view, axis, true)? else { return Ok(None) };
        (bounds.min[axis], bounds.max[axis]) = (min, max);
    }
    Ok(Some(bounds))
}

/// The least or the greatest bound, along an axis, of all cells that are not VOID.
fn furthest(view: &View, axis: usize, is_max: bool) -> Result<Option<u64>> {
    let picture = Bounds::picture(view.extent());
    // How far the cells of a node within the picture can reach; nothing if there are none.
    let reach = |code: Code| {
        let bounds = code.bounds(view.depth()).intersect(&picture);
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
                view.children(&node, &mut children)?;
                let below = children[..view.form().children()].iter_mut().map(std::mem::take).enumerate();
                let start = pending.len();
                pending.extend(below.map(|(step, child)| (reach(code.child(step)), code.child(step), child)));
                // The last one comes first.
                sort::by_wide_key(&mut pending[start..], |(reach, ..)| {
                    reach.map_or(0, |reach| u128::from(reach) + 1)
                });
            }
            _ => found = reach_of_node,
        }
    }
    Ok(found.map(|reach| if is_max { reach } else { u64::MAX - reach }))
}
