//! Shaded images of solids in octrees.

use glam::{DMat3, DVec3};

use super::scene::{Scene, Surface, SurfacePoint};
use super::{RenderRequest, draw};
use crate::camera::{Extent, box_support, farthest};
use crate::paint::Paint;
use spinney_base::io::Output;
use spinney_base::space::Bounds;
use spinney_base::{Error, Progress, Result};
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_engine::query::{PointSamples, Ray, Rays, SurfaceHit};
use spinney_raster::image::Format;

/// Deepest level at which a solid's bounding box is computed.
pub(super) const BOX_LEVEL: u8 = 6;

/// Writes a shaded image of an octree's solid, and returns the level that was rendered.
///
/// The surface is the isosurface where the occupancy between cells' centres is one half; normals
/// are gradients of the occupancy. Light comes from over the viewer's left shoulder and from the
/// sky. Hollows receive less light (ambient occlusion from the densities above the surface, as in
/// Evans: Fast approximations for global illumination on dynamic scenes, SIGGRAPH 2006 courses).
/// Trees with three or more channels have their own colours, occupancy trees that of clay. Other
/// trees use their palette if they have one, otherwise distinct colours for categorical values and
/// a colour ramp over the value range for continuous values.
///
/// Only nodes that rays hit are read, and none below the level. The image does not depend on the
/// number of threads.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::raw::export::image::Format;
/// use spinney::export::{RenderRequest, render};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("ball.png");
/// let ball = spinney::open("fixtures/v1/ball.goblin")?;
/// let request = RenderRequest::new(40, 30);
/// assert_eq!(render(&ball, &request, Output::create(&path)?, Format::Png, &())?, 5);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the tree is a quadtree or has no such level, a number of the request is out of range, the
/// format cannot store 8-bit colours, the tree is corrupt, or on cancellation.
pub fn render(
    tree: &Dataset,
    request: &RenderRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<u8> {
    request.check()?;
    request.refuse_parts("trees of cells")?;
    let depth = tree.depth();
    let rough = tree.solid(request.level.unwrap_or(depth).min(BOX_LEVEL).min(depth), progress)?;
    let space = Bounds { min: [0; 3], max: [1 << rough.level; 3] };
    let bounds = rough.bounds.unwrap_or(space);
    let camera = request.camera(&FilledCells::new(tree, rough.frame(), &bounds))?;
    let level = match request.level {
        Some(level) if level <= depth => level,
        Some(level) => return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}"))),
        None => (0..=depth)
            .find(|level| cell_size(&tree.metadata().frame.coarser(depth - level)) <= camera.footprint)
            .unwrap_or(depth),
    };
    let radius = bounds.size().into_iter().max().unwrap_or(1) as f64 / 2.0
        * 2f64.powi(i32::from(level) - i32::from(rough.level));
    let cells = Cells::new(tree, level, radius)?;
    let make = || -> Result<Box<dyn Surface + '_>> {
        Ok(Box::new(CellSurface { cells: &cells, rays: tree.rays(level)? }))
    };
    draw(&Scene::new(camera, request), &make, output, format, progress)?;
    tree.check_unchanged()?;
    Ok(level)
}

/// All cells of an octree that are not VOID.
pub(super) struct FilledCells<'a> {
    tree: &'a Dataset,
    corners: [DVec3; 2],
    /// Level at which cells are small enough to measure the extent.
    finest: u8,
}

/// Minimum number of cells along a solid's longest side at the level that measures its extent.
const FINE: f64 = 512.0;

impl<'a> FilledCells<'a> {
    /// Cells of a tree, all within `bounds`, which are in cells of `frame`.
    pub(super) fn new(tree: &'a Dataset, frame: &Frame, bounds: &Bounds) -> FilledCells<'a> {
        let [low, high] = frame.world_box(bounds).map(DVec3::from);
        let width = (high - low).max_element() / FINE;
        let (depth, own) = (tree.depth(), &tree.metadata().frame);
        let is_fine = |level: &u8| cell_size(&own.coarser(depth - level)) <= width;
        FilledCells { tree, corners: [low, high], finest: (0..depth).find(is_fine).unwrap_or(depth) }
    }
}

impl Extent for FilledCells<'_> {
    fn corners(&self) -> [DVec3; 2] {
        self.corners
    }

