//! Exact common points of two polygons with holes, along the line of both planes.

use std::cmp::Ordering;

use super::exact_face::ExactFace;
use super::point::{ExactPlane, ExactPoint, cross};
use crate::exact::vector::main_axis;
use spinney_base::sort;

/// Segments and points that two polygons have in common.
#[derive(Debug, Default)]
pub(super) struct Common {
    pub(super) segments: Vec<[ExactPoint; 2]>,
    pub(super) points: Vec<ExactPoint>,
    /// Shared edges and vertices, as between neighbours in a surface.
    pub(super) edges: Vec<[ExactPoint; 2]>,
    pub(super) corners: Vec<ExactPoint>,
}

/// Returns the common points of two polygons in different planes.
pub(super) fn common(a: &ExactFace, b: &ExactFace) -> Common {
    let (Some(along_a), Some(along_b)) = (LineSection::of(a, &b.plane), LineSection::of(b, &a.plane)) else {
        return Common::default();
    };
    let direction = cross(a.plane.normal, b.plane.normal);
    let axis = main_axis(direction);
    let mut positions: Vec<ExactPoint> = along_a.points.iter().chain(&along_b.points).copied().collect();
    sort::by(&mut positions, &mut |a, b| a.compare(b, axis));
    positions.dedup_by(|a, b| a.compare(b, axis) == Ordering::Equal);
    let ([between_a, at_a], [between_b, at_b]) =
        (along_a.covers(&positions, axis), along_b.covers(&positions, axis));
    let is_common: Vec<bool> = between_a.iter().zip(&between_b).map(|(a, b)| *a && *b).collect();
    let mut found = Common::default();
    for (_, ends) in positions.windows(2).enumerate().filter(|(index, _)| is_common[*index]) {
        let ends = [ends[0], ends[1]];
        let is_edge = has_edge(a, &ends) && has_edge(b, &ends);
        if is_edge { &mut found.edges } else { &mut found.segments }.push(ends);
    }
    for (index, position) in positions.iter().enumerate().filter(|(index, _)| at_a[*index] && at_b[*index]) {
        let is_end = is_common.get(index).is_some_and(|is| *is) || (index > 0 && is_common[index - 1]);
        if !is_end {
            let is_corner = has_corner(a, position) && has_corner(b, position);
            if is_corner { &mut found.corners } else { &mut found.points }.push(*position);
        }
    }
    found
}

fn has_corner(face: &ExactFace, point: &ExactPoint) -> bool {
    face.corners.iter().any(|corner| corner.point.is(point))
}

fn has_edge(face: &ExactFace, [from, to]: &[ExactPoint; 2]) -> bool {
    face.edges().any(|(corner, next)| {
        (corner.point.is(from) && next.is(to)) || (corner.point.is(to) && next.is(from))
    })
}

/// Intersection of a plane with the boundary of a polygon that is not in it.
struct LineSection {
    /// All vertices in the plane, and points where edges cross it.
    points: Vec<ExactPoint>,
    /// Points where a parallel line close to the plane would enter or leave the polygon, per side.
    passed: [Vec<ExactPoint>; 2],
}

impl LineSection {
    /// `None` if the polygon is on one side of the plane.
    fn of(face: &ExactFace, plane: &ExactPlane) -> Option<LineSection> {
        let sides: Vec<i32> = face.corners.iter().map(|corner| plane.side(&corner.point)).collect();
        if sides.iter().all(|side| *side > 0) || sides.iter().all(|side| *side < 0) {
            return None;
        }
        let mut found = LineSection { points: Vec::new(), passed: [Vec::new(), Vec::new()] };
        let mut start = 0;
        for &end in &face.ring_ends {
            let count = end - start;
            for i in 0..count {
                let (from, to) = (start + i, start + (i + 1) % count);
                let (side, next) = (sides[from], sides[to]);
                let point = match (side, next) {
                    (0, _) => face.corners[from].point,
                    (_, 0) => face.corners[to].point,
                    _ if side == next => continue,
                    _ => ExactPoint::of_planes([&face.plane, &face.corners[from].line, plane]),
                };
                if side == 0 || next != 0 {
                    found.points.push(point);
                }
                // Vertices in the plane count as on one side, then on the other.
                for (passed, way) in found.passed.iter_mut().zip([1, -1]) {
                    let is_beyond = |side: i32| side * way > 0;
                    if is_beyond(side) != is_beyond(next) {
                        // (An edge that ends in the plane crosses there.)
                        let at = if side == 0 { from } else { to };
                        let is_at_corner = side == 0 || next == 0;
                        passed.push(if is_at_corner { face.corners[at].point } else { point });
                    }
                }
            }
            start = end;
        }
        Some(found)
    }

    /// Whether the polygon contains the intervals after each of `positions` along the line, and the
    /// points themselves.
    fn covers(&self, positions: &[ExactPoint], axis: usize) -> [Vec<bool>; 2] {
        let mut between = vec![false; positions.len()];
        for passed in &self.passed {
            let mut counts = vec![0u32; positions.len()];
            for point in passed {
                if let Ok(position) = positions.binary_search_by(|position| position.compare(point, axis)) {
                    counts[position] += 1;
                }
            }
            // Invariant: on each side, a closed ring crosses the line an even number of times, so
            // the line is outside again after the last point. Vertices on the line count as on one
            // side, then on the other, and never on both at once: otherwise an edge along the line
            // would swap inside and outside.
            let mut inside = false;
            for (between, count) in between.iter_mut().zip(counts) {
                inside ^= count % 2 == 1;
                *between |= inside;
            }
        }
        let mut at: Vec<bool> =
            (0..positions.len()).map(|index| between[index] || (index > 0 && between[index - 1])).collect();
        for point in &self.points {
            if let Ok(position) = positions.binary_search_by(|position| position.compare(point, axis)) {
                at[position] = true;
            }
        }
        [between, at]
    }
}
