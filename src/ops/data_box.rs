//! Bounding box of a tree's data: the smallest box around all that is not VOID.

use super::affine::View;
use crate::Result;
use crate::space::{Bounds, Code};
use crate::tree::{Child, Source, no_children};

/// The smallest box of cells around all that is not VOID; `None` if all is. Goes only into nodes that may
/// enlarge what was found, so it reads little more than the border.
///
/// # Errors
/// If the file is damaged.
pub fn data_box(view: &View) -> Result<Option<Bounds>> {
    let form = view.form();
    let mut found: Option<Bounds> = None;
    let mut children = no_children();
    let mut pending = vec![(Code::root(form.dimension), view.root()?)];
    while let Some((code, child)) = pending.pop() {
        let bounds = code.bounds(view.depth());
        if matches!(child, Child::Void) || found.is_some_and(|found| found.contains(&bounds)) {
            continue;
        }
        match child {
            Child::Inner { node, .. } if code.level() < view.depth() => {
                view.children(&node, &mut children)?;
                let below = children[..form.children()].iter_mut().map(std::mem::take).enumerate();
                pending.extend(below.map(|(step, child)| (code.child(step), child)));
            }
            _ => {
                found = Some(found.map_or(bounds, |found| Bounds {
                    min: std::array::from_fn(|axis| found.min[axis].min(bounds.min[axis])),
                    max: std::array::from_fn(|axis| found.max[axis].max(bounds.max[axis])),
                }));
            }
        }
    }
    Ok(found)
}
