//! Shaded images of exact models.

use glam::DVec3;

use super::coarse::{CoarseSurface, MAX_TRIANGLES};
use super::scene::{Scene, Surface, SurfacePoint};
use super::{RenderRequest, draw};
use crate::camera::{Camera, Extent, box_support, farthest};
use crate::paint::{Paint, linear};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::query::{ModelRays, SurfaceDetail};
use spinney_brep::{ExactModel, Face, FaceBuffer, Faces as _, ModelNode, ModelNodeState};
use spinney_raster::image::Format;

/// Writes a shaded image of an exact model. Returns the largest distance in the world between what
/// is drawn and the exact surface: 0 if it is the exact surface.
///
/// If the model has levels of detail, the surface is drawn that is at most a pixel off, with
/// smooth shading where faces meet at small angles, or a level that is requested. Otherwise, or if
/// that surface has more than 1,500,000 triangles, rays are traced through the exact surface: its
/// faces are unchanged, each with its own normal, and only nodes and faces along the rays are read.
///
/// If parts are chosen, rays are traced through the exact surface of these.
///
/// Camera, light and background are those of [`render`](super::render), without ambient occlusion.
/// A model without colours has the colour of clay. The image does not depend on the number of
/// threads.
///
/// # Errors
/// If the model has no such level, or it has more than 1,500,000 triangles, a number of the request
/// is out of range, the format cannot store 8-bit colours, the file is corrupt, or on cancellation.
pub fn render_exact(
    model: &ExactModel,
    request: &RenderRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<f64> {
    request.check()?;
    let (corners, camera) = view_of(model, request, progress)?;
    let clay = Paint::clay().colour(&[0.0; 4]).into();
    let coarse = coarse(model, request, &camera, clay, progress)?;
    let scene = Scene::new(camera, request);
    let make = || -> Result<Box<dyn Surface + '_>> {
        Ok(match &coarse {
            Some((surface, _)) => Box::new(surface),
            None => {
                let rays = match &request.parts {
                    Some(parts) => model.rays_of_parts(parts),
                    None => model.rays(),
                };
                Box::new(Body { model, corners, rays, clay })
            }
        })
    };
    draw(&scene, &make, output, format, progress)?;
    model.check_unchanged()?;
    Ok(coarse.map_or(0.0, |(_, error)| error))
}

/// Returns the box around what a request draws, and a camera that sees it.
pub(super) fn view_of(
    model: &ExactModel,
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<([DVec3; 2], Camera)> {
    let Some(parts) = &request.parts else {
        let corners = model.bounds()?.map(DVec3::from);
        return Ok((corners, request.camera(&Solid { model, corners })?));
    };
    let none = || Error::invalid("parts to draw", "parts without faces", "at least one with faces");
    let corners = model.bounds_of_parts(parts, progress)?.ok_or_else(none)?.map(DVec3::from);
    Ok((corners, request.camera(&PartsBox(corners))?))
}

/// Box around some parts of a model.
struct PartsBox([DVec3; 2]);

impl Extent for PartsBox {
    fn corners(&self) -> [DVec3; 2] {
        self.0
    }

    fn support(&self, direction: DVec3) -> Result<f64> {
        Ok(box_support(self.0, direction))
    }
}

/// Distance between the drawn surface and the exact one, in pixels.
const OFF: f64 = 1.0;

/// Returns the coarse surface that a request needs, and its distance from the exact one; `None` if
/// it needs the exact surface.
fn coarse(
    model: &ExactModel,
    request: &RenderRequest,
    camera: &Camera,
    clay: DVec3,
    progress: &dyn Progress,
) -> Result<Option<(CoarseSurface, f64)>> {
    if request.parts.is_some() {
        return match request.level {
            None => Ok(None),
            Some(level) => Err(Error::invalid("level", level.to_string(), "none for some parts of a model")),
        };
    }
    let detail = match request.level {
        Some(level) => SurfaceDetail::Level(level),
        // (Only triangles that face the camera are drawn. It is inside of an unbounded body.)
        None if model.levels().is_empty() || model.is_unbounded() => return Ok(None),
        None => SurfaceDetail::Error(OFF * camera.footprint),
    };
    let surface = model.surface(detail, None, progress)?;
    if surface.is_exact() {
        return Ok(None);
    }
    let size = [request.width, request.height];
    let found = match surface.len() <= MAX_TRIANGLES {
        true => CoarseSurface::of(&surface, camera, size, clay, progress)?,
        false => None,
    };
    if found.is_none() && request.level.is_some() {
        let advice = "render a coarser level, or omit the level";
        return Err(Error::unsupported(model.path(), "a level with too many triangles for an image", advice));
    }
    Ok(found.map(|found| (found, surface.error())))
}

/// Minimum number of nodes along a solid's longest side where its extent is measured.
const FINE: f64 = 512.0;

/// Closure of a solid: its interior and its boundary.
pub(super) struct Solid<'a> {
    pub(super) model: &'a ExactModel,
    pub(super) corners: [DVec3; 2],
}

