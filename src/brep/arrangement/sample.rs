//! Points inside regions of a plane, and the faces that a line along an axis through such a point meets: exact.

use bnum::cast::As;
use bnum::types::I1024;

use super::overlay::Region;
use super::point::{ERROR, ExactPlane, ExactPoint, area, others, sign, turn};

/// A point of a plane by its place as seen along the plane's main axis, in homogeneous coordinates of at most 535 bits.
pub(super) struct Sample<'a> {
    pub(super) plane: &'a ExactPlane,
    pub(super) axis: usize,
    /// Along the two other axes.
    at: [I1024; 2],
    /// Positive.
    weight: I1024,
    /// Coordinates and weight once more in fewer bits, if these are below 2^68 and 2^40.
    small: Option<([i128; 2], i128)>,
    pub(super) near: [f64; 3],
}

fn widen<const N: usize>(number: bnum::Int<N>) -> I1024 {
    number.as_()
}

fn small(number: i64) -> I1024 {
    number.as_()
}

impl<'a> Sample<'a> {
    /// The middle of a triangle of the grid.
    pub(super) fn of_triangle(plane: &'a ExactPlane, corners: &[[i32; 3]; 3]) -> Sample<'a> {
        let axis = plane.main_axis();
        let sum = |axis: usize| corners.iter().map(|corner| i64::from(corner[axis])).sum::<i64>();
        let near = [0, 1, 2].map(|axis| sum(axis) as f64 / 3.0);
        let at = others(axis).map(&sum);
        let few = Some((at.map(i128::from), 3));
        Sample { plane, axis, at: at.map(small), weight: small(3), small: few, near }
    }

    /// A point inside a region: if the triangle at a convex corner has no other corner inside, the middle of it;
    /// otherwise the middle of the diagonal to the one that lies deepest in it.
    pub(super) fn of_region(plane: &'a ExactPlane, region: &Region) -> Sample<'a> {
        let axis = plane.main_axis();
        let [u, v] = others(axis);
        let ring = &region.rings[0];
        // The least point is a convex corner.
        let order =
            |a: usize, b: usize| ring[a].compare(&ring[b], u).then_with(|| ring[a].compare(&ring[b], v));
        let least =
            (1..ring.len()).fold(0, |best, other| if order(other, best).is_lt() { other } else { best });
        let (last, next) = (&ring[(least + ring.len() - 1) % ring.len()], &ring[(least + 1) % ring.len()]);
        let corner = &ring[least];
        let is_in = |point: &ExactPoint| {
            turn(axis, [last, corner, point]) > 0
                && turn(axis, [corner, next, point]) > 0
                && turn(axis, [next, last, point]) > 0
        };
        // (Depths without the weight of the point itself.)
        let depth = |point: &ExactPoint| area(axis, [next, last, point]);
        let mut deepest: Option<(&ExactPoint, I1024)> = None;
        for point in region.rings.iter().flatten().filter(|point| is_in(point)) {
            let found = depth(point);
            if deepest
                .as_ref()
                .is_none_or(|(best, most)| found * widen(best.weight) > *most * widen(point.weight))
            {
                deepest = Some((point, found));
            }
        }
        match deepest {
            Some((point, _)) => Sample::mean(plane, &[corner, point]),
            None => Sample::mean(plane, &[last, corner, next]),
        }
    }

    /// The mean of some points.
    fn mean(plane: &'a ExactPlane, points: &[&ExactPoint]) -> Sample<'a> {
        let axis = plane.main_axis();
        let count = points.len();
        let others_weight = |index: usize| {
            (0..count)
                .filter(|other| *other != index)
                .fold(small(1), |all, other| all * widen(points[other].weight))
        };
        let at = others(axis).map(|axis| {
            (0..count).fold(small(0), |sum, index| sum + widen(points[index].at[axis]) * others_weight(index))
        });
        let weight = others_weight(0) * widen(points[0].weight) * small(count as i64);
        let near =
            [0, 1, 2].map(|axis| points.iter().map(|point| point.near[axis]).sum::<f64>() / count as f64);
        let few = (weight < small(1 << 40)).then(|| (at.map(|at| at.as_()), weight.as_()));
        Sample { plane, axis, at, weight, small: few, near }
    }

    /// Whether the line along the axis through the point, moved a little to greater coordinates (along the second axis
    /// by far less than along the first), meets a polygon: by even and odd.
    pub(super) fn meets(&self, points: &[[i32; 3]], ring_ends: &[usize]) -> bool {
        let [u, v] = others(self.axis);
        // The sign of a coordinate's difference from the point's.
        let beyond = |place: usize, coordinate: i32| {
            let difference = f64::from(coordinate) - self.near[[u, v][place]];
            if difference.abs() > 2.0 * ERROR {
                return if difference > 0.0 { 1 } else { -1 };
            }
            match self.small {
                Some((at, weight)) => (i128::from(coordinate) * weight - at[place]).signum() as i32,
                None => sign(&(small(coordinate.into()) * self.weight - self.at[place])),
            }
        };
        let mut inside = false;
        let mut start = 0;
        for &end in ring_ends {
            let ring = &points[start..end];
            start = end;
            let Some(mut a) = ring.last() else { continue };
            for b in ring {
                let (above_a, above_b) = (beyond(1, a[v]) > 0, beyond(1, b[v]) > 0);
                if above_a != above_b {
                    inside ^= if beyond(0, a[u].min(b[u])) > 0 {
                        true
                    } else if beyond(0, a[u].max(b[u])) < 0 {
                        false
                    } else {
                        // Going up, the point is to the left of an edge that passes at a greater coordinate.
                        let turn = self.turn(a, b);
                        turn != 0 && (turn > 0) == above_b
                    };
                }
                a = b;
            }
        }
        inside
    }

    /// Whether the point lies to the left (1) of an edge, to the right (-1), or on its line.
    fn turn(&self, a: &[i32; 3], b: &[i32; 3]) -> i32 {
        let [u, v] = others(self.axis);
        let along = [u, v].map(|axis| i64::from(b[axis]) - i64::from(a[axis]));
        let to = [u, v].map(|axis| self.near[axis] - f64::from(a[axis]));
        let area = along[0] as f64 * to[1] - along[1] as f64 * to[0];
        let size = along[0].abs() + along[1].abs();
        if area.abs() > size as f64 * (4.0 * ERROR) {
            return if area > 0.0 { 1 } else { -1 };
        }
        if let Some((at, weight)) = self.small {
            let to = |place: usize| at[place] - i128::from(a[[u, v][place]]) * weight;
            return (i128::from(along[0]) * to(1) - i128::from(along[1]) * to(0)).signum() as i32;
        }
        let to = |place: usize| self.at[place] - small(a[[u, v][place]].into()) * self.weight;
        sign(&(small(along[0]) * to(1) - small(along[1]) * to(0)))
    }

    /// The side of a plane on which the point lies; where it lies on it, that on which it comes to lie when it is moved
    /// as in [`Sample::meets`], in its own plane. 0 if the planes are the same.
    pub(super) fn side(&self, plane: &ExactPlane) -> i32 {
        if let Some(side) = plane.side_near(self.near) {
            return side;
        }
        if self.plane.is(plane) {
            return 0;
        }
        let [u, v] = others(self.axis);
        let own = |axis: usize| small(self.plane.normal[axis]);
        let its = |axis: usize| small(plane.normal[axis]);
        let main = self.axis;
        // The coordinate along the axis is `rest / (own(main) weight)`.
        let rest = widen(wide_offset(self.plane)) * self.weight - own(u) * self.at[0] - own(v) * self.at[1];
        let height = own(main)
            * (its(u) * self.at[0] + its(v) * self.at[1] - widen(wide_offset(plane)) * self.weight)
            + its(main) * rest;
        let up = self.plane.normal[main].signum() as i32;
        let moved = |axis: usize| sign(&(its(axis) * own(main) - its(main) * own(axis)));
        [sign(&height), moved(u), moved(v)].into_iter().find(|side| *side != 0).unwrap_or(0) * up
    }
}

fn wide_offset(plane: &ExactPlane) -> bnum::types::I256 {
    super::point::wide(plane.offset)
}
