//! Shaded images and line drawings of solids. Shading traces rays for each pixel through the file
//! as it is on disk.

mod camera;
mod cells;
mod coarse;
mod drawing;
mod exact;
mod paint;
mod scene;

pub use camera::CameraProjection;
pub use cells::render;
pub use drawing::{DrawingFormat, DrawingStyle, draw_cells, draw_exact};
pub use exact::render_exact;

use std::collections::{BTreeSet, VecDeque};

use crate::camera::{Camera, Extent, Pose};
use scene::{PixelColour, Scene, Surface};
use spinney_base::io::Output;
use spinney_base::parallel::{self, Pool};
use spinney_base::space::Up;
use spinney_base::value::{SampleType, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;
use spinney_raster::image::{Format, ImageSpec, create};

/// Size, camera and background of an image of a solid.
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
    /// Magnification: 1 fits the entire solid into the image.
    pub scale: f64,
    /// Projection of the world onto the image.
    pub projection: CameraProjection,
    /// Axis of the world that points up.
    pub up: Up,
    /// Level of detail. By default, shaded images of octrees use the coarsest level whose cells are
    /// no larger than a pixel; those of exact models see [`render_exact`]; for drawings see
    /// [`draw_exact`]. Must be `None` for drawings of the edges of exact models.
    pub level: Option<u8>,
    /// Numbers of the parts of an exact model that are drawn, as if it had no others; `None` for
    /// all. They are drawn without levels of detail, and not as blocks.
    pub parts: Option<BTreeSet<u32>>,
    /// Red, green and blue of the background; `None` makes it transparent.
    pub background: Option<[u8; 3]>,
    /// Samples per pixel along each axis, 1 to 8.
    pub samples: u32,
}

impl RenderRequest {
    /// Request for an image of the given columns and rows, seen from the south-west and above.
    pub fn new(width: u64, height: u64) -> RenderRequest {
        RenderRequest {
            width,
            height,
            azimuth: 215.0,
            elevation: 30.0,
            scale: 1.0,
            projection: CameraProjection::default(),
            up: Up::default(),
            level: None,
            parts: None,
            background: Some([255; 3]),
            samples: 2,
        }
    }

    /// Camera that sees all of `thing`.
    ///
    /// # Errors
    /// If a number of the request is out of range, or the extent of `thing` cannot be measured.
    fn camera(&self, thing: &dyn Extent) -> Result<Camera> {
        let &RenderRequest { width, height, azimuth, elevation, scale, projection, up, .. } = self;
        Camera::facing(&Pose { azimuth, elevation, scale, projection, up, size: [width, height] }, thing)
    }

    /// Refuses a choice of parts, where only `all` can be drawn.
    fn refuse_parts(&self, all: &str) -> Result<()> {
        match self.parts {
            Some(_) => Err(Error::invalid("parts to draw", "some", format!("all, for {all}"))),
            None => Ok(()),
        }
    }

    /// Checks the image size and the number of samples.
    fn check(&self) -> Result<()> {
        let &RenderRequest { width, height, samples, .. } = self;
        if width == 0 || height == 0 || width > MOST || height > MOST {
            let found = format!("{width}x{height}");
            return Err(Error::invalid("size", found, format!("1x1 to {MOST}x{MOST}")));
        }
        if !(1..=8).contains(&samples) {
            return Err(Error::invalid("samples", samples.to_string(), "1 to 8"));
        }
        Ok(())
    }
}

/// Rows rendered in parallel before they are written.
const BAND: u64 = 32;
/// Consecutive rows that one task renders, so that data read for one row serves the next.
const TOGETHER: usize = 8;
/// Maximum width and height in pixels.
const MOST: u64 = 1 << 16;

/// Specification of an image with 8 bits per channel, with an alpha channel unless it is opaque.
fn colours_of(width: u64, height: u64, is_opaque: bool) -> ImageSpec {
    let channels = if is_opaque { 3 } else { 4 };
    ImageSpec {
        width,
        height,
        value: ValueType::new(SampleType::U8, channels),
        alpha: !is_opaque,
        void: false,
        metadata: Metadata::default(),
    }
}

/// Renders a scene and writes the image. `surface` creates the object that traces one thread's
/// rays.
fn draw<'a>(
    scene: &Scene,
    surface: &(dyn Fn() -> Result<Box<dyn Surface + 'a>> + Sync),
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let (width, height) = (scene.width, scene.height);
    let spec = colours_of(width, height, scene.is_opaque);
    let mut writer = create(output, format, &spec)?;
    // Surfaces cache what rays read, so they are reused between rows.
    let pool = Pool::default();
    let mut centres: VecDeque<Vec<PixelColour>> = VecDeque::new();
    for first in (0..height).step_by(BAND as usize) {
        let rows: Vec<u64> = (first..height.min(first + BAND)).collect();
        // Each row needs the centres of the rows above and below it. The last two rows of the
        // previous band are already known.
        let known = first + u64::from(first > 0);
        let new: Vec<u64> = (known..height.min(first + BAND + 1)).collect();
        let new = parallel::map(&new.chunks(TOGETHER).collect::<Vec<_>>(), |rows| {
            let centres =
                |row: &u64| pool.with(surface, |surface| scene.centres(&mut **surface, *row, progress));
            rows.iter().map(centres).collect::<Result<Vec<_>>>()
        });
        for rows in new {
            centres.extend(rows?);
        }
        let before = usize::from(first > 0);
        let rows = parallel::map(&rows.chunks(TOGETHER).collect::<Vec<_>>(), |rows| {
            let row = |row: &u64| {
                let at = (row - first) as usize + before;
                let around = [at.checked_sub(1), Some(at), Some(at + 1)]
                    .map(|row| row.and_then(|row| centres.get(row)).map_or(&[][..], Vec::as_slice));
                pool.with(surface, |surface| scene.row(&mut **surface, *row, around, progress))
            };
            rows.iter().map(row).collect::<Result<Vec<_>>>()
        });
        for rows in rows {
            for row in rows? {
                writer.write_rows(&row, None)?;
                progress.advance(width, width * height);
            }
        }
        let done = centres.len().saturating_sub(2);
        centres.drain(..done);
    }
    writer.finish()
}
