//! Uniformity test for boxes of a file, without reading cells.

use crate::ops::view_source::{ViewSource, ViewSourceNode};
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Value;

/// Value of all cells of a box (`None` is VOID); `None` if they differ. Cells beyond the tree are
/// VOID.
///
/// Reads the nodes along the box's edges, those first that overlap it most, until two values
/// differ.
///
/// # Errors
/// If the file is corrupt there.
pub(super) fn uniform(file: &ViewSource, bounds: &Bounds) -> Result<Option<Option<Value>>> {
    let space = Bounds::space(file.form().dimension, file.depth());
    let inside = bounds.intersect(&space);
    // Value of the box so far.
    let mut found = (!space.contains(bounds)).then_some(None);
    if !inside.is_empty() && !is_alike(file, &file.root()?, space, &inside, &mut found)? {
        return Ok(None);
    }
    Ok(found)
}

/// Whether the intersection of a node with a box is uniform, with the same value as found before.
fn is_alike(
    file: &ViewSource,
    child: &Child<ViewSourceNode>,
    node: Bounds,
    bounds: &Bounds,
    found: &mut Option<Option<Value>>,
) -> Result<bool> {
    let value = match child {
        Child::Void => None,
        Child::Leaf(value) => Some(*value),
        Child::Inner { node: inner, .. } => {
            if bounds.contains(&node) {
                return Ok(false);
            }
            let mut children = no_children();
            file.children(inner, &mut children)?;
            let dimension = file.form().dimension;
            // (If the box covers much of a node, one of its descendants is soon fully inside, and
            // decides without its cells.)
            let mut order: [usize; 4] = [0, 1, 2, 3];
            let inside = |step: &usize| node.child(dimension, *step).intersect(bounds).volume();
            order.sort_by_key(|step| std::cmp::Reverse(inside(step)));
            for step in order.into_iter().filter(|step| inside(step) > 0) {
                if !is_alike(file, &children[step], node.child(dimension, step), bounds, found)? {
                    return Ok(false);
                }
            }
            return Ok(true);
        }
    };
    Ok(*found.get_or_insert(value) == value)
}
