//! Bounds of a solid in the world, if axes of cells are not axes of the world.

use super::occupancy::Filling;
use crate::tree::{Child, Source, no_children};
use spinney_base::{Progress, Result};
use spinney_crs::Frame;

/// Returns minimum and maximum world coordinates of all corners of the cells of a level that are
/// not empty; `None` if there are none. `frame` is that of the level's cells.
///
/// Nodes are visited only if they reach beyond what was found before, the farthest first. The time
/// is proportional to the nodes near the six extremes.
pub(super) fn world_bounds<S: Source>(
    source: &S,
    level: u8,
    filling: Filling,
    frame: &Frame,
    progress: &dyn Progress,
) -> Result<Option<[[f64; 3]; 2]>> {
    let root = source.root()?;
    let mut bounds = [[0.0; 3]; 2];
    for (corner, sign) in bounds.iter_mut().zip([-1.0, 1.0]) {
        for (bound, row) in corner.iter_mut().zip(&frame.matrix) {
            let direction = row.map(|number| number * sign);
            let mut search = Search { source, filling, direction, farthest: None, progress };
            search.node(&root, [0; 3], level)?;
            let Some(farthest) = search.farthest else { return Ok(None) };
            *bound = farthest * sign;
        }
    }
    Ok(Some(bounds))
}

/// Search for the point that is farthest in a direction.
struct Search<'a, S: Source> {
    source: &'a S,
    filling: Filling,
    /// Row of the map from cells to the world, or its opposite.
    direction: [f64; 4],
    farthest: Option<f64>,
    progress: &'a dyn Progress,
}

impl<S: Source> Search<'_, S> {
    /// Coordinate of the farthest corner of a node.
    fn reach(&self, min: [u64; 3], height: u8) -> f64 {
        let [x, y, z, start] = self.direction;
        let corner = |axis: usize, factor: f64| {
            let end = if factor > 0.0 { 1 << height } else { 0 };
            factor * (min[axis] + end) as f64
        };
        // (In the order of `Frame::to_world`, so that results are equal to it.)
        corner(0, x) + corner(1, y) + corner(2, z) + start
    }

    fn is_farther(&self, reach: f64) -> bool {
        self.farthest.is_none_or(|farthest| reach > farthest)
    }

    fn node(&mut self, node: &Child<S::Node>, min: [u64; 3], height: u8) -> Result<()> {
        let reach = self.reach(min, height);
        if !self.is_farther(reach) {
            return Ok(());
        }
        let inner = match node {
            Child::Inner { node, .. } if height > 0 => node,
            _ => {
                if self.filling.fill(node.value()) > 0 {
                    self.farthest = Some(reach);
                }
                return Ok(());
            }
        };
        self.progress.check()?;
        let mut children = no_children();
        self.source.children(inner, &mut children)?;
        let below = height - 1;
        // The farthest child first: along each axis, the one at the end of the direction.
        let first = (0..3).map(|axis| usize::from(self.direction[axis] > 0.0) << axis).sum::<usize>();
        let mut order: [(f64, usize); 8] = std::array::from_fn(|index| {
            let step = first ^ index;
            (self.reach(child_at(min, below, step), below), step)
        });
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, step) in order {
            self.node(&children[step], child_at(min, below, step), below)?;
        }
        Ok(())
    }
}

/// First cell of a child of `2^below` cells along each axis.
fn child_at(min: [u64; 3], below: u8, step: usize) -> [u64; 3] {
    std::array::from_fn(|axis| min[axis] + ((step as u64 >> axis & 1) << below))
}
