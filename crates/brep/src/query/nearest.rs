//! The nearest point of a face.

use super::plane::Plane;
use crate::Face;
use crate::exact::vector::{cross, dot, others, subtract};

/// A point of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The point, in grid units.
    pub point: [f64; 3],
    /// Squared distance from the query point, in grid units.
    pub distance_squared: f64,
    /// Number of the face.
    pub face: u64,
}

/// Returns the point of a face that is nearest to a point, in grid units. Time is proportional to
/// the vertex count.
///
/// Computed in doubles: the error of distance and point is less than 2^-48 of the distance to the
/// face's farthest vertex. The nearest point may be classified wrongly as on an edge or in the
/// interior, but only where the difference is below that error.
pub fn nearest_on_face(face: &Face<'_>, to: [f64; 3]) -> Nearest {
    let foot = foot(face, to);
    let (mut point, mut best) = ([f64::NAN; 3], f64::INFINITY);
    for ring in face.rings() {
        let Some(last) = ring.last() else { continue };
        let mut a = subtract(wide(last), to);
        for corner in ring {
            let b = subtract(wide(corner), to);
            let found = nearest_on_edge(a, b);
            let distance = dot(found, found);
            if distance < best {
                (point, best) = (found, distance);
            }
            a = b;
        }
    }
    if let Some(foot) = foot.filter(|foot| is_on_face(face, to, *foot)) {
        let distance = dot(foot, foot);
        if distance < best {
            (point, best) = (foot, distance);
        }
    }
    let point = [0, 1, 2].map(|axis| to[axis] + point[axis]);
    Nearest { point, distance_squared: best, face: face.number }
}

/// Returns the point of the edge that is nearest to the origin.
fn nearest_on_edge(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let along = subtract(b, a);
    let length = dot(along, along);
    // Relative to the nearer end, to limit the rounding error.
    let share = -dot(a, along);
    if share <= 0.0 || length == 0.0 {
        a
    } else if share >= length {
        b
    } else if 2.0 * share <= length {
        let share = share / length;
        [0, 1, 2].map(|axis| a[axis] + along[axis] * share)
    } else {
        let share = dot(b, along) / length;
        [0, 1, 2].map(|axis| b[axis] - along[axis] * share)
    }
}

/// Returns the foot of the perpendicular from a point to a face's plane, relative to the point;
/// `None` for a face without area.
fn foot(face: &Face<'_>, to: [f64; 3]) -> Option<[f64; 3]> {
    let (first, others) = face.rings().next()?.split_first()?;
    let first = wide(first);
    let mut normal = [0.0; 3];
    for edge in others.windows(2) {
        // (Differences have 27 bits, so only the sums are rounded.)
        let [u, v] = [0, 1].map(|end| subtract(wide(&edge[end]), first));
        normal.iter_mut().zip(cross(u, v)).for_each(|(part, own)| *part += own);
    }
    let length = dot(normal, normal);
    let height = dot(normal, subtract(first, to));
    (length > 0.0).then(|| normal.map(|n| n * (height / length)))
}

/// Returns whether the foot of a perpendicular is on the face.
fn is_on_face(face: &Face<'_>, to: [f64; 3], foot: [f64; 3]) -> bool {
    // Projected along the axis in which the foot is farthest, or along the normal's main axis if
    // the foot is the point itself.
    let normal = if foot == [0.0; 3] { Plane::of(face).normal.map(|n| n as f64) } else { foot };
    let Some(axis) = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs())) else {
        return false;
    };
    let [j, k] = others(axis);
    let at = [0, 1, 2].map(|axis| to[axis] + foot[axis]);
    let mut is_inside = false;
    for ring in face.rings() {
        let Some(last) = ring.last() else { continue };
        let mut a = wide(last);
        for corner in ring {
            let b = wide(corner);
            if (a[k] > at[k]) != (b[k] > at[k]) {
                let turn = (b[j] - a[j]) * (at[k] - a[k]) - (at[j] - a[j]) * (b[k] - a[k]);
                is_inside ^= (turn > 0.0) == (b[k] > a[k]);
            }
            a = b;
        }
    }
    is_inside
}

#[inline]
fn wide(point: &[i32; 3]) -> [f64; 3] {
    point.map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{Body, Random, face_of};
    use super::*;

    /// Squared distance to the nearest of many sampled points of a triangle.
    fn sampled([a, b, c]: [[f64; 3]; 3], to: [f64; 3]) -> f64 {
        const STEPS: usize = 60;
        let mut best = f64::INFINITY;
        for i in 0..=STEPS {
            for j in 0..=STEPS - i {
                let (u, v) = (i as f64 / STEPS as f64, j as f64 / STEPS as f64);
                let point = [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * u + (c[k] - a[k]) * v - to[k]);
                best = best.min(dot(point, point));
            }
        }
        best
    }

    #[test]
    fn nearest_points_are_no_farther_than_any_other_and_on_the_face() {
        let mut random = Random(1);
        for _ in 0..2000 {
            let corners = [0; 3].map(|_| random.point(100));
            let list = Body::new(7).with(vec![vec![corners.to_vec()]]).list();
            let to = random.point(200).map(|at| f64::from(at) * 0.7 - 20.0);
            let found = nearest_on_face(&list.get(0), to);
            let best = sampled(corners.map(|corner| wide(&corner)), to);
            assert!(found.distance_squared <= best + 1e-9);
            assert!(best.sqrt() - found.distance_squared.sqrt() < 3.0, "as far as samples are apart");
            let away = subtract(found.point, to);
            assert!((dot(away, away) - found.distance_squared).abs() < 1e-9);
            // The point is on the triangle: it is its own nearest point.
            assert!(nearest_on_face(&list.get(0), found.point).distance_squared < 1e-20);
        }
    }

    #[test]
    fn holes_are_not_part_of_a_face() {
        let square =
            |low: i32, high: i32| vec![[low, low, 5], [high, low, 5], [high, high, 5], [low, high, 5]];
        let mut hole = square(10, 20);
        hole.reverse();
        let list = Body::new(5).with(vec![vec![square(0, 30), hole]]).list();
        let nearest = |to| nearest_on_face(&face_of(&list), to);
        assert_eq!(nearest([15.0, 16.0, 5.0]).point, [15.0, 20.0, 5.0]);
        assert_eq!(nearest([15.0, 16.0, 5.0]).distance_squared, 16.0);
        assert_eq!(nearest([5.0, 15.0, 8.0]).point, [5.0, 15.0, 5.0]);
        assert_eq!(nearest([-3.0, 34.0, 5.0]).distance_squared, 25.0);
        assert_eq!(nearest([15.0, 11.0, 8.0]).distance_squared, 10.0);
    }
}
