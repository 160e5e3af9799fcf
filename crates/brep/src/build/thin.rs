//! Intersections of two faces, and their depth.
//!
//! Invariant: if rounding moved the vertices of two faces that did not intersect, by up to a unit
//! each, a shift by [`BuildReport::THIN`] separates them again, or their triangles: their distance
//! along a separating axis was not negative before, and each moved by at most a unit along it. The
//! shift bounds the thickness of the space between the faces. So a repair that only resolves thin
//! intersections keeps the body, up to rounding; if deep ones counted as thin, it would unite or
//! remove bodies without being requested.

use super::BuildReport;
use super::defects::DefectKind;
use crate::exact::vector::{cross, dot, subtract};
use crate::face_triangle::FaceTriangle;

/// An intersection of two faces.
pub(super) struct Conflict {
    pub(super) kind: DefectKind,
    /// Whether rounding may have caused it.
    pub(super) is_thin: bool,
}

impl Conflict {
    /// Describes an intersection of two triangles.
    pub(super) fn of(kind: DefectKind, triangles: [&FaceTriangle; 2]) -> Conflict {
        Conflict { kind, is_thin: is_thin(kind, triangles) }
    }
}

type Corners = [[f64; 3]; 3];

/// Returns whether two triangles that intersect can be separated by a small shift. A fold encloses
/// nothing, whatever its size.
fn is_thin(kind: DefectKind, [a, b]: [&FaceTriangle; 2]) -> bool {
    let [a, b] = [a, b].map(|triangle| triangle.corners.map(|corner| corner.map(f64::from)));
    kind == DefectKind::Fold || depth(kind, &a, &b) <= BuildReport::THIN
}

/// Returns the length of the shortest shift that separates two triangles: the least of the lengths
/// that their projections have in common (separating axes; Gottschalk, Lin and Manocha, 1996).
/// Triangles that overlap are in one plane, and are shifted in it.
fn depth(kind: DefectKind, a: &Corners, b: &Corners) -> f64 {
    let [own, other] = [a, b].map(edges);
    let [normal, other_normal] = [own, other].map(|[first, second, _]| cross(first, second));
    let axes: Vec<[f64; 3]> = match kind {
        DefectKind::Overlap => own.into_iter().chain(other).map(|edge| cross(normal, edge)).collect(),
        _ => {
            let pairs = own.into_iter().flat_map(|own| other.map(|other| cross(own, other)));
            pairs.chain([normal, other_normal]).collect()
        }
    };
    let common = |axis: [f64; 3]| {
        let length = dot(axis, axis).sqrt();
        let interval = |corners: &Corners| {
            let at = corners.map(|corner| dot(subtract(corner, a[0]), axis) / length);
            [at.into_iter().fold(f64::INFINITY, f64::min), at.into_iter().fold(f64::NEG_INFINITY, f64::max)]
        };
        let ([low, high], [other_low, other_high]) = (interval(a), interval(b));
        (high - other_low).min(other_high - low)
    };
    // (Parallel edges define no axis.)
    let axes = axes.into_iter().filter(|axis| *axis != [0.0; 3]);
    axes.map(common).fold(f64::INFINITY, f64::min)
}

fn edges([a, b, c]: &Corners) -> [[f64; 3]; 3] {
    [subtract(*b, *a), subtract(*c, *b), subtract(*a, *c)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shallow_and_deep_intersections() {
        let floor = [[0, 0, 0], [1000, 0, 0], [0, 1000, 0]].map(|corner| corner.map(f64::from));
        let depth_of =
            |kind, other: [[i32; 3]; 3]| depth(kind, &floor, &other.map(|corner| corner.map(f64::from)));
        let crossing = |other| depth_of(DefectKind::Crossing, other);
        // A wall whose foot is below the floor.
        assert_eq!(crossing([[100, 100, -2], [200, 100, -2], [150, 100, 500]]), 2.0);
        // A wall whose corner is beyond the floor's edge by 9. (A shift at right angles to its side
        // is shorter.)
        assert!((crossing([[100, -500, -300], [100, 9, 0], [100, -500, 300]]) - 4.57).abs() < 0.01);
        assert!(crossing([[100, 200, -300], [400, 200, -300], [300, 200, 300]]) > 100.0);
        // Two edges that pass each other.
        assert!((crossing([[400, 1, -300], [400, 1, 300], [700, -900, 0]]) - 1.0).abs() < 0.1);
        let overlap = |other| depth_of(DefectKind::Overlap, other);
        // An edge that is 3 units beyond the floor's edge, and a triangle inside of it.
        assert_eq!(overlap([[100, 3, 0], [50, -800, 0], [900, 3, 0]]), 3.0);
        assert_eq!(overlap([[100, 100, 0], [400, 100, 0], [400, 103, 0]]), 103.0);
    }
}
