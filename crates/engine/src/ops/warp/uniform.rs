//! Boxes of a file that are alike all over, without looking at their cells.

use crate::ops::view_source::{ViewSource, ViewSourceNode};
use crate::tree::{Child, Source, no_children};
use spinney_base::Result;
use spinney_base::space::Bounds;
use spinney_base::value::Value;

/// The value that all cells of a box have (`None` is VOID); `None` if they are not alike. Cells beyond the tree are VOID.
///
/// Reads the nodes along the box's edges, those first of which most lies in it, until two are found that differ.
///
/// # Errors
/// If the file is damaged there.
pub(super) fn uniform(file: &ViewSource, bounds: &Bounds) -> Result<Option<Option<Value>>> {
    let space = Bounds::space(file.form().dimension, file.depth());
    let inside = bounds.intersect(&space);
    // What the box has so far.
    let mut found = (!space.contains(bounds)).then_some(None);
    if !inside.is_empty() && !is_alike(file, &file.root()?, space, &inside, &mut found)? {
        return Ok(None);
    }
    Ok(found)
}

/// Whether the part of a node that lies in a box is alike, and as what was found before.
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
            // (Where much of a node lies in the box, some of it is soon all inside, and tells without its cells.)
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
