//! Cameras for pictures of solids: orthographic and perspective.

use glam::DVec3;

use spinney_base::space::Up;
use spinney_base::{Error, Result};

/// CameraProjection of the world onto the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CameraProjection {
    /// Parallel lines stay parallel, and sizes can be compared.
    Orthographic,
    /// Sizes shrink with distance.
    #[default]
    Perspective,
}

/// A camera that sees all of a box.
#[derive(Clone, Debug)]
pub(super) struct Camera {
    projection: CameraProjection,
    /// The picture's right and up, and from the solid towards the camera.
    pub(super) right: DVec3,
    pub(super) top: DVec3,
    pub(super) towards: DVec3,
    /// Up in the world.
    pub(super) sky: DVec3,
    /// In the middle of the picture: a point of the plane of pixels, or the eye.
    origin: DVec3,
    /// Width of a pixel, in units of the world or, in perspective, at distance 1.
    pixel: f64,
    /// Width of a pixel where the box is nearest.
    pub(super) footprint: f64,
    /// Columns and rows.
    size: [f64; 2],
}

/// Share of the picture that the box may fill along an axis.
const FILLED: f64 = 0.92;
/// Tangent of half the angle that the shorter side of a picture has in perspective.
const HALF_ANGLE: f64 = 0.3;

/// Parameters of a camera: see [`RenderRequest`](super::RenderRequest).
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) azimuth: f64,
    pub(super) elevation: f64,
    pub(super) zoom: f64,
    pub(super) projection: CameraProjection,
    pub(super) up: Up,
    pub(super) size: [u64; 2],
}

impl Camera {
    /// A camera that sees all corners of a box.
    ///
    /// # Errors
    /// If a number makes no sense.
    pub(super) fn facing(pose: &Pose, corners: &[DVec3; 8]) -> Result<Camera> {
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
        // By what is to the east, to the north and up.
        let direction = |parts: [f64; 3]| DVec3::from(up.from_z_up(parts));
        let towards = direction([around[0] * elevation.cos(), around[1] * elevation.cos(), elevation.sin()]);
        let right = direction([-around[1], around[0], 0.0]);
        let top = towards.cross(right);
        let sky = direction([0.0, 0.0, 1.0]);
        let middle = corners[0].midpoint(corners[7]);
        // The corners in the camera's axes: right, up, and towards it.
        let corners = corners.map(|corner| [right, top, towards].map(|axis| axis.dot(corner - middle)));
        let size = size.map(|pixels| pixels as f64);
        let nearest = corners.iter().map(|corner| corner[2]).fold(f64::NEG_INFINITY, f64::max);
        let most = |axis: usize| corners.iter().map(|corner| corner[axis].abs()).fold(0.0, f64::max);
        let radius = most(0).max(most(1)).max(most(2)).max(f64::MIN_POSITIVE);
        match projection {
            CameraProjection::Orthographic => {
                let pixel = (0..2).map(|axis| 2.0 * most(axis) / (FILLED * size[axis])).fold(0.0, f64::max);
                let pixel = pixel.max(radius * 1e-9) / zoom;
                let origin = middle + towards * (2.0 * radius);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint: pixel, size })
            }
            CameraProjection::Perspective => {
                let pixel = 2.0 * HALF_ANGLE / size[0].min(size[1]);
                // With the eye at distance d from the middle, a corner is projected to
                // `corner[axis] / (d - corner[2])`, which must not exceed `half`: the largest d that any
                // corner asks for, and in any case outside the box.
                let distance = corners.iter().flat_map(|corner| {
                    (0..2).map(|axis| {
                        let half = FILLED * pixel * size[axis] / 2.0;
                        corner[axis].abs() / half + corner[2]
                    })
                });
                let distance = distance.fold(nearest + 0.1 * radius, f64::max);
                let pixel = pixel / zoom;
                let origin = middle + towards * distance;
                let footprint = pixel * (distance - nearest);
                Ok(Camera { projection, right, top, towards, sky, origin, pixel, footprint, size })
            }
        }
    }

    /// Origin and direction of the ray through a point of the picture, in pixels from its upper left corner.
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
