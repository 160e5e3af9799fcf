//! Winding numbers of points with rational coordinates, by the octree: along a line to the first cell that no face cuts.

use std::collections::HashSet;
use std::ops::ControlFlow;

use super::bodies::{Bodies, Use};
use super::placed::Placed;
use super::table::Fate;
use crate::arrangement::{ExactPlane, SamplePoint};
use crate::exact::bounds::MARGIN;
use crate::exact::normal::ring_normal;
use crate::{ExactModel, FaceBuffer, ModelNode, ModelNodeState};
use spinney_base::{Result, sort};

/// The winding number of a model's surface around a sample that lies on none of its faces. Where faces stand in for others with corners
/// beside the grid, these are asked.
pub(super) fn winding(
    model: &ExactModel,
    number: usize,
    placed: &Placed,
    sample: &SamplePoint<'_>,
) -> Result<i32> {
    let mut line = LineWalk::new(model, number, placed, sample, true);
    let root = model.root()?;
    // Where a cell begins that is all inside or all outside, and on which side it is.
    // Invariant: the line ends in a cell that no face cuts and none with corners beside the grid is near, or
    // behind all of them: there the winding number is the same for points that are moved a little in different
    // ways, as those of cells are and those of samples, and for the surface of the faces that stand in. And
    // every face that the line meets before is in a leaf that it goes through. (But for leaves that end within
    // 1e-6 of the point, which are passed over.)
    let (end, mut winding) = match line.node(&root)? {
        ControlFlow::Break((at, side)) => (Some(at), side),
        ControlFlow::Continue(()) => (None, model.far_winding()),
    };
    // The change where a face is crossed on the way: what is met where the cell begins does not go on into it.
    let change = |plane: &ExactPlane| {
        let up = plane.normal[sample.axis].signum() as i32;
        let is_above = sample.side(plane) * up < 0;
        let is_before = end.is_none_or(|end| sample.height_at(plane, end) * up >= 0);
        if is_above && is_before { up } else { 0 }
    };
    let (mut buffer, mut points) = (FaceBuffer::default(), Vec::new());
    let mut known = HashSet::new();
    for face in line.faces {
        if !known.insert(face) {
            continue;
        }
        model.face(face, &mut buffer)?;
        if buffer.is_proxy {
            continue;
        }
        points.clear();
        points.extend(buffer.points.iter().map(|point| placed.point(number, *point)));
        let normal = ring_normal(&points[..buffer.ring_ends[0]]);
        if normal[sample.axis] != 0 && sample.meets(&points, &buffer.ring_ends) {
            winding += change(&ExactPlane::through(points[0], normal));
        }
    }
    let mut known = HashSet::new();
    for face in line.exact {
        if known.insert(face) {
            let face = placed.exact(number, model.exact_face(face)?);
            if face.plane.normal[sample.axis] != 0 && sample.meets_exact(&face) {
                winding += change(&face.plane);
            }
        }
    }
    Ok(winding)
}

/// The change in the winding number of the result's surface above a sample by those faces that are not near other bodies; none of these is at
/// the sample.
///
/// Invariant: each face that the line meets is in a leaf that it goes through, and counts once, with the fate that it has in the result, so that
/// these faces and those that are near are the whole surface, each once.
pub(super) fn settled_above(bodies: &Bodies<'_>, sample: &SamplePoint<'_>) -> Result<i32> {
    let (mut buffer, mut points) = (FaceBuffer::default(), Vec::new());
    let mut known = HashSet::new();
    let mut sum = 0;
    for (number, model) in bodies.models.iter().enumerate() {
        let mut line = LineWalk::new(model, number, bodies.placed, sample, false);
        // (To its end: it breaks off nowhere.)
        let _ = line.node(&model.root()?)?;
        known.clear();
        for face in line.faces.into_iter().filter(|face| known.insert(*face)) {
            model.face(face, &mut buffer)?;
            let way = match bodies.becomes(number, &buffer.face(), buffer.is_proxy) {
                Use::Settled(Fate::Kept) => 1,
                Use::Settled(Fate::Turned) => -1,
                _ => continue,
            };
            bodies.put(number, face, &buffer.points, &mut points)?;
            let normal = ring_normal(&points[..buffer.ring_ends[0]]);
            let up = normal[sample.axis].signum() as i32;
            let plane = ExactPlane::through(points[0], normal);
            if up != 0 && sample.meets(&points, &buffer.ring_ends) && sample.side(&plane) * up < 0 {
                sum += way * up;
            }
        }
    }
    Ok(sum)
}

struct LineWalk<'a> {
    model: &'a ExactModel,
    number: usize,
    placed: &'a Placed,
    sample: &'a SamplePoint<'a>,
    /// Whether it ends in the first cell that no face cuts.
    stops: bool,
    /// Faces of the cells that the line goes through, some of them several times.
    faces: Vec<u64>,
    /// Those with corners beside the grid that are near these cells.
    exact: Vec<u32>,
}

impl<'a> LineWalk<'a> {
    fn new(
        model: &'a ExactModel,
        number: usize,
        placed: &'a Placed,
        sample: &'a SamplePoint<'a>,
        stops: bool,
    ) -> LineWalk<'a> {
        LineWalk { model, number, placed, sample, stops, faces: Vec::new(), exact: Vec::new() }
    }

    /// Follows the line through a cell, if it gets there: stops at a part that no face cuts, with the place where that begins.
    fn node(&mut self, node: &ModelNode<'a>) -> Result<ControlFlow<(i64, i32)>> {
        let [low, high] = self.placed.half_units(self.number, node);
        let SamplePoint { axis, near, .. } = *self.sample;
        // (A cell that ends where the point is may be passed over where others follow.)
        let margin = if self.stops { MARGIN } else { -MARGIN };
        if (high[axis] as f64) / 2.0 < near[axis] + margin || !self.sample.is_between(&low, &high) {
            return Ok(ControlFlow::Continue(()));
        }
        if let Some(winding) = node.winding().filter(|_| self.stops) {
            return Ok(ControlFlow::Break((low[axis], winding)));
        }
        if node.state() != ModelNodeState::Inner {
            self.faces.extend(node.faces());
            self.exact.extend(node.near());
            return Ok(ControlFlow::Continue(()));
        }
        // Those that lie first along the axis, first.
        let mut children: Vec<usize> = (0..8).collect();
        sort::by_key(&mut children, |child| (child >> axis & 1) as u64);
        for child in children {
            let child = self.model.child(node, child)?;
            let found = self.node(&child)?;
            if found.is_break() {
                return Ok(found);
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}
