//! Shading: computes an image's pixels from the surface points that rays hit.

use glam::{DVec3, Vec3};

use super::RenderRequest;
use crate::camera::Camera;
use spinney_base::{Progress, Result};
use spinney_style::{to_linear, to_srgb};

/// Surface that rays are traced against. Each thread has its own.
pub(super) trait Surface: Send {
    /// First hit of the ray through an image position, in pixels; `None` if it misses. The ray is
    /// in world coordinates, and its direction has length 1.
    ///
    /// # Errors
    /// If the file is corrupt there.
    fn first(&mut self, at: [f64; 2], origin: DVec3, direction: DVec3) -> Result<Option<SurfacePoint>>;
}

/// Surface point, with what shading needs.
pub(super) struct SurfacePoint {
    /// Surface normal, of length 1.
    pub(super) outwards: DVec3,
    /// Linear red, green and blue.
    pub(super) albedo: DVec3,
    /// Fraction of the sky's light that reaches the point: 1 in the open.
    pub(super) open: f64,
}

/// Colour that the ray through a pixel's centre hits, as square roots of linear light; `None` if it
/// misses.
pub(super) type PixelColour = Option<Vec3>;

/// Difference between neighbouring colours (square roots of linear light, 0 to 1) from which a
/// pixel is supersampled: about 25 of 255 in the image. (A third of this threshold reduces the
/// error of an image of the armadillo model, against 16 samples for every pixel, by only a
/// twentieth, and takes half as long again.)
const UNEVEN: f32 = 0.1;

/// Whether the centres around a pixel are similar to its own.
fn is_even(around: [&[PixelColour]; 3], column: usize) -> bool {
    let own = around[1][column];
    let alike = |other: &PixelColour| match (own, other) {
        (None, None) => true,
        (Some(own), Some(other)) => (own - *other).abs().max_element() < UNEVEN,
        _ => false,
    };
    let columns = column.saturating_sub(1)..column + 2;
    around.iter().flat_map(|row| row.iter().take(columns.end).skip(columns.start)).all(alike)
}

/// Camera, light and background.
pub(super) struct Scene {
    camera: Camera,
    /// Direction to the light.
    light: DVec3,
    background: DVec3,
    /// Bytes of a pixel whose rays all miss.
    empty: Vec<u8>,
    pub(super) is_opaque: bool,
    samples: u32,
    pub(super) width: u64,
    pub(super) height: u64,
}

/// Light: colours of the sky and of the ground, strength of both, strength of the directional
/// light, and of the highlight.
const SKY: DVec3 = DVec3::new(0.86, 0.93, 1.0);
const GROUND: DVec3 = DVec3::new(0.50, 0.46, 0.42);
const AMBIENT: f64 = 0.50;
const HEAD: f64 = 0.92;
const HIGHLIGHT: f64 = 0.06;
/// Pixels between checks for cancellation.
const CHECKED: u64 = 64;

impl Scene {
    pub(super) fn new(camera: Camera, request: &RenderRequest) -> Scene {
        let light = camera.light();
        let background =
            request.background.unwrap_or([0; 3]).map(|sample| to_linear(f64::from(sample) / 255.0));
        Scene {
            camera,
            light,
            background: background.into(),
            empty: request.background.map_or(vec![0; 4], |background| background.to_vec()),
            is_opaque: request.background.is_some(),
            samples: request.samples,
            width: request.width,
            height: request.height,
        }
    }

    /// Traces the rays through the centres of a row's pixels.
    pub(super) fn centres(
        &self,
        surface: &mut dyn Surface,
        row: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<PixelColour>> {
        let mut centres = Vec::with_capacity(self.width as usize);
        for column in 0..self.width {
            if column % CHECKED == 0 {
                progress.check()?;
            }
            let colour = self.colour(surface, [column as f64 + 0.5, row as f64 + 0.5])?;
            centres.push(colour.map(|colour| colour.as_vec3().map(f32::sqrt)));
        }
        Ok(centres)
    }

    /// Pixels of a row, given the centres of the row above, of this row and of the row below. A
    /// pixel whose neighbourhood is uniform takes its centre's colour; all others are supersampled
    /// as requested.
    pub(super) fn row(
        &self,
        surface: &mut dyn Surface,
        row: u64,
        around: [&[PixelColour]; 3],
        progress: &dyn Progress,
    ) -> Result<Vec<u8>> {
        let mut pixels = Vec::with_capacity(self.width as usize * 4);
        for column in 0..self.width {
            if column % CHECKED == 0 {
                progress.check()?;
            }
            let (sum, share) = if self.samples > 1 && !is_even(around, column as usize) {
                self.sampled(surface, [column, row])?
            } else {
                match around[1][column as usize] {
                    Some(root) => ((root * root).as_dvec3(), 1.0),
                    None => (DVec3::ZERO, 0.0),
                }
            };
            if share == 0.0 {
                pixels.extend_from_slice(&self.empty);
            } else if self.is_opaque {
                let colour = sum + self.background * (1.0 - share);
                pixels.extend(colour.to_array().map(to_srgb));
            } else {
                pixels.extend((sum / share).to_array().map(to_srgb));
                pixels.push((share * 255.0 + 0.5) as u8);
            }
        }
        Ok(pixels)
    }

    /// Mean colour of a pixel's samples, with misses as black, and the fraction of samples that
    /// hit.
    fn sampled(&self, surface: &mut dyn Surface, [column, row]: [u64; 2]) -> Result<(DVec3, f64)> {
        let (mut sum, mut covered) = (DVec3::ZERO, 0.0);
        for sample in 0..self.samples * self.samples {
            let offset = |number: u32| (f64::from(number) + 0.5) / f64::from(self.samples);
            let (across, down) = (offset(sample % self.samples), offset(sample / self.samples));
            if let Some(colour) = self.colour(surface, [column as f64 + across, row as f64 + down])? {
                sum += colour;
                covered += 1.0;
            }
        }
        let count = f64::from(self.samples * self.samples);
        Ok((sum / count, covered / count))
    }

    /// Linear colour at an image position, in pixels; `None` if the ray misses.
    fn colour(&self, surface: &mut dyn Surface, point: [f64; 2]) -> Result<Option<DVec3>> {
        let (origin, direction) = self.camera.ray(point);
        let Some(SurfacePoint { outwards, albedo, open }) = surface.first(point, origin, direction)? else {
            return Ok(None);
        };
        let back = -direction;
        let up = 0.5 + 0.5 * outwards.dot(self.camera.sky);
        let lit = outwards.dot(self.light).max(0.0);
        let half = (self.light + back).normalize_or(back);
        let highlight = HIGHLIGHT * outwards.dot(half).max(0.0).powi(40) * open;
        let light = GROUND.lerp(SKY, up) * (AMBIENT * open) + HEAD * lit * (0.35 + 0.65 * open);
        Ok(Some(albedo * light + highlight))
    }
}
