//! Unions of coplanar facets.

use super::exact_face::ExactFace;
use super::overlay::{Corner, PlaneSegment, regions};
use super::point::{ExactPlane, ExactPoint, turn};
use super::sample::SamplePoint;
use crate::exact::bounds::MARGIN;
use crate::exact::vector::others;

/// Vertex of a polygon.
#[derive(Clone, Copy, Debug)]
pub struct UnitedVertex {
    /// The vertex.
    pub point: ExactPoint,
    /// A second plane that contains the edge to the next vertex.
    pub line: ExactPlane,
    /// Whether the ring turns at the vertex.
    pub turns: bool,
}

/// Returns the polygons that simple facets of a plane cover together, as rings: the outer ring
/// first, counterclockwise as seen from the front of the plane, then holes. A facet's vertex has a
/// second plane that contains the edge to the next vertex. The interiors of the facets must be
/// disjoint; facets may meet in parts of edges. Returns `None` if `is_interrupted`
/// returns true: the work may be quadratic in the number of facets.
pub fn unite_facets(
    plane: &ExactPlane,
    facets: &[Vec<(ExactPoint, ExactPlane)>],
    is_interrupted: &dyn Fn() -> bool,
) -> Option<Vec<Vec<Vec<UnitedVertex>>>> {
    let face = |facet: &Vec<(ExactPoint, ExactPlane)>| ExactFace {
        plane: *plane,
        corners: facet.iter().map(|(point, line)| Corner { point: *point, line: *line }).collect(),
        ring_ends: vec![facet.len()],
        colours: Vec::new(),
        part: 0,
        source: 0,
    };
    let faces: Vec<ExactFace> = facets.iter().map(face).collect();
    let edges = faces.iter().flat_map(|face| face.edges());
    let segments: Vec<PlaneSegment> =
        edges.map(|(corner, next)| PlaneSegment { ends: [corner.point, *next], line: corner.line }).collect();
    let axis = plane.main_axis();
    let spans: Vec<[[f64; 2]; 2]> =
        faces.iter().map(|face| others(axis).map(|axis| span(face, axis))).collect();
    let found = regions(plane, &segments, &[], &|_| is_interrupted(), |region| {
        // (Facets surround the holes between them, too.)
        let sample = SamplePoint::of_region(plane, region);
        let at = others(axis).map(|axis| sample.near[axis]);
        let is_near = |spans: &[[f64; 2]; 2]| {
            spans.iter().zip(at).all(|([low, high], at)| low - MARGIN <= at && at <= high + MARGIN)
        };
        let mut near = faces.iter().zip(&spans).filter(|(_, spans)| is_near(spans));
        near.any(|(face, _)| sample.meets_exact(face)).then_some(())
    })?;
    let is_up = plane.normal[axis] > 0;
    let ring = |corners: &Vec<Corner>| {
        let count = corners.len();
        let vertex = |i: usize| {
            let [last, next] = [(i + count - 1) % count, (i + 1) % count];
            let turns = turn(axis, [last, i, next].map(|i| &corners[i].point)) != 0;
            let line = if is_up { corners[i].line } else { corners[last].line };
            UnitedVertex { point: corners[i].point, line, turns }
        };
        let mut ring: Vec<UnitedVertex> = (0..count).map(vertex).collect();
        if !is_up {
            ring.reverse();
        }
        ring
    };
    Some(found.iter().map(|(region, ())| region.rings.iter().map(ring).collect()).collect())
}

/// Returns the minimum and the maximum coordinate of a face along an axis, nearly.
fn span(face: &ExactFace, axis: usize) -> [f64; 2] {
    let coordinates = face.corners.iter().map(|corner| corner.point.near[axis]);
    coordinates.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facet(plane: &ExactPlane, corners: &[[i32; 3]]) -> Vec<(ExactPoint, ExactPlane)> {
        let axis = plane.main_axis();
        let next = |i: usize| corners[(i + 1) % corners.len()];
        let vertex =
            |i: usize| (ExactPoint::of_grid(corners[i]), ExactPlane::along(axis, corners[i], next(i)));
        (0..corners.len()).map(vertex).collect()
    }

    /// Eight squares around a hole, of both orientations, one of them divided: a square with a
    /// hole, whose vertices between the facets do not turn.
    #[test]
    fn facets_around_a_hole_are_one_polygon() {
        for normal in [[0, 0, 1], [0, 0, -1]] {
            let plane = ExactPlane::through([0, 0, 5], normal);
            let square = |x: i32, y: i32, width: i32| {
                let corners = [[x, y, 5], [x + width, y, 5], [x + width, y + 3, 5], [x, y + 3, 5]];
                facet(&plane, &corners)
            };
            let positions = (0..9).map(|i| [3 * (i % 3), 3 * (i / 3)]).filter(|at| *at != [3, 3]);
            let mut facets: Vec<_> = positions.skip(1).map(|[x, y]| square(x, y, 3)).collect();
            facets.extend([square(0, 0, 1), square(1, 0, 2)]);
            let found = unite_facets(&plane, &facets, &|| false).unwrap();
            let [polygon] = &found[..] else { panic!("{} polygons", found.len()) };
            let turning = |ring: &Vec<UnitedVertex>| ring.iter().filter(|vertex| vertex.turns).count();
            assert_eq!(polygon.iter().map(turning).collect::<Vec<_>>(), [4, 4]);
            let area = |ring: &Vec<UnitedVertex>| -> f64 {
                let of_edge = |i: usize| {
                    let (a, b) = (ring[i].point.near, ring[(i + 1) % ring.len()].point.near);
                    (a[0] * b[1] - a[1] * b[0]) / 2.0
                };
                (0..ring.len()).map(of_edge).sum()
            };
            let up = normal[2] as f64;
            assert_eq!(polygon.iter().map(area).collect::<Vec<_>>(), [81.0 * up, -9.0 * up]);
        }
        assert!(
            unite_facets(&ExactPlane::through([0; 3], [0, 0, 1]), &[], &|| true)
                .is_none_or(|all| all.is_empty())
        );
    }
}
