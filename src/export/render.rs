//! Shaded pictures of solids: a ray per sample of a pixel through the tree as it is on disk.

use glam::{DMat3, DVec3};

use super::camera::{Camera, Pose, Projection};
use super::image::{Format, ImageSpec, create};
use super::paint::{Paint, to_linear, to_srgb};
use crate::dataset::Dataset;
use crate::io::Output;
use crate::parallel::{self, Pool};
use crate::query::{Ray, Rays, SurfaceHit};
use crate::space::{Bounds, Frame, Up};
use crate::store::Metadata;
use crate::value::{SampleType, ValueType};
use crate::{Error, Progress, Result};

/// Size, camera and background of a picture of a solid.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RenderRequest {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Direction from the solid to the viewer, in degrees on a compass: 0 is north, 90 is east.
    pub azimuth: f64,
    /// Angle of the viewer above the horizon, in degrees: at 90 the view is straight down.
    pub elevation: f64,
    /// Magnification: 1 fits all of the solid into the picture.
    pub zoom: f64,
    /// Projection of the world onto the picture.
    pub projection: Projection,
    /// The axis of the world that points up.
    pub up: Up,
    /// Level of detail; by default the coarsest whose cells are no larger than a pixel.
    pub level: Option<u8>,
    /// Red, green and blue behind the solid; nothing makes the picture transparent there.
    pub background: Option<[u8; 3]>,
    /// Samples of a pixel along each axis, 1 to 8.
    pub samples: u32,
}

impl RenderRequest {
    /// A picture of so many columns and rows, from the south-west and above.
    pub fn new(width: u64, height: u64) -> RenderRequest {
        RenderRequest {
            width,
            height,
            azimuth: 215.0,
            elevation: 30.0,
            zoom: 1.0,
            projection: Projection::default(),
            up: Up::default(),
            level: None,
            background: Some([255; 3]),
            samples: 2,
        }
    }
}

/// Rows that are made before they are written.
const BAND: u64 = 32;
/// Deepest level at which the box around a solid is computed.
const BOX_LEVEL: u8 = 6;
/// Pixels that a row may have.
const MOST: u64 = 1 << 16;

/// Writes a shaded picture of an octree's solid, and returns the level that was drawn.
///
/// The surface is where the occupancy between cells' centres is one half; its normals come from the gradient
/// around. Light comes from over the viewer's left shoulder and from the sky, and less of it reaches hollows
/// (as in Evans: Fast approximations for global illumination on dynamic scenes, SIGGRAPH 2006 courses, from
/// the densities above the surface). Colours are those of trees with three channels, of the palette where
/// values are classes, and of the range of all values where they are amounts; solids are the colour of clay.
///
/// Only nodes that rays meet are read, and nothing below the level. The picture does not depend on the number
/// of threads.
///
/// ```
/// use spinney::export::image::Format;
/// use spinney::export::{RenderRequest, render};
/// use spinney::io::Output;
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("ball.png");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// let request = RenderRequest::new(40, 30);
/// assert_eq!(render(&ball, &request, Output::create(&path)?, Format::Png, &())?, 5);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree or has no such level, a number of the request makes no sense, the format cannot
/// hold colours of 8 bits, the tree is damaged, or on interruption.
pub fn render(
    tree: &Dataset,
    request: &RenderRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<u8> {
    let &RenderRequest { width, height, azimuth, elevation, zoom, projection, up, .. } = request;
    if width == 0 || height == 0 || width > MOST || height > MOST {
        let found = format!("{width}x{height}");
        return Err(Error::invalid("size", found, format!("1x1 to {MOST}x{MOST}")));
    }
    if !(1..=8).contains(&request.samples) {
        return Err(Error::invalid("samples", request.samples.to_string(), "1 to 8"));
    }
    let depth = tree.depth();
    let rough = tree.solid(request.level.unwrap_or(depth).min(BOX_LEVEL).min(depth), progress)?;
    let space = Bounds { min: [0; 3], max: [1 << rough.level; 3] };
    let bounds = rough.bounds.unwrap_or(space);
    let corners = std::array::from_fn(|corner| {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
        DVec3::from(rough.frame().to_world(std::array::from_fn(|axis| pick(axis) as f64)))
    });
    let pose = Pose { azimuth, elevation, zoom, projection, up, size: [width, height] };
    let camera = Camera::facing(&pose, &corners)?;
    let level = match request.level {
        Some(level) if level <= depth => level,
        Some(level) => return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}"))),
        None => (0..=depth)
            .find(|level| cell_size(&tree.metadata().frame.coarser(depth - level)) <= camera.footprint)
            .unwrap_or(depth),
    };
    let radius = bounds.size().into_iter().max().unwrap_or(1) as f64 / 2.0
        * 2f64.powi(i32::from(level) - i32::from(rough.level));
    let scene = Scene::new(tree, camera, level, radius, request)?;
    let channels = if request.background.is_some() { 3 } else { 4 };
    let spec = ImageSpec {
        width,
        height,
        value: ValueType::new(SampleType::U8, channels),
        alpha: channels == 4,
        void: false,
        metadata: Metadata::default(),
    };
    let mut writer = create(output, format, &spec)?;
    // Rays remember where they were: what one row has read serves another.
    let pool = Pool::new();
    for first in (0..height).step_by(BAND as usize) {
        let rows: Vec<u64> = (first..height.min(first + BAND)).collect();
        let rows = parallel::map(&rows, |row| {
            progress.check()?;
            pool.with(|| tree.rays(level), |rays| scene.row(&mut **rays, *row))
        });
        for row in rows {
            writer.write_rows(&row?, None)?;
            progress.advance(width, width * height);
        }
    }
    tree.check_unchanged()?;
    writer.finish()?;
    Ok(level)
}

