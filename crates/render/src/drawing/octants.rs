//! Drawings of octrees: flat-shaded blocks with their edges, from back to front.

use std::collections::HashSet;

use glam::DVec3;

use super::Viewer;
use super::marks::Marks;
use crate::RenderRequest;
use crate::camera::Camera;
use crate::cells::{BOX_LEVEL, FilledCells, cell_size};
use crate::paint::Paint;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::Rule;
use spinney_base::{Error, Progress, Result};
use spinney_brep::{ExactModel, Faces as _, ModelNode, ModelNodeState};
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_engine::tree::Child;
use spinney_style::to_srgb;

/// Maximum number of blocks of a drawing.
const MAX_BLOCKS: usize = 1 << 18;

/// Minimum number of blocks along a solid's longest side at the default level.
const ALONG: f64 = 32.0;

/// Tolerance for rounding errors of a cell's coverage. It exceeds 2^20 rounding errors of 2^-52,
/// and is smaller than the share of one grid unit, 2^-26.
const ROUNDING: f64 = 1e-9;

/// Minimum occupancy (0 to 255) of blocks that are drawn at the deepest level.
const HALF: f64 = 127.5;

/// Brightness of sides that face away from the light.
const SHADE: f64 = 0.55;

/// Node that is drawn.
struct Block {
    level: u8,
    position: [u32; 3],
    /// Linear red, green and blue.
    colour: DVec3,
}

/// Blocks of an octree, collected from back to front.
struct Blocks<'a> {
    /// Map from root coordinates (the root is the unit cube) to the world.
    frame: Frame,
    viewer: Viewer,
    /// Deepest level that is drawn.
    level: u8,
    list: Vec<Block>,
    /// File name for errors.
    name: &'a std::path::Path,
    progress: &'a dyn Progress,
}

