//! Rays and lines through a model: cells from front to back.

use super::line::{Crossing, Line};
use super::visited::{Recent, Visited, half_of};
use crate::{ExactModel, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::{Result, sort};

/// A place where a line passes through the surface of a model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Share of the line that lies before it; of a ray, in lengths of its direction.
    pub share: f64,
    /// The place in the world.
    pub point: [f64; 3],
    /// Whether the line comes from outside.
    pub is_entry: bool,
    /// Number of the face.
    pub face: u64,
}

impl ExactModel {
    /// The first place where a ray in the world meets the surface.
    ///
    /// That it does is decided for all faces together, so that no ray slips through between two of them, for the ray as
    /// [`Line`] rounds it: on a grid of the most bits by less than 1 / 16384 of a step.
    ///
    /// # Errors
    /// If the file is damaged or cannot be read.
    pub fn ray(&self, from: [f64; 3], direction: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        let steps = direction.map(|along| along * grid.divisor / grid.step);
        self.first_hit(Line::ray(grid, grid.to_grid(from), steps))
    }

    /// The first place where the straight way between two points of the world meets the surface, as
    /// [`ExactModel::ray`]: whether one sees the other.
    ///
    /// # Errors
    /// Those of [`ExactModel::ray`].
    pub fn between(&self, from: [f64; 3], to: [f64; 3]) -> Result<(Option<Hit>, Visited)> {
        let grid = self.grid();
        self.first_hit(Line::between(grid, grid.to_grid(from), grid.to_grid(to)))
    }

    /// All places where the straight way between two points of the world passes through the surface, in their order.
    ///
    /// # Errors
    /// Those of [`ExactModel::ray`].
    pub fn crossings(&self, from: [f64; 3], to: [f64; 3]) -> Result<Vec<Hit>> {
        let grid = self.grid();
        let Some(line) = Line::between(grid, grid.to_grid(from), grid.to_grid(to)) else {
            return Ok(Vec::new());
        };
        let mut walk = Walk::new(self, line, false);
        walk.root()?;
        let mut all = walk.found;
        sort::by_key(&mut all, |(number, _)| *number);
        all.dedup_by_key(|(number, _)| *number);
        // Of those at one place one comes out before another is entered.
        sort::by_wide_key(&mut all, |(_, passed)| {
            u128::from(sort::float_key(passed.share)) << 1 | u128::from(passed.is_entry)
        });
        Ok(all.into_iter().map(|(number, crossing)| self.hit(&line, number, crossing)).collect())
    }

    fn first_hit(&self, line: Option<Line>) -> Result<(Option<Hit>, Visited)> {
        let Some(line) = line else { return Ok((None, Visited::default())) };
        let mut walk = Walk::new(self, line, true);
        walk.root()?;
        let hit = walk.found.first().map(|(number, crossing)| self.hit(&line, *number, *crossing));
        Ok((hit, walk.visited))
    }

    fn hit(&self, line: &Line, face: u64, Crossing { share, is_entry }: Crossing) -> Hit {
        Hit { share, point: self.grid().to_world_between(line.at(share)), is_entry, face }
    }
}

/// A way along a line.
struct Walk<'a> {
    model: &'a ExactModel,
    line: Line,
    /// Whether only the first crossing is wanted.
    is_first: bool,
    /// Crossings by the numbers of their faces; one, or all, some of them more than once.
    found: Vec<(u64, Crossing)>,
    recent: Recent,
    buffer: FaceBuffer,
    visited: Visited,
}

impl Walk<'_> {
    fn new(model: &ExactModel, line: Line, is_first: bool) -> Walk<'_> {
        let (recent, buffer) = (Recent::new(), FaceBuffer::default());
        Walk { model, line, is_first, found: Vec::new(), recent, buffer, visited: Visited::default() }
    }

    fn root(&mut self) -> Result<()> {
        let root = self.model.root()?;
        if self.is_wanted(root.bounds(self.model.grid())) { self.node(&root) } else { Ok(()) }
    }

    /// Goes through a node, from front to back.
    fn node(&mut self, node: &ModelNode<'_>) -> Result<()> {
        self.visited.nodes += 1;
        if node.state() != ModelNodeState::Inner {
            return self.leaf(node);
        }
        let bounds = node.bounds(self.model.grid());
        // Along each axis that half first in which the line begins.
        let turned = self.line.turned();
        for child in (0..8).map(|child| child ^ turned) {
            // (Before the child is looked up, which takes longer.)
            if self.is_wanted(half_of(&bounds, child)) {
                self.node(&self.model.child(node, child)?)?;
            }
        }
        Ok(())
    }

    /// Whether the line passes through a cell before what was found.
    fn is_wanted(&self, bounds: [[i64; 3]; 2]) -> bool {
        let [min, max] = bounds.map(|corner| corner.map(|at| at as f64 / 2.0));
        let Some([first, _]) = self.line.within(min, max) else { return false };
        !(self.is_first && self.found.first().is_some_and(|(_, found)| found.share < first))
    }

    fn leaf(&mut self, node: &ModelNode<'_>) -> Result<()> {
        for number in node.faces() {
            if self.recent.is_known(number) {
                continue;
            }
            self.visited.faces += 1;
            self.model.face(number, &mut self.buffer)?;
            let Some(crossing) = self.line.crossing(&self.buffer.face()) else { continue };
            match self.found.first_mut() {
                Some(first) if self.is_first => {
                    let is_before = crossing.share.total_cmp(&first.1.share).then(number.cmp(&first.0));
                    if is_before.is_lt() {
                        *first = (number, crossing);
                    }
                }
                _ => self.found.push((number, crossing)),
            }
        }
        Ok(())
    }
}
