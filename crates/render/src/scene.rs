//! Light and shade: the colours of a picture's pixels, whatever it is that rays meet.

use glam::{DVec3, Vec3};

use super::RenderRequest;
use crate::camera::Camera;
use spinney_base::{Progress, Result};
use spinney_style::{to_linear, to_srgb};

/// Something that rays meet. Each thread has its own.
pub(super) trait Surface: Send {
    /// The first hit of a ray in the world, the direction having length 1; `None` if it meets nothing.
    ///
    /// # Errors
    /// If the file is damaged there.
    fn first(&mut self, origin: DVec3, direction: DVec3) -> Result<Option<Place>>;
}

/// A place of a surface, as the light finds it.
pub(super) struct Place {
    /// The surface's normal, of length 1.
    pub(super) outwards: DVec3,
    /// Linear red, green and blue.
    pub(super) albedo: DVec3,
    /// Share of the sky's light that reaches it: 1 in the open.
    pub(super) open: f64,
}

/// Colour that a ray through the centre of a pixel meets, as roots of linear light, or nothing.
pub(super) type Centre = Option<Vec3>;

/// Difference of neighbours' colours, as roots of linear light from 0 to 1, from which on a pixel is looked at more closely: a step of about
/// 25 of 255 in the picture. (With a third of it, the picture of an armadillo is no nearer to one with 16 samples of each pixel than by a
/// twentieth of the error, and takes half as long again.)
const UNEVEN: f32 = 0.1;

/// Whether the centres around a pixel look like its own.
fn is_even(around: [&[Centre]; 3], column: usize) -> bool {
    let own = around[1][column];
    let alike = |other: &Centre| match (own, other) {
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
    /// A pixel in which nothing is met.
    empty: Vec<u8>,
    pub(super) is_opaque: bool,
    samples: u32,
    pub(super) width: u64,
    pub(super) height: u64,
}

/// Colours of the light from above and from below, and how strong it is; the head light's; the highlight's.
const SKY: DVec3 = DVec3::new(0.86, 0.93, 1.0);
const GROUND: DVec3 = DVec3::new(0.50, 0.46, 0.42);
const AMBIENT: f64 = 0.50;
const HEAD: f64 = 0.92;
const HIGHLIGHT: f64 = 0.06;
/// Pixels between looks whether to go on.
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

    /// Colours that rays through the centres of a row's pixels meet.
    pub(super) fn centres(
        &self,
        surface: &mut dyn Surface,
        row: u64,
        progress: &dyn Progress,
    ) -> Result<Vec<Centre>> {
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

    /// The pixels of a row, given the centres of the row above, its own and those below: what looks alike all around a pixel has its
    /// centre's colour, all else that of so many samples as were asked for.
    pub(super) fn row(
        &self,
        surface: &mut dyn Surface,
        row: u64,
        around: [&[Centre]; 3],
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

    /// The mean colour of a pixel's samples, black where nothing is met, and the share of them that meet something.
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

    /// Linear colour at a point of the picture, in pixels; `None` where no surface is hit.
    fn colour(&self, surface: &mut dyn Surface, point: [f64; 2]) -> Result<Option<DVec3>> {
        let (origin, direction) = self.camera.ray(point);
        let Some(Place { outwards, albedo, open }) = surface.first(origin, direction)? else {
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