/// Draws the octree of an exact model.
pub(super) fn of_model(
    model: &ExactModel,
    [low, high]: [DVec3; 2],
    level: Option<u8>,
    camera: &Camera,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<u8> {
    let (grid, depth) = (model.grid(), model.grid().depth());
    let frame = grid.frame(None);
    let level = level_of(level, depth, &frame, (high - low).max_element())?;
    let mut blocks = Blocks::new(frame.coarser(depth), camera, level, model.path(), progress)?;
    let colour = DVec3::from(Paint::clay().colour(&[0.0; 4]));
    blocks.walk_model(model, &model.root()?, colour)?;
    blocks.draw(camera, marks);
    Ok(level)
}

/// Draws an octree of cells.
pub(super) fn of_cells(
    tree: &Dataset,
    request: &RenderRequest,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<u8> {
    let (depth, own) = (tree.depth(), &tree.metadata().frame);
    let rough = tree.solid(request.level.unwrap_or(depth).min(BOX_LEVEL).min(depth), progress)?;
    let space = Bounds { min: [0; 3], max: [1 << rough.level; 3] };
    let bounds = rough.bounds.unwrap_or(space);
    let camera = request.camera(&FilledCells::new(tree, rough.frame(), &bounds))?;
    let cells = bounds.size().into_iter().max().unwrap_or(1) as f64;
    let longest = cells * cell_size(&own.coarser(depth - rough.level));
    let level = level_of(request.level, depth, own, longest)?;
    let mut blocks = Blocks::new(own.coarser(depth), &camera, level, tree.name(), progress)?;
    let paint = Paint::of(tree)?;
    blocks.walk_cells(tree, &paint, Code::root(Dimension::Oct))?;
    blocks.draw(&camera, marks);
    Ok(level)
}

/// Level to draw; `frame` is that of the deepest cells, `longest` the solid's longest side in the
/// world.
fn level_of(requested: Option<u8>, depth: u8, frame: &Frame, longest: f64) -> Result<u8> {
    match requested {
        Some(level) if level <= depth => Ok(level),
        Some(level) => Err(Error::invalid("level", level.to_string(), format!("0 to {depth}"))),
        None => {
            let is_fine = |level: &u8| cell_size(&frame.coarser(depth - level)) * ALONG <= longest;
            Ok((0..=depth).find(is_fine).unwrap_or(depth))
        }
    }
}

impl<'a> Blocks<'a> {
    fn new(
        frame: Frame,
        camera: &Camera,
        level: u8,
        name: &'a std::path::Path,
        progress: &'a dyn Progress,
    ) -> Result<Blocks<'a>> {
        let no_inverse =
            || Error::invalid("the file's transform", "a map that is not invertible", "an invertible one");
        let in_cells = |point: DVec3| -> Result<DVec3> {
            Ok(frame.to_cells(point.to_array()).ok_or_else(no_inverse)?.into())
        };
        let viewer = match Viewer::of(camera) {
            Viewer::At(eye) => Viewer::At(in_cells(eye)?),
            Viewer::AtInfinity(direction) => {
                in_cells(DVec3::ZERO)?;
                Viewer::AtInfinity(frame.linear().inverse() * direction)
            }
        };
        Ok(Blocks { frame, viewer, level, list: Vec::new(), name, progress })
    }

    /// End of an interval along an axis that faces the viewer, in root coordinates: 0 is low, 1 is
    /// high. `None` if the viewer is between the ends.
    fn near_end(&self, axis: usize, [low, high]: [f64; 2]) -> Option<usize> {
        let (is_above, is_below) = match self.viewer {
            Viewer::At(eye) => (eye[axis] > high, eye[axis] < low),
            Viewer::AtInfinity(direction) => (direction[axis] > 0.0, direction[axis] < 0.0),
        };
        is_above.then_some(1).or(is_below.then_some(0))
    }

    /// Children of a node, farthest from the viewer first.
    fn back_to_front(&self, level: u8, position: [u32; 3]) -> impl Iterator<Item = usize> + use<> {
        let middle = |axis: usize| (f64::from(position[axis]) + 0.5) / 2f64.powi(level.into());
        let near: usize = (0..3)
            .filter(|axis| self.near_end(*axis, [middle(*axis); 2]) == Some(1))
            .map(|axis| 1 << axis)
            .sum();
        // Each bit of the index is 1 on the viewer's side. If a child hides another, it has all
        // index bits of the other and more, hence a higher index.
        (0..8).map(move |child| child ^ near ^ 7)
    }

    fn add(&mut self, level: u8, position: [u32; 3], colour: DVec3) -> Result<()> {
        if self.list.len() == MAX_BLOCKS {
            let found = format!("a drawing of more than {MAX_BLOCKS} blocks");
            return Err(Error::unsupported(
                self.name,
                found,
                "request a coarser --level, or a shaded image without --drawing",
            ));
        }
        if self.list.len().is_multiple_of(1 << 10) {
            self.progress.check()?;
        }
        self.list.push(Block { level, position, colour });
        Ok(())
    }

    fn walk_cells(&mut self, tree: &Dataset, paint: &Paint, code: Code) -> Result<()> {
        let (level, value) = (code.level(), tree.header().form.value);
        let node = tree.node(code)?;
        let shown = match node {
            Child::Void => None,
            Child::Leaf(shown) => Some(shown),
            Child::Inner { representative, .. } if level == self.level => Some(representative),
            Child::Inner { .. } => {
                for child in self.back_to_front(level, code.cell()) {
                    self.walk_cells(tree, paint, code.child(child))?;
                }
                None
            }
        };
        match shown.map(|shown| value.samples(shown).padded()) {
            Some(samples) if tree.header().rule != Rule::Occupancy || samples[0] > HALF => {
                self.add(level, code.cell(), paint.colour(&samples).into())
            }
            _ => Ok(()),
        }
    }

    fn walk_model(&mut self, model: &ExactModel, node: &ModelNode<'_>, colour: DVec3) -> Result<()> {
        let (level, position) = (node.level(), node.position());
        match node.state() {
            ModelNodeState::Void => Ok(()),
            ModelNodeState::Full => self.add(level, position, colour),
            ModelNodeState::Inner if level < self.level => {
                for child in self.back_to_front(level, position) {
                    self.walk_model(model, &model.child(node, child)?, colour)?;
                }
                Ok(())
            }
            _ => self.divide(model, level, position, colour),
        }
    }

    /// Collects the interior blocks of a cell that faces may cross.
    fn divide(&mut self, model: &ExactModel, level: u8, position: [u32; 3], colour: DVec3) -> Result<()> {
        let share = model.cell_coverage(level, position, self.progress)?.share;
        // Cell walls are half a grid unit below the grid points of faces. Along three axes, this
        // adds or removes up to 1.5 grid units of coverage.
        let rest = 1.5 / f64::from(1u32 << (model.grid().bits - level)) + ROUNDING;
        let is_full = share >= 1.0 - rest;
        if share >= 0.5 && (is_full || level == self.level) {
            return self.add(level, position, colour);
        }
        if level == self.level || share <= rest {
            return Ok(());
        }
        for child in self.back_to_front(level, position) {
            let position = [0, 1, 2].map(|axis| 2 * position[axis] + (child as u32 >> axis & 1));
            self.divide(model, level + 1, position, colour)?;
        }
        Ok(())
    }

    /// Draws the sides of blocks that face the viewer and are not covered by an adjacent block.
    fn draw(&self, camera: &Camera, marks: &mut Marks) {
        let known: HashSet<(u8, [u32; 3])> =
            self.list.iter().map(|block| (block.level, block.position)).collect();
        let is_covered = |level: u8, position: [u32; 3]| {
            (0..=level).any(|up| known.contains(&(level - up, position.map(|at| at >> up))))
        };
        let (light, areas) = (camera.light(), self.frame.face_areas());
        let mirror = self.frame.linear().determinant().signum();
        for Block { level, position, colour } in &self.list {
            let scale = 2f64.powi((*level).into());
            let end = |axis: usize, end: usize| f64::from(position[axis] + end as u32) / scale;
            for axis in 0..3 {
                let Some(near) = self.near_end(axis, [end(axis, 0), end(axis, 1)]) else { continue };
                let (mut neighbour, most) = (*position, (1u64 << level) as u32);
                neighbour[axis] =
                    if near == 1 { neighbour[axis] + 1 } else { neighbour[axis].wrapping_sub(1) };
                if neighbour[axis] < most && is_covered(*level, neighbour) {
                    continue;
                }
                let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
                let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|ends: [usize; 2]| {
                    let mut corner = [0.0; 3];
                    corner[axis] = end(axis, near);
                    corner[u] = end(u, ends[0]);
                    corner[v] = end(v, ends[1]);
                    camera.project(self.frame.to_world(corner).into())
                });
                let outwards = areas[axis].normalize_or_zero() * mirror * if near == 1 { 1.0 } else { -1.0 };
                let lit = SHADE + (1.0 - SHADE) * outwards.dot(light).max(0.0);
                marks.fill((*colour * lit).to_array().map(to_srgb), corners);
                marks.lines((0..4).map(|i| [corners[i], corners[(i + 1) % 4]]));
            }
        }
    }
}
