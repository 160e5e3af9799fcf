//! Coverage of a model's cells, of any level.

use super::coverage::{Coverage, CoverageSums, Cube};
use super::line::Line;
use super::visited::Visited;
use crate::exact::bounds::CELL_ROUNDING;
use crate::{ExactModel, FaceBuffer, Faces, Grid, ModelNode, ModelNodeState};
use spinney_base::{Error, Progress, Result};

/// The fraction of a cell that is inside of a body, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellCoverage {
    /// Share of the cell that is inside, 0 to 1.
    pub share: f64,
    /// Volume inside.
    pub volume: f64,
    /// Centre of gravity of the volume inside; `None` if there is none.
    pub centre: Option<[f64; 3]>,
    /// Nodes and faces visited.
    pub visited: Visited,
}

impl ExactModel {
    /// Returns the part of a cell that is inside of the body: exact except for rounding, see
    /// [`Coverage`]. Cells may be smaller than the leaves that contain them, down to single grid
    /// points.
    ///
    /// The result of an inner node is the sum over the cells below it; time is proportional to
    /// their number.
    ///
    /// # Errors
    /// If there is no such cell, the file is corrupt or cannot be read, or on cancellation.
    pub fn cell_coverage(
        &self,
        level: u8,
        position: [u32; 3],
        progress: &dyn Progress,
    ) -> Result<CellCoverage> {
        let grid = self.grid();
        if level > grid.bits || position.iter().any(|at| u64::from(*at) >> level != 0) {
            let found = format!("{position:?} of level {level}");
            let expected = format!("levels of 0 to {}, and coordinates below 2^level", grid.bits);
            return Err(Error::invalid("cell", found, expected));
        }
        let width = 1u32 << (grid.bits - level);
        let cube = Cube { min: position.map(|at| (at * width) as i32), side: width };
        let mut traversal = CoverageTraversal {
            model: self,
            buffer: FaceBuffer::default(),
            visited: Visited::default(),
            progress,
        };
        let mut node = self.root()?;
        while node.level() < level && node.state() == ModelNodeState::Inner {
            traversal.visited.nodes += 1;
            let shift = level - 1 - node.level();
            let child = (0..3).map(|axis| ((position[axis] >> shift & 1) as usize) << axis).sum();
            node = self.child(&node, child)?;
        }
        let coverage = if node.level() < level {
            traversal.part(&node, &cube)?
        } else {
            traversal.node(&node, &cube)?
        };
        Ok(coverage.in_world(&cube, grid, traversal.visited))
    }
}

/// Returns the cube of a node.
fn cube_of(node: &ModelNode<'_>, grid: &Grid) -> Cube {
    let side = 1u32 << (grid.bits - node.level());
    Cube { min: node.position().map(|at| (at * side) as i32), side }
}

struct CoverageTraversal<'a> {
    model: &'a ExactModel,
    buffer: FaceBuffer,
    visited: Visited,
    progress: &'a dyn Progress,
}

impl CoverageTraversal<'_> {
    /// Returns the coverage of a node.
    fn node(&mut self, node: &ModelNode<'_>, cube: &Cube) -> Result<Coverage> {
        if node.state() != ModelNodeState::Inner {
            return self.part(node, cube);
        }
        self.visited.nodes += 1;
        let mut sum = Coverage::default();
        for child in 0..8 {
            let child = self.model.child(node, child)?;
            let part = cube_of(&child, self.model.grid());
            let coverage = self.node(&child, &part)?;
            sum.add_part(cube, &part, &coverage);
        }
        Ok(sum)
    }

    /// Returns the coverage of a cell within a node without children.
    fn part(&mut self, node: &ModelNode<'_>, cube: &Cube) -> Result<Coverage> {
        self.visited.nodes += 1;
        if self.visited.nodes.is_multiple_of(256) {
            self.progress.check()?;
        }
        match node.state() {
            ModelNodeState::Full => Ok(Coverage::full(cube)),
            ModelNodeState::Leaf { inside, .. } => {
                let mut sums = CoverageSums::new(*cube);
                for number in node.faces() {
                    self.visited.faces += 1;
                    self.model.face(number, &mut self.buffer)?;
                    sums.add_face(&self.buffer.face());
                }
                let grid = self.model.grid();
                let corner = cube_of(node, grid).min;
                let inside = match Line::between_corners(grid, corner, cube.min) {
                    Some(line) => line.leads_inside(self.model, node, inside, &mut self.buffer)?,
                    None => inside,
                };
                Ok(sums.coverage(inside))
            }
            ModelNodeState::Void | ModelNodeState::Inner => Ok(Coverage::default()),
        }
    }
}

impl Coverage {
    /// Adds the coverage of a child cell.
    fn add_part(&mut self, cube: &Cube, part: &Cube, coverage: &Coverage) {
        self.volume += coverage.volume;
        for axis in 0..3 {
            let shift = f64::from(part.min[axis] - cube.min[axis]);
            self.moments[axis] += coverage.moments[axis] + shift * coverage.volume;
        }
    }

    fn in_world(&self, cube: &Cube, grid: &Grid, visited: Visited) -> CellCoverage {
        let full = f64::from(cube.side).powi(3);
        let share = (self.volume / full).clamp(0.0, 1.0);
        let centre = [0, 1, 2].map(|axis| {
            let within = (self.moments[axis] / self.volume).clamp(0.0, f64::from(cube.side));
            f64::from(cube.min[axis]) - 0.5 + within
        });
        // A centre of mere rounding errors is meaningless.
        let is_something = share > CELL_ROUNDING && centre.iter().all(|at| at.is_finite());
        CellCoverage {
            share,
            volume: share * full * grid.width().powi(3),
            centre: is_something.then(|| grid.to_world_between(centre)),
            visited,
        }
    }
}
