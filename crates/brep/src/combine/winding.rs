//! Winding numbers of rational points from the octree: along a ray to the first cell without faces.

use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;

use super::bodies::{Bodies, FaceUse};
use super::common_grid::CommonGrid;
use super::table::Fate;
use crate::arrangement::{ExactPlane, SamplePoint};
use crate::exact::bounds::MARGIN;
use crate::exact::normal::ring_normal;
use crate::{ExactModel, FaceBuffer, ModelNode, ModelNodeState};
use spinney_base::{Result, sort};

/// Returns the winding number of a model's surface just above a sample: faces that contain the
/// sample do not count. Counts exact faces instead of their proxies.
pub(super) fn winding(
    model: &ExactModel,
    number: usize,
    common_grid: &CommonGrid,
    sample: &SamplePoint<'_>,
) -> Result<i32> {
    let mut line = WindingTraversal::new(model, number, common_grid, sample, true);
    let root = model.root()?;
    // Height at which a cell without faces starts, and the winding number in the cell.
    // Invariant: the ray ends in a cell that no face cuts and that no exact face is near, or after
    // all faces. There, the winding number does not depend on how ties are broken (cells and
    // samples do so in different ways), or on whether proxies or exact faces are counted. Every
    // face that the ray meets before is in a leaf along the ray.
    let (end, mut winding) = match line.node(&root)? {
        ControlFlow::Break((at, side)) => (Some(at), side),
        ControlFlow::Continue(()) => (None, model.far_winding()),
    };
    // Change of the winding number at a face, if the ray crosses it. A face beyond the start of the
    // final cell does not count.
    let change = |plane: &ExactPlane| {
        let up = plane.normal[sample.axis].signum() as i32;
        let is_above = sample.side(plane) * up < 0;
        let is_before = end.is_none_or(|end| sample.side_at(plane, end) * up >= 0);
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
        points.extend(buffer.points.iter().map(|point| common_grid.point(number, *point)));
        let normal = ring_normal(&points[..buffer.ring_ends[0]]);
        if normal[sample.axis] != 0 && sample.meets(&points, &buffer.ring_ends) {
            winding += change(&ExactPlane::through(points[0], normal));
        }
    }
    let mut known = HashSet::new();
    for face in line.exact {
        if known.insert(face) {
            let face = common_grid.exact(number, model.exact_face(face)?);
            if face.plane.normal[sample.axis] != 0 && sample.meets_exact(&face) {
                winding += change(&face.plane);
            }
        }
    }
    Ok(winding)
}

/// Returns the winding numbers of a model's parts above a sample, each by its faces alone; those
/// that are 0 may be left out. Faces that contain the sample do not count. (The ray goes on to the
/// end, since cells store no parts.)
pub(super) fn part_windings(
    model: &ExactModel,
    number: usize,
    common_grid: &CommonGrid,
    sample: &SamplePoint<'_>,
) -> Result<HashMap<u32, i32>> {
    let mut line = WindingTraversal::new(model, number, common_grid, sample, false);
    // (Never stops early.)
    let _ = line.node(&model.root()?)?;
    let mut windings = HashMap::new();
    let mut count = |part: u32, plane: &ExactPlane| {
        let up = plane.normal[sample.axis].signum() as i32;
        if sample.side(plane) * up < 0 {
            *windings.entry(part).or_insert(0) += up;
        }
    };
    let (mut buffer, mut points) = (FaceBuffer::default(), Vec::new());
    let mut known = HashSet::new();
    for face in line.faces.into_iter().filter(|face| known.insert(*face)) {
        model.face(face, &mut buffer)?;
        points.clear();
        points.extend(buffer.points.iter().map(|point| common_grid.point(number, *point)));
        let normal = ring_normal(&points[..buffer.ring_ends[0]]);
        if !buffer.is_proxy && normal[sample.axis] != 0 && sample.meets(&points, &buffer.ring_ends) {
            count(buffer.part, &ExactPlane::through(points[0], normal));
        }
    }
    let mut known = HashSet::new();
    for face in line.exact.into_iter().filter(|face| known.insert(*face)) {
        let face = common_grid.exact(number, model.exact_face(face)?);
        if face.plane.normal[sample.axis] != 0 && sample.meets_exact(&face) {
            count(face.part, &face.plane);
        }
    }
    Ok(windings)
}

/// Returns the change of the result's winding number above a sample by settled faces. None of these
/// contains the sample.
///
/// Invariant: each face that the ray meets is in a leaf along the ray, and counts once, with its
/// fate in the result. So settled faces and arranged faces together are the whole surface, each
/// counted once.
pub(super) fn settled_above(bodies: &Bodies<'_>, sample: &SamplePoint<'_>) -> Result<i32> {
    let (mut buffer, mut points) = (FaceBuffer::default(), Vec::new());
    let mut known = HashSet::new();
    let mut sum = 0;
    for (number, model) in bodies.models.iter().enumerate() {
        let mut line = WindingTraversal::new(model, number, bodies.common_grid, sample, false);
        // (Never stops early.)
        let _ = line.node(&model.root()?)?;
        known.clear();
        for face in line.faces.into_iter().filter(|face| known.insert(*face)) {
            model.face(face, &mut buffer)?;
            let way = match bodies.use_of(number, &buffer.face(), buffer.is_proxy) {
                FaceUse::Settled(Fate::Keep) => 1,
                FaceUse::Settled(Fate::Reverse) => -1,
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

struct WindingTraversal<'a> {
    model: &'a ExactModel,
    number: usize,
    common_grid: &'a CommonGrid,
    sample: &'a SamplePoint<'a>,
    /// Whether to stop at the first cell without faces.
    stops: bool,
    /// Faces of the cells along the ray, with repetitions.
    faces: Vec<u64>,
    /// Exact faces near these cells, with repetitions.
    exact: Vec<u32>,
}

impl<'a> WindingTraversal<'a> {
    fn new(
        model: &'a ExactModel,
        number: usize,
        common_grid: &'a CommonGrid,
        sample: &'a SamplePoint<'a>,
        stops: bool,
    ) -> WindingTraversal<'a> {
        WindingTraversal { model, number, common_grid, sample, stops, faces: Vec::new(), exact: Vec::new() }
    }

    /// Follows the ray through a cell, if it gets there. With `stops`, breaks at the first subcell
    /// without faces, with the height at which it starts and its winding number.
    fn node(&mut self, node: &ModelNode<'a>) -> Result<ControlFlow<(i64, i32)>> {
        let [low, high] = self.common_grid.half_units(self.number, node);
        let SamplePoint { axis, near, .. } = *self.sample;
        let end = high[axis] as f64 / 2.0;
        if end < near[axis] - MARGIN || !self.sample.is_between(&low, &high) {
            return Ok(ControlFlow::Continue(()));
        }
        // A cell that ends within the margin of the sample may end below it: `near` is approximate.
        // Its faces count, since they are compared with the sample exactly. But the ray must not
        // stop there, since a face may lie between the cell and the sample.
        let ends_above = end >= near[axis] + MARGIN;
        if let Some(winding) = node.winding().filter(|_| self.stops && ends_above) {
            return Ok(ControlFlow::Break((low[axis], winding)));
        }
        if node.state() != ModelNodeState::Inner {
            self.faces.extend(node.faces());
            self.exact.extend(node.near());
            return Ok(ControlFlow::Continue(()));
        }
        // In order along the axis.
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