    fn support(&self, direction: DVec3) -> Result<f64> {
        let depth = self.tree.depth();
        let reach = |level: u8, cell: &[u64; 3]| {
            let bounds = Bounds { min: *cell, max: cell.map(|at| at + 1) };
            let frame = self.tree.metadata().frame.coarser(depth - level);
            box_support(frame.world_box(&bounds).map(DVec3::from), direction)
        };
        let divide = |(level, cell): &(u8, [u64; 3])| {
            if *level == self.finest {
                return Ok(None);
            }
            let child = |number: u64| [0, 1, 2].map(|axis| 2 * cell[axis] + (number >> axis & 1));
            let (children, below) = ((0..8).map(child).collect::<Vec<_>>(), level + 1);
            let mut samples = PointSamples::default();
            self.tree.points(&children, below, &mut samples)?;
            let filled = children.iter().enumerate().filter(|(index, _)| samples.get(*index).is_some());
            Ok(Some(filled.map(|(_, cell)| (reach(below, cell), (below, *cell))).collect()))
        };
        let found = farthest(f64::INFINITY, (0, [0; 3]), &divide)?.filter(|found| found.is_finite());
        Ok(found.unwrap_or(box_support(self.corners, direction)))
    }
}

/// Edge length of the cube with a cell's volume, in world units.
pub(super) fn cell_size(frame: &Frame) -> f64 {
    frame.linear().determinant().abs().cbrt()
}

/// Cells of one level, with their georeferencing and colours.
struct Cells {
    paint: Paint,
    /// Map from cells of the level to the world.
    frame: Frame,
    /// Map from directions in the world to directions in cells.
    to_cells: DMat3,
    /// Map from gradients in cells to directions in the world.
    normals: DMat3,
    /// Half the longest side of the solid's bounding box, in cells of the level.
    radius: f64,
}

/// Distances from the surface at which densities are sampled for ambient occlusion, as fractions of
/// the solid's radius.
const OCCLUSION: [f64; 4] = [0.012, 0.03, 0.07, 0.15];

impl Cells {
    fn new(tree: &Dataset, level: u8, radius: f64) -> Result<Cells> {
        let frame = tree.metadata().frame.coarser(tree.depth() - level);
        let linear = frame.linear();
        let [a, b, c] = frame.face_areas();
        let normals = DMat3::from_cols(a, b, c) * linear.determinant().signum();
        Ok(Cells { paint: Paint::of(tree)?, frame, to_cells: linear.inverse(), normals, radius })
    }
}

/// Smooth surface interpolated from cells.
struct CellSurface<'a> {
    cells: &'a Cells,
    rays: Box<dyn Rays + 'a>,
}

impl Surface for CellSurface<'_> {
    fn first(&mut self, _: [f64; 2], origin: DVec3, direction: DVec3) -> Result<Option<SurfacePoint>> {
        let Cells { paint, frame, to_cells, normals, .. } = self.cells;
        let no_inverse =
            || Error::invalid("the file's transform", "a map that is not invertible", "an invertible one");
        let ray = Ray {
            origin: frame.to_cells(origin.to_array()).ok_or_else(no_inverse)?,
            direction: (*to_cells * direction).to_array(),
        };
        let Some(hit) = self.rays.surface(&ray)? else { return Ok(None) };
        let inwards = DVec3::from(hit.inwards);
        let outwards = (*normals * -inwards).try_normalize().unwrap_or(-direction);
        let open = self.openness(&hit)?;
        let albedo = match paint {
            Paint::Clay(colour) => *colour,
            paint => paint.colour(&self.rays.value(hit.cell)?),
        };
        Ok(Some(SurfacePoint { outwards, albedo: albedo.into(), open }))
    }
}

impl CellSurface<'_> {
    /// Fraction of the sky's light that reaches a surface point: 1 in the open.
    fn openness(&mut self, hit: &SurfaceHit) -> Result<f64> {
        let Some(outwards) = (-DVec3::from(hit.inwards)).try_normalize() else { return Ok(1.0) };
        let (aside, across) = outwards.any_orthonormal_pair();
        let (mut hidden, mut most) = (0.0, 0.0);
        // Alternate between two axes: occlusion changes little from one distance to the next.
        for (index, distance) in OCCLUSION.into_iter().enumerate() {
            let weight = 1.0 / (1.0 + 6.0 * distance);
            // Below 1.5 cells, the density is that of the surface itself.
            let distance = (distance * self.cells.radius).max(1.5);
            let lean = 0.8 * if index % 2 == 0 { aside } else { across };
            for direction in [outwards + lean, outwards - lean] {
                hidden +=
                    weight * self.rays.density((DVec3::from(hit.point) + distance * direction).to_array())?;
                most += weight;
            }
        }
        let open = 1.0 - 1.3 * hidden / most;
        Ok(open.clamp(0.15, 1.0))
    }
}
