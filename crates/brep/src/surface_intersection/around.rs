//! Faces around a segment: which of them continue from it, and which of these are inside of the
//! other body.
//!
//! A face that a segment crosses is two half-planes; a face along whose edge it runs is one. Around
//! the segment, the half-planes of a closed surface are walls between the inside and the outside.

use std::cmp::Ordering;

use bnum::cast::As;
use bnum::types::{I256, I512};

use crate::arrangement::{ExactPoint, SamplePoint, Surface, cross, wide};
use crate::exact::vector::{self, main_axis, others};

/// A face on one side of a segment.
pub(super) struct HalfPlane {
    pub(super) face: u32,
    /// Whether it is to the left of the segment, as seen from outside.
    pub(super) is_left: bool,
    /// A vector from the segment into the face, perpendicular to the segment.
    along: [I256; 3],
}

/// The direction of a segment: exact, of arbitrary length.
pub(super) struct SegmentAxis {
    direction: [i128; 3],
    /// Axis of the direction's largest component.
    main: usize,
}

impl SegmentAxis {
    /// Returns the direction of the line of two faces' planes.
    pub(super) fn of(surface: &Surface<'_>, [a, b]: [u32; 2]) -> SegmentAxis {
        let direction = cross(surface.plane(a).normal, surface.plane(b).normal);
        let main = main_axis(direction);
        SegmentAxis { direction, main }
    }

    /// Compares two points of the line.
    pub(super) fn order(&self, a: &ExactPoint, b: &ExactPoint) -> Ordering {
        let order = a.compare(b, self.main);
        if self.direction[self.main] > 0 { order } else { order.reverse() }
    }

    /// Returns the half-planes of a face at a segment that no vertex of the face divides: none, one
    /// or two.
    pub(super) fn half_planes(
        &self,
        surface: &Surface<'_>,
        face: u32,
        ends: [&ExactPoint; 2],
    ) -> Vec<HalfPlane> {
        let plane = surface.plane(face);
        if ends.iter().any(|end| plane.side(end) != 0) {
            return Vec::new();
        }
        let polygon = surface.polygon(face);
        let mut sides = Vec::new();
        for (corner, next) in polygon.edges() {
            if ends.iter().any(|end| corner.line.side(end) != 0) {
                continue;
            }
            let is_left = self.order(&corner.point, next).is_lt();
            let [low, high] = if is_left { [&corner.point, next] } else { [next, &corner.point] };
            if self.order(low, ends[0]).is_le() && self.order(ends[1], high).is_le() {
                sides.push(is_left);
            }
        }
        if sides.is_empty() && surface.meets(&SamplePoint::mean(plane, &ends), face) {
            sides.extend([true, false]);
        }
        let half_plane = |is_left: bool| {
            let normal = if is_left { plane.normal } else { plane.normal.map(|part| -part) };
            let along = vector::cross(normal.map(|part| wide(part.into())), self.direction.map(wide));
            HalfPlane { face, is_left, along }
        };
        sides.into_iter().map(half_plane).collect()
    }

    /// Returns the sign of the turn from one half-plane to another, counterclockwise as seen from
    /// the tip of the direction.
    fn turn(&self, a: &HalfPlane, b: &HalfPlane) -> i32 {
        let [u, v] = others(self.main);
        let minor = times(a.along[u], b.along[v]) - times(a.along[v], b.along[u]);
        sign(&minor) * if self.direction[self.main] > 0 { 1 } else { -1 }
    }

    /// Returns the angle from one half-plane to another as a class: 0 for no angle, 1 below 180
    /// degrees, 2 for 180, 3 above.
    fn quarter(&self, from: &HalfPlane, to: &HalfPlane) -> u8 {
        match self.turn(from, to) {
            1 => 1,
            -1 => 3,
            _ if is_same_way(from, to) => 0,
            _ => 2,
        }
    }

    /// Returns how often the segment bounds the section of one surface that is inside of another
    /// body: positive with that section to its left. Also returns whether the surfaces coincide
    /// next to the segment. (Where they coincide with equal orientation, that counts as inside.)
    pub(super) fn crossings(&self, own: &[HalfPlane], other: &[HalfPlane]) -> (i32, bool) {
        let (mut count, mut is_on) = (0, false);
        for half in own {
            let mut walls: Vec<(u8, &HalfPlane)> =
                other.iter().map(|wall| (self.quarter(half, wall), wall)).collect();
            let is_before = |one: &(u8, &HalfPlane), other: &(u8, &HalfPlane)| {
                one.0 < other.0 || (one.0 == other.0 && self.turn(one.1, other.1) > 0)
            };
            is_on |= walls.iter().any(|(quarter, _)| *quarter == 0);
            let is_inside = loop {
                // The next wall counterclockwise: the sector before a left wall is inside, at the
                // back of its face.
                let nearest = |best, wall| if is_before(&wall, &best) { wall } else { best };
                let Some(first) = walls.iter().copied().reduce(nearest) else { break false };
                let is_same = |wall: &(u8, &HalfPlane)| !is_before(&first, wall);
                let net: i32 = walls
                    .iter()
                    .filter(|wall| is_same(wall))
                    .map(|(_, wall)| if wall.is_left { 1 } else { -1 })
                    .sum();
                match first.0 {
                    // (Coincident walls of one body cancel.)
                    _ if net == 0 => walls.retain(|wall| !is_same(wall)),
                    0 => break (net > 0) == half.is_left,
                    _ => break net > 0,
                }
            };
            if is_inside {
                count += if half.is_left { 1 } else { -1 };
            }
        }
        (count, is_on)
    }
}

fn is_same_way(a: &HalfPlane, b: &HalfPlane) -> bool {
    let sum = (0..3).fold(I512::default(), |sum, axis| sum + times(a.along[axis], b.along[axis]));
    sum.is_positive()
}

/// Returns the product of numbers of at most 170 bits.
fn times(a: I256, b: I256) -> I512 {
    let (a, b): (I512, I512) = (a.as_(), b.as_());
    a * b
}

fn sign(number: &I512) -> i32 {
    i32::from(number.is_positive()) - i32::from(number.is_negative())
}