impl<'a> Extent for Solid<'a> {
    fn corners(&self) -> [DVec3; 2] {
        self.corners
    }

    fn support(&self, direction: DVec3) -> Result<f64> {
        let [low, high] = self.corners;
        let width = (high - low).max_element() / FINE;
        let space = |node: &ModelNode<'a>| {
            node.world_box(self.model.grid()).map(|corner| DVec3::from(corner).clamp(low, high))
        };
        let divide = |node: &ModelNode<'a>| {
            let [min, max] = space(node);
            if (max - min).max_element() <= width {
                return Ok(None);
            }
            let Some(parts) = self.model.children(node)? else { return Ok(None) };
            let mut bounds = Vec::new();
            for part in parts {
                match part.state() {
                    ModelNodeState::Void => {}
                    ModelNodeState::Leaf { .. } => bounds.push((self.reach(&part, direction)?, part)),
                    _ => bounds.push((box_support(space(&part), direction), part)),
                }
            }
            Ok(Some(bounds))
        };
        let found = farthest(f64::INFINITY, self.model.root()?, &divide)?.filter(|found| found.is_finite());
        Ok(found.unwrap_or(box_support(self.corners, direction)))
    }
}

impl Solid<'_> {
    /// Support of the vertices of a leaf's faces. (Vertices may lie outside of the leaf, but are
    /// always the solid's own.)
    fn reach(&self, leaf: &ModelNode<'_>, direction: DVec3) -> Result<f64> {
        let (mut buffer, mut reach) = (FaceBuffer::default(), f64::NEG_INFINITY);
        for number in leaf.faces() {
            self.model.face(number, &mut buffer)?;
            for point in buffer.face().points {
                reach = reach.max(DVec3::from(self.model.grid().to_world(*point)).dot(direction));
            }
        }
        Ok(reach)
    }
}

/// Solid that a model bounds.
struct Body<'a> {
    model: &'a ExactModel,
    /// Minimum and maximum coordinates of its bounding box.
    corners: [DVec3; 2],
    rays: ModelRays<'a>,
    /// Linear colour of faces without a colour.
    clay: DVec3,
}

impl Surface for Body<'_> {
    fn first(&mut self, _: [f64; 2], origin: DVec3, direction: DVec3) -> Result<Option<SurfacePoint>> {
        if !may_meet(self.corners, origin, direction) {
            return Ok(None);
        }
        let Some(hit) = self.rays.first(origin.to_array(), direction.to_array())? else { return Ok(None) };
        let (face, normal) = self.rays.face(hit.face)?;
        let outwards = DVec3::from(normal.map(|at| at as f64)).try_normalize().unwrap_or(-direction);
        let albedo = match face.colours {
            [] => self.clay,
            _ => colour_at(&face, self.model.grid().to_grid(hit.point).into()),
        };
        Ok(Some(SurfacePoint { outwards, albedo, open: 1.0 }))
    }
}

/// Margin around a bounding box, as a fraction of its width, for ray tests. It is much larger than
/// the rounding errors of doubles between eye, world and grid.
const AROUND: f64 = 1e-6;

/// Whether a ray may meet a box or its margin. Rays that miss skip the exact test.
fn may_meet([low, high]: [DVec3; 2], origin: DVec3, direction: DVec3) -> bool {
    let around = (high - low) * AROUND + DVec3::splat(f64::MIN_POSITIVE);
    let [a, b] = [low - around, high + around].map(|corner| (corner - origin) / direction);
    // A ray within the plane of a box's side gives 0 / 0, which is NaN; `min` and `max` ignore it.
    let (enters, leaves) = (0..3).fold((0.0f64, f64::INFINITY), |(enters, leaves), axis| {
        (enters.max(a[axis].min(b[axis])), leaves.min(a[axis].max(b[axis])))
    });
    enters <= leaves
}

/// Linear colour of a face at a point: interpolated between a triangle's vertices, the vertices'
/// mean for other faces.
fn colour_at(face: &Face<'_>, position: DVec3) -> DVec3 {
    let colours: Vec<DVec3> = face.colours.iter().map(|colour| linear(*colour).into()).collect();
    if let ([a, b, c], [first, second, third]) = (face.points, &colours[..]) {
        let [a, b, c] = [a, b, c].map(|point| DVec3::from(point.map(f64::from)) - position);
        let weights = [b.cross(c).length(), c.cross(a).length(), a.cross(b).length()];
        let sum: f64 = weights.iter().sum();
        if sum > 0.0 {
            return (weights[0] * first + weights[1] * second + weights[2] * third) / sum;
        }
    }
    colours.iter().sum::<DVec3>() / colours.len().max(1) as f64
}
