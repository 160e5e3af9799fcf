//! Bounding box of a tree's data: the smallest box around all that is not VOID.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::affine::{View, ViewNode};
use crate::Result;
use crate::space::{Bounds, Code};
use crate::tree::{Child, Source, no_children};

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

/// A node, and how far its cells within the picture can reach in the direction that is looked in.
struct Candidate {
    reach: u64,
    code: Code,
    child: Child<ViewNode>,
}

impl Candidate {
    /// What comes first: the furthest, and of those the smallest.
    fn rank(&self) -> (u64, u8) {
        (self.reach, self.code.level())
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Candidate) -> bool {
        self.rank() == other.rank()
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Candidate) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Candidate) -> Ordering {
        self.rank().cmp(&other.rank())
    }
}

/// The least or the greatest bound, along an axis, of all cells that are not VOID.
fn furthest(view: &View, axis: usize, is_max: bool) -> Result<Option<u64>> {
    let picture = Bounds::picture(view.extent());
    let candidate = |code: Code, child| {
        let bounds = code.bounds(view.depth()).intersect(&picture);
        let is_there = !bounds.is_empty() && !matches!(child, Child::Void);
        let reach = if is_max { bounds.max[axis] } else { u64::MAX - bounds.min[axis] };
        is_there.then_some(Candidate { reach, code, child })
    };
    let mut pending: BinaryHeap<Candidate> =
        candidate(Code::root(view.form().dimension), view.root()?).into_iter().collect();
    let mut children = no_children();
    while let Some(Candidate { reach, code, child }) = pending.pop() {
        match child {
            Child::Inner { node, .. } if code.level() < view.depth() => {
                view.children(&node, &mut children)?;
                let below = children[..view.form().children()].iter_mut().map(std::mem::take).enumerate();
                pending.extend(below.filter_map(|(step, child)| candidate(code.child(step), child)));
            }
            _ => return Ok(Some(if is_max { reach } else { u64::MAX - reach })),
        }
    }
    Ok(None)
}
