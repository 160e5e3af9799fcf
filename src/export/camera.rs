//! Where a picture of a solid is taken from.

use crate::{Error, Result};

/// How distance is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Projection {
    /// Parallel lines stay parallel, and sizes can be compared.
    Orthographic,
    /// What is farther away is smaller.
    #[default]
    Perspective,
}

/// The axis of the world that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Up {
    /// As in many modelling programs; north is then against z.
    Y,
    /// As on maps; north is along y.
    #[default]
    Z,
}

impl Up {
    /// A direction given by its parts to the east, to the north and up.
    fn direction(self, [east, north, up]: [f64; 3]) -> [f64; 3] {
        match self {
            Up::Y => [east, up, -north],
            Up::Z => [east, north, up],
        }
    }
}

/// A camera that sees all of a box.
#[derive(Clone, Debug)]
pub(super) struct Camera {
    projection: Projection,
    /// The picture's right and up, and from what is seen towards the camera.
    pub(super) right: [f64; 3],
    pub(super) top: [f64; 3],
    pub(super) towards: [f64; 3],
    /// Up in the world.
    pub(super) sky: [f64; 3],
    /// In the middle of the picture: a point of the plane of pixels, or the eye.
    origin: [f64; 3],
    /// Width of a pixel, in units of the world or, in perspective, at distance 1.
    pixel: f64,
    /// Width of a pixel where the box is nearest.
    pub(super) footprint: f64,
    /// Columns and rows.
    size: [f64; 2],
}

/// Share of the picture that what is seen may fill along an axis.
const FILLED: f64 = 0.92;
/// Tangent of half the angle that the shorter side of a picture has in perspective.
const HALF_ANGLE: f64 = 0.3;

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + s b`.
pub(super) fn plus(a: [f64; 3], s: f64, b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| a[axis] + s * b[axis])
}

/// With length 1; `None` of nothing.
pub(super) fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|number| number / length))
}

/// What a camera is asked for: see [`RenderRequest`](super::RenderRequest).
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) azimuth: f64,
    pub(super) elevation: f64,
    pub(super) zoom: f64,
    pub(super) projection: Projection,
    pub(super) up: Up,
    pub(super) size: [u64; 2],
}

impl Camera {
    /// A camera that sees all corners of a box.
    ///
    /// # Errors
    /// If a number makes no sense.
    pub(super) fn facing(pose: &Pose, corners: &[[f64; 3]; 8]) -> Result<Camera> {
        let Pose { azimuth, elevation, zoom, projection, up, size } = *pose;
        if !azimuth.is_finite() || !(-90.0..=90.0).contains(&elevation) {
            let found = format!("{azimuth},{elevation}");
            return Err(Error::invalid(
                "direction",
                found,
                "an azimuth, and an elevation of -90 to 90 degrees",
            ));
        }
        if !(1e-3..=1e6).contains(&zoom) {
            return Err(Error::invalid("zoom", zoom.to_string(), "0.001 to 1000000"));
        }
        let (azimuth, elevation) = (azimuth.to_radians(), elevation.to_radians());
        let around = [azimuth.sin(), azimuth.cos()];
        let towards =
            up.direction([around[0] * elevation.cos(), around[1] * elevation.cos(), elevation.sin()]);
        let right = up.direction([-around[1], around[0], 0.0]);
        let top = cross(towards, right);
        let sky = up.direction([0.0, 0.0, 1.0]);
        let middle: [f64; 3] = std::array::from_fn(|axis| corners[0][axis].midpoint(corners[7][axis]));
        // The corners as the camera sees them: to the right, up, and nearer.
        let seen = corners.map(|corner| {
            let from = plus(corner, -1.0, middle);
            [dot(from, right), dot(from, top), dot(from, towards)]
        });
        let size = size.map(|pixels| pixels as f64);
        let nearest = seen.iter().map(|corner| corner[2]).fold(f64::NEG_INFINITY, f64::max);
        let most = |axis: usize| seen.iter().map(|corner| corner[axis].abs()).fold(0.0, f64::max);
        let radius = most(0).max(most(1)).max(most(2)).max(f64::MIN_POSITIVE);
        match projection {
            Projection::Orthographic => {
                let pixel = (0..2).map(|axis| 2.0 * most(axis) / (FILLED * size[axis])).fold(0.0, f64::max);
                let pixel = pixel.max(radius * 1e-9) / zoom;
                let origin = plus(middle, 2.0 * radius, towards);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint: pixel, size })
            }
            Projection::Perspective => {
                let pixel = 2.0 * HALF_ANGLE / size[0].min(size[1]);
                let distance = seen.iter().flat_map(|corner| {
                    (0..2).map(|axis| {
                        let half = FILLED * pixel * size[axis] / 2.0;
                        corner[axis].abs() / half + corner[2]
                    })
                });
                let distance = distance.fold(nearest + 0.1 * radius, f64::max);
                let pixel = pixel / zoom;
                let origin = plus(middle, distance, towards);
                let footprint = pixel * (distance - nearest);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint, size })
            }
        }
    }

    /// Origin and direction of the ray through a place of the picture, in pixels from its upper left corner.
    pub(super) fn ray(&self, [x, y]: [f64; 2]) -> ([f64; 3], [f64; 3]) {
        let across = (x - self.size[0] / 2.0) * self.pixel;
        let up = (self.size[1] / 2.0 - y) * self.pixel;
        let aside = plus(self.right.map(|number| number * across), up, self.top);
        match self.projection {
            Projection::Orthographic => (plus(self.origin, 1.0, aside), self.towards.map(|number| -number)),
            Projection::Perspective => {
                let direction = plus(aside, -1.0, self.towards);
                (self.origin, unit(direction).unwrap_or(direction))
            }
        }
    }
}
