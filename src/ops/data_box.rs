//! Where a tree's data are: the smallest box around all that is not VOID.

use crate::Result;
use crate::space::{Bounds, Code, Dimension};
use crate::tree::{Child, Source};

/// The smallest box of cells around all that is not VOID; `None` if all is. Goes only into nodes that may enlarge what was
/// found, so it reads little more than the border.
///
/// # Errors
/// If the source fails.
pub fn data_box<S: Source>(source: &S) -> Result<Option<Bounds>> {
    let mut found: Option<Bounds> = None;
    let mut pending = vec![(Code::<S::Dim>::ROOT, source.root()?)];
    while let Some((code, place)) = pending.pop() {
        let size = source.depth() - code.level();
        let cell = code.cell().map(u64::from);
        let first = |axis: usize| if axis < S::Dim::AXES { cell[axis] << size } else { 0 };
        let end = |axis: usize| if axis < S::Dim::AXES { (cell[axis] + 1) << size } else { 1 };
        let node = Bounds { min: std::array::from_fn(first), max: std::array::from_fn(end) };
        if matches!(place, Child::Void) || found.is_some_and(|found| found.contains(&node)) {
            continue;
        }
        match place {
            Child::Inner { node, .. } if size > 0 => {
                let children = source.children(&node)?.into_iter().enumerate();
                pending.extend(children.map(|(step, child)| (code.child(step), child)));
            }
            _ => {
                found = Some(found.map_or(node, |found| Bounds {
                    min: std::array::from_fn(|axis| found.min[axis].min(node.min[axis])),
                    max: std::array::from_fn(|axis| found.max[axis].max(node.max[axis])),
                }));
            }
        }
    }
    Ok(found)
}
