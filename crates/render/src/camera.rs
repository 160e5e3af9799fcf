//! Cameras for images of solids: orthographic and perspective.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::RangeInclusive;

use glam::DVec3;

use spinney_base::space::Up;
use spinney_base::{Error, Result};

/// Projection of the world onto the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraProjection {
    /// Parallel lines stay parallel, and sizes can be compared.
    Orthographic,
    /// Sizes shrink with distance.
    #[default]
    Perspective,
}

/// Object that a camera is fitted to.
pub(super) trait Extent {
    /// Minimum and maximum coordinates of a box around the object.
    fn corners(&self) -> [DVec3; 2];

    /// Largest dot product of the object's points with a direction (support function).
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn support(&self, direction: DVec3) -> Result<f64>;
}

/// Heap entry: an upper bound of a node's support, and the node.
struct BoundedNode<T>(f64, T);

impl<T> PartialEq for BoundedNode<T> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl<T> Eq for BoundedNode<T> {}

impl<T> PartialOrd for BoundedNode<T> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl<T> Ord for BoundedNode<T> {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Children of a node, each with an upper bound of its support; `None` if the node is not
/// subdivided.
pub(super) type BoundedChildren<T> = Option<Vec<(f64, T)>>;

/// Support of the subtree below a node. Best-first search: the node with the largest bound is
/// subdivided next, until that node has no children. `divide` returns a node's children with their
/// bounds, or `None`.
///
/// # Errors
/// Those of `divide`.
pub(super) fn farthest<T>(
    bound: f64,
    node: T,
    divide: &dyn Fn(&T) -> Result<BoundedChildren<T>>,
) -> Result<Option<f64>> {
    // Invariant: a node's bound is at least the bound of each of its children. So the first
    // undivided node that leaves the heap attains its bound, and no pending node reaches farther.
    let mut pending = BinaryHeap::from([BoundedNode(bound, node)]);
    while let Some(BoundedNode(bound, node)) = pending.pop() {
        match divide(&node)? {
            None => return Ok(Some(bound)),
            Some(parts) => pending.extend(parts.into_iter().map(|(bound, part)| BoundedNode(bound, part))),
        }
    }
    Ok(None)
}

/// Largest dot product of a box's corners with a direction.
pub(super) fn box_support([low, high]: [DVec3; 2], direction: DVec3) -> f64 {
    (low * direction).max(high * direction).element_sum()
}

/// Camera that sees all of an object.
#[derive(Clone, Debug)]
pub(super) struct Camera {
    projection: CameraProjection,
    /// Image axes right and up, and the direction from the solid towards the camera.
    pub(super) right: DVec3,
    pub(super) top: DVec3,
    pub(super) towards: DVec3,
    /// Up direction of the world.
    pub(super) sky: DVec3,
    /// Centre of the image: a point in the plane of pixels if orthographic, the eye if perspective.
    origin: DVec3,
    /// Width of a pixel in world units; in perspective, at distance 1.
    pixel: f64,
    /// Width of a pixel at the object's nearest point.
    pub(super) footprint: f64,
    /// Columns and rows.
    size: [f64; 2],
}

/// Fraction of the image that the object may fill along an axis.
const FILLED: f64 = 0.92;
/// Tangent of half the field of view along the image's shorter side, in perspective.
const HALF_ANGLE: f64 = 0.3;

/// Supported magnifications. Below, the object covers less than a pixel; above, the rays' doubles
/// lose precision.
const SCALES: RangeInclusive<f64> = 1e-3..=1e6;
/// Minimum width of a pixel, as a fraction of the object's radius: an object seen edge-on has no
/// width.
const FLAT: f64 = 1e-9;

/// Camera parameters: see [`RenderRequest`](super::RenderRequest).
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) azimuth: f64,
    pub(super) elevation: f64,
    pub(super) scale: f64,
    pub(super) projection: CameraProjection,
    pub(super) up: Up,
    pub(super) size: [u64; 2],
}