/// Edge of the cube that is as large as a cell, in the world.
fn cell_size(frame: &Frame) -> f64 {
    frame.linear().determinant().abs().cbrt()
}

struct Scene {
    camera: Camera,
    paint: Paint,
    /// Map from cells of the level to the world.
    frame: Frame,
    /// Map from directions in the world to those in cells.
    to_cells: DMat3,
    /// Map from gradients in cells to directions in the world.
    normals: DMat3,
    /// Half the longest side of the box around the solid, in cells of the level.
    radius: f64,
    /// Direction to the light.
    light: DVec3,
    background: DVec3,
    is_opaque: bool,
    samples: u32,
    width: u64,
}

/// Colours of the light from above and from below, and how strong it is; the head light's; the highlight's.
const SKY: DVec3 = DVec3::new(0.86, 0.93, 1.0);
const GROUND: DVec3 = DVec3::new(0.50, 0.46, 0.42);
const AMBIENT: f64 = 0.50;
const HEAD: f64 = 0.92;
const HIGHLIGHT: f64 = 0.06;
/// Distances from the surface at which densities are sampled for ambient occlusion, in parts of the solid's
/// radius.
const OCCLUSION: [f64; 4] = [0.012, 0.03, 0.07, 0.15];

impl Scene {
    fn new(tree: &Dataset, camera: Camera, level: u8, radius: f64, request: &RenderRequest) -> Result<Scene> {
        let frame = tree.metadata().frame.coarser(tree.depth() - level);
        let linear = frame.linear();
        let [a, b, c] = frame.face_areas();
        let normals = DMat3::from_cols(a, b, c) * linear.determinant().signum();
        let light = (camera.towards + 0.55 * camera.top - 0.5 * camera.right).normalize();
        let background =
            request.background.unwrap_or([0; 3]).map(|sample| to_linear(f64::from(sample) / 255.0));
        Ok(Scene {
            camera,
            paint: Paint::of(tree)?,
            frame,
            to_cells: linear.inverse(),
            normals,
            radius,
            light,
            background: background.into(),
            is_opaque: request.background.is_some(),
            samples: request.samples,
            width: request.width,
        })
    }

    /// The pixels of a row.
    fn row(&self, rays: &mut dyn Rays, row: u64) -> Result<Vec<u8>> {
        let mut pixels = Vec::with_capacity(self.width as usize * 4);
        let count = f64::from(self.samples * self.samples);
        for column in 0..self.width {
            let (mut sum, mut covered) = (DVec3::ZERO, 0.0);
            for sample in 0..self.samples * self.samples {
                let offset = |number: u32| (f64::from(number) + 0.5) / f64::from(self.samples);
                let (across, down) = (offset(sample % self.samples), offset(sample / self.samples));
                if let Some(colour) = self.colour(rays, [column as f64 + across, row as f64 + down])? {
                    sum += colour;
                    covered += 1.0;
                }
            }
            let share = covered / count;
            if self.is_opaque {
                let colour = sum / count + self.background * (1.0 - share);
                pixels.extend(colour.to_array().map(to_srgb));
            } else {
                let colour = if covered > 0.0 { sum / covered } else { DVec3::ZERO };
                pixels.extend(colour.to_array().map(to_srgb));
                pixels.push((share * 255.0 + 0.5) as u8);
            }
        }
        Ok(pixels)
    }

    /// Linear colour at a point of the picture, in pixels; `None` where no surface is hit.
    fn colour(&self, rays: &mut dyn Rays, point: [f64; 2]) -> Result<Option<DVec3>> {
        let (origin, direction) = self.camera.ray(point);
        let no_inverse = || Error::invalid("the file's transform", "one without an inverse", "one with");
        let ray = Ray {
            origin: self.frame.to_cells(origin.to_array()).ok_or_else(no_inverse)?,
            direction: (self.to_cells * direction).to_array(),
        };
        let Some(hit) = rays.surface(&ray)? else { return Ok(None) };
        let back = -direction;
        let inwards = DVec3::from(hit.inwards);
        let outwards = (self.normals * -inwards).try_normalize().unwrap_or(back);
        let open = self.openness(rays, &hit)?;
        let albedo = DVec3::from(self.paint.colour(&hit.value));
        let up = 0.5 + 0.5 * outwards.dot(self.camera.sky);
        let lit = outwards.dot(self.light).max(0.0);
        let half = (self.light + back).normalize_or(back);
        let highlight = HIGHLIGHT * outwards.dot(half).max(0.0).powi(40) * open;
        let light = GROUND.lerp(SKY, up) * (AMBIENT * open) + HEAD * lit * (0.35 + 0.65 * open);
        Ok(Some(albedo * light + highlight))
    }

    /// Share of the sky's light that reaches a point of the surface: 1 in the open.
    fn openness(&self, rays: &mut dyn Rays, hit: &SurfaceHit) -> Result<f64> {
        let Some(outwards) = (-DVec3::from(hit.inwards)).try_normalize() else { return Ok(1.0) };
        let (aside, across) = outwards.any_orthonormal_pair();
        let (mut hidden, mut most) = (0.0, 0.0);
        for distance in OCCLUSION {
            let weight = 1.0 / (1.0 + 6.0 * distance);
            // At less than 1.5 cells the density is that of the surface itself.
            let distance = (distance * self.radius).max(1.5);
            for (u, v) in [(0.8, 0.0), (-0.8, 0.0), (0.0, 0.8), (0.0, -0.8)] {
                let direction = outwards + u * aside + v * across;
                hidden +=
                    weight * rays.density((DVec3::from(hit.point) + distance * direction).to_array())?;
                most += weight;
            }
        }
        let open = 1.0 - 1.3 * hidden / most;
        Ok(open.clamp(0.15, 1.0))
    }
}
