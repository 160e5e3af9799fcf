//! Location of boxes relative to a model: inside, outside, or neither.

use super::faces_in_box::check_box;
use super::line::Line;
use super::visited::{Recent, Visited, half_of};
use crate::geometry::{Box3, GridPolygon, Triangulator, triangle};
use crate::{ExactModel, Face, FaceBuffer, Faces, ModelNode, ModelNodeState};
use spinney_base::{Error, Result};

/// Location of a box relative to a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxLocation {
    /// The box is disjoint from the solid.
    Outside,
    /// The solid contains the box.
    Inside,
    /// The surface intersects the box.
    Cut,
}

impl ExactModel {
    /// Locates an axis-aligned box of the world relative to the body: inside, outside, or cut by
    /// its surface.
    ///
    /// The box is rounded outward to a grid that is `2^(31 - bits)` times finer than the model's:
    /// to 1 / 32 of a grid unit for a grid with the maximum bits. Everything else is exact. Faces
    /// that only touch the box, or are in its walls, do not cut it.
    ///
    /// # Errors
    /// If the file is corrupt or cannot be read, or if the box is invalid.
    pub fn locate_box(&self, min: [f64; 3], max: [f64; 3]) -> Result<(BoxLocation, Visited)> {
        check_box([min, max])?;
        let grid = self.grid();
        let bits = 31 - grid.bits;
        let scale = (1u64 << bits) as f64;
        let (low, high) = (grid.to_grid(min), grid.to_grid(max));
        if !(0..3).all(|axis| (high[axis] - low[axis]).is_finite()) {
            return Err(Error::invalid("box", format!("{min:?} to {max:?}"), "finite coordinates"));
        }
        // Coordinates far outside are clamped to just outside of the root's cell.
        let (least, most) = (-1.0, (1u64 << grid.bits) as f64);
        let from = low.map(|at| (at.clamp(least, most) * scale).floor() as i64);
        let to = high.map(|at| (at.clamp(least, most) * scale).ceil() as i64);
        let to = [0, 1, 2].map(|axis| to[axis].max(from[axis] + 1));
        let half = 1i64 << (bits - 1);
        let is_beyond = |axis: usize| from[axis] < -half || to[axis] > (1 << 31) - half;
        let mut traversal = BoxTraversal {
            model: self,
            bounds: Box3 { min: from, max: to },
            bits,
            outside: (0..3).any(is_beyond),
            inside: false,
            uncut: None,
            recent: Recent::new(),
            buffer: FaceBuffer::default(),
            triangulator: Triangulator::new(),
            visited: Visited::default(),
        };
        let root = self.root()?;
        let is_met = traversal.bounds.inside_meets(&traversal.fine(&root.bounds(grid)));
        let is_cut = is_met && traversal.node(&root)?;
        let location = match (is_cut, traversal.outside) {
            (true, _) => BoxLocation::Cut,
            (false, true) => BoxLocation::Outside,
            (false, false) if traversal.inside => BoxLocation::Inside,
            // Only uncut parts of leaves remain, which all have the same state.
            (false, false) if traversal.uncut == Some(true) => BoxLocation::Inside,
            (false, false) => BoxLocation::Outside,
        };
        Ok((location, traversal.visited))
    }
}

struct BoxTraversal<'a> {
    model: &'a ExactModel,
    /// In `2^-bits` grid units.
    bounds: Box3,
    bits: u8,
    /// Whether some point of the box is known to be outside.
    outside: bool,
    /// Whether some point of the box is known to be inside.
    inside: bool,
    /// Whether the part of the box in a leaf is inside, if no face cuts it.
    uncut: Option<bool>,
    recent: Recent,
    buffer: FaceBuffer,
    triangulator: Triangulator,
    visited: Visited,
}

impl BoxTraversal<'_> {
    /// Converts a box in half grid units to the fine grid.
    fn fine(&self, bounds: &[[i64; 3]; 2]) -> Box3 {
        let [min, max] = bounds.map(|corner| corner.map(|at| at << (self.bits - 1)));
        Box3 { min, max }
    }

    /// Visits a node that the box meets; returns whether the surface is known to cut the box.
    fn node(&mut self, node: &ModelNode<'_>) -> Result<bool> {
        let bounds = node.bounds(self.model.grid());
        let cell = self.fine(&bounds);
        self.visited.nodes += 1;
        match node.state() {
            ModelNodeState::Void => self.outside = true,
            ModelNodeState::Full => self.inside = true,
            ModelNodeState::Inner => {
                for child in 0..8 {
                    // (Tested before the child is looked up, which takes longer.)
                    let is_met = self.bounds.inside_meets(&self.fine(&half_of(&bounds, child)));
                    if is_met && self.node(&self.model.child(node, child)?)? {
                        return Ok(true);
                    }
                }
            }
            ModelNodeState::Leaf { inside, .. } => {
                for number in node.faces() {
                    if self.recent.is_known(number) {
                        continue;
                    }
                    self.visited.faces += 1;
                    self.model.face(number, &mut self.buffer)?;
                    if cuts(&self.buffer.face(), &self.bounds, self.bits, &mut self.triangulator) {
                        return Ok(true);
                    }
                }
                if self.uncut.is_none() && !self.outside && !self.inside {
                    self.uncut = Some(self.is_inside(node, &cell, inside)?);
                }
            }
        }
        // The surface is between the inside and the outside.
        Ok(self.inside && self.outside)
    }

    /// Returns whether the part of the box in a leaf is inside, near its minimum corner.
    fn is_inside(&mut self, node: &ModelNode<'_>, cell: &Box3, corner: bool) -> Result<bool> {
        let to = [0, 1, 2].map(|axis| self.bounds.min[axis].max(cell.min[axis]));
        let Some(line) = Line::between_fine(self.model.grid(), self.bits, cell.min, to) else {
            return Ok(corner);
        };
        line.leads_inside(self.model, node, corner, &mut self.buffer)
    }
}

impl Line {
    /// Returns whether the line's end is inside, for a line within a leaf's cell, given whether it
    /// begins inside.
    pub(super) fn leads_inside(
        &self,
        model: &ExactModel,
        node: &ModelNode<'_>,
        begins_inside: bool,
        buffer: &mut FaceBuffer,
    ) -> Result<bool> {
        let mut winding = i32::from(begins_inside);
        for number in node.faces() {
            model.face(number, buffer)?;
            winding += match self.crossing(&buffer.face()) {
                Some(crossing) if crossing.is_entry => 1,
                Some(_) => -1,
                None => 0,
            };
        }
        Ok(winding > 0)
    }
}

/// Returns whether a face intersects the interior of a box in `2^-bits` grid units.
fn cuts(face: &Face<'_>, bounds: &Box3, bits: u8, triangulator: &mut Triangulator) -> bool {
    let wide = |point: &[i32; 3]| point.map(|at| i64::from(at) << bits);
    if let [a, b, c] = face.points {
        return triangle::cuts(&[wide(a), wide(b), wide(c)], bounds.min, bounds.max);
    }
    let points: Vec<[i64; 3]> = face.points.iter().map(wide).collect();
    GridPolygon::new(&points, face.ring_ends, triangulator).is_ok_and(|polygon| polygon.cuts(bounds).cuts)
}