impl Camera {
    /// Camera that sees all of `thing`, as large as possible.
    ///
    /// # Errors
    /// If a parameter is out of range, or the extent of `thing` cannot be measured.
    pub(super) fn facing(pose: &Pose, thing: &dyn Extent) -> Result<Camera> {
        let Pose { azimuth, elevation, scale, projection, up, size } = *pose;
        if !azimuth.is_finite() || !(-90.0..=90.0).contains(&elevation) {
            let found = format!("{azimuth},{elevation}");
            return Err(Error::invalid(
                "direction",
                found,
                "an azimuth, and an elevation of -90 to 90 degrees",
            ));
        }
        if !SCALES.contains(&scale) {
            let expected = format!("{} to {}", SCALES.start(), SCALES.end());
            return Err(Error::invalid("scale", scale.to_string(), expected));
        }
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        let around = [azimuth.sin(), azimuth.cos()];
        // Arguments are the components to the east, to the north and up.
        let direction = |parts: [f64; 3]| DVec3::from(up.from_z_up(parts));
        let towards = direction([around[0] * elevation.cos(), around[1] * elevation.cos(), elevation.sin()]);
        let right = direction([-around[1], around[0], 0.0]);
        let top = towards.cross(right);
        let sky = direction([0.0, 0.0, 1.0]);
        let [low, high] = thing.corners();
        let middle = low.midpoint(high);
        let radius = low.distance(high).max(f64::MIN_POSITIVE) / 2.0;
        let size = size.map(|pixels| pixels as f64);
        // Half of the filled part of the image, in pixels.
        let half = size.map(|pixels| FILLED * pixels / 2.0);
        let most =
            |direction: DVec3| -> Result<f64> { Ok(thing.support(direction)? - direction.dot(middle)) };
        let axes = [right, top];
        match projection {
            CameraProjection::Orthographic => {
                let ends = [[most(right)?, -most(-right)?], [most(top)?, -most(-top)?]];
                let aside = ends.map(|[most, least]| most.midpoint(least));
                let pixel =
                    (0..2).map(|axis| (ends[axis][0] - ends[axis][1]) / 2.0 / half[axis]).fold(0.0, f64::max);
                let pixel = pixel.max(radius * FLAT) / scale;
                let origin = middle + right * aside[0] + top * aside[1] + towards * (2.0 * radius);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint: pixel, size })
            }
            CameraProjection::Perspective => {
                let pixel = 2.0 * HALF_ANGLE / size[0].min(size[1]);
                // The eye is at distance d from the middle and shifted sideways by c. A point is
                // projected to `(point[axis] - c) / (d - point[2])`, where 2 is the axis towards
                // the eye. Its absolute value must not exceed the slope h = pixel * half, hence
                // `a - h d <= c <= b + h d`, where a is the maximum of `point[axis] + h point[2]`
                // and b the minimum of `point[axis] - h point[2]`. Such a c exists for
                // `d >= (a - b) / 2h`, and the mean of a and b is one.
                let nearest = most(towards)?;
                let mut ends = [[0.0; 2]; 2];
                for (axis, ends) in ends.iter_mut().enumerate() {
                    let deeper = towards * (pixel * half[axis]);
                    *ends = [most(axes[axis] + deeper)?, -most(deeper - axes[axis])?];
                }
                let aside = ends.map(|[most, least]| most.midpoint(least));
                let distance =
                    (0..2).map(|axis| (ends[axis][0] - ends[axis][1]) / (2.0 * pixel * half[axis]));
                // The eye is always outside of the object.
                let distance = distance.fold(nearest + 0.1 * radius, f64::max);
                let pixel = pixel / scale;
                let origin = middle + right * aside[0] + top * aside[1] + towards * distance;
                let footprint = pixel * (distance - nearest);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint, size })
            }
        }
    }

    /// Eye; `None` if it is at infinity.
    pub(super) fn eye(&self) -> Option<DVec3> {
        (self.projection == CameraProjection::Perspective).then_some(self.origin)
    }

    /// Distance of a point from the camera: from the eye in the direction of the view, or from a
    /// plane.
    pub(super) fn depth(&self, point: DVec3) -> f64 {
        (self.origin - point).dot(self.towards)
    }

    /// Weight of a point that makes interpolation along lines of the image correct: 1 if the rays
    /// are parallel, else the inverse of its distance.
    pub(super) fn share(&self, point: DVec3) -> f64 {
        match self.projection {
            CameraProjection::Orthographic => 1.0,
            CameraProjection::Perspective => self.depth(point).max(f64::MIN_POSITIVE).recip(),
        }
    }

    /// Direction to the light: over the viewer's left shoulder.
    pub(super) fn light(&self) -> DVec3 {
        (self.towards + 0.55 * self.top - 0.5 * self.right).normalize()
    }

    /// Image position of a point in front of the eye, in pixels from the upper left corner.
    pub(super) fn project(&self, point: DVec3) -> [f64; 2] {
        let from_origin = point - self.origin;
        let share = self.share(point) / self.pixel;
        let [across, up] = [self.right, self.top].map(|axis| from_origin.dot(axis) * share);
        [self.size[0] / 2.0 + across, self.size[1] / 2.0 - up]
    }

    /// Origin and direction of the ray through an image position, in pixels from the upper left
    /// corner.
    pub(super) fn ray(&self, [x, y]: [f64; 2]) -> (DVec3, DVec3) {
        let across = (x - self.size[0] / 2.0) * self.pixel;
        let up = (self.size[1] / 2.0 - y) * self.pixel;
        let aside = self.right * across + self.top * up;
        match self.projection {
            CameraProjection::Orthographic => (self.origin + aside, -self.towards),
            CameraProjection::Perspective => (self.origin, (aside - self.towards).normalize()),
        }
    }
}
