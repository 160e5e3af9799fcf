//! Line drawings of solids: all edges, visible edges only, or the blocks of octrees.
//!
//! A drawing is a list of flat polygons and lines from back to front (`marks.rs`), painted in that
//! order: the painter's algorithm. `edges.rs` finds the edges of exact models, `faces.rs` sorts
//! their faces with a BSP tree, and `octants.rs` sorts the blocks of octrees. `svg.rs` and
//! `painter.rs` write the list as SVG or pixels.

mod edges;
mod faces;
mod marks;
mod octants;
mod painter;
mod svg;

use glam::DVec3;

use self::marks::Marks;
use crate::RenderRequest;
use crate::camera::Camera;
use crate::exact::view_of;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::ExactModel;
use spinney_engine::dataset::Dataset;
use spinney_raster::image::Format;

/// Style of a line drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawingStyle {
    /// All edges of an exact model.
    Wireframe,
    /// Visible edges of an exact model.
    HiddenLines,
    /// Blocks of an exact model's octree, or of an octree of cells.
    Octants,
}

/// File format of a drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawingFormat {
    /// Paths in SVG 1.1.
    Svg,
    /// Pixels.
    Image(Format),
}

/// Writes a line drawing of an exact model. Returns the octree level that was drawn for
/// [`DrawingStyle::Octants`], `None` otherwise.
///
/// Sides between faces of one plane are not drawn as edges. Camera and background are those of
/// [`render_exact`](super::render_exact). Faces that hide others have the background's colour; the
/// sides of blocks are flat-shaded. With [`DrawingStyle::Octants`], a block is drawn if it is
/// inside, or if it is at the level and at least half of it is inside. The default level is the
/// coarsest one with 32 blocks along the solid's longest side.
///
/// # Errors
/// If a number of the request is out of range, a level is requested for a drawing of edges or does
/// not exist, the faces or blocks exceed the limits of memory, the format cannot store 8-bit
/// colours, the file is corrupt, or on cancellation.
pub fn draw_exact(
    model: &ExactModel,
    style: DrawingStyle,
    request: &RenderRequest,
    output: Output,
    format: DrawingFormat,
    progress: &dyn Progress,
) -> Result<Option<u8>> {
    request.check()?;
    if let (DrawingStyle::Wireframe | DrawingStyle::HiddenLines, Some(level)) = (style, request.level) {
        return Err(Error::invalid("level", level.to_string(), "no level for edges of an exact model"));
    }
    let (corners, camera) = view_of(model, request, progress)?;
    let mut marks = Marks::new(request.background);
    let level = match style {
        DrawingStyle::Wireframe => {
            faces::wireframe(model, request.parts.as_ref(), &camera, &mut marks, progress)?;
            None
        }
        DrawingStyle::HiddenLines => {
            faces::hidden_lines(model, request.parts.as_ref(), &camera, &mut marks, progress)?;
            None
        }
        DrawingStyle::Octants => {
            request.refuse_parts("blocks of an octree")?;
            Some(octants::of_model(model, corners, request.level, &camera, &mut marks, progress)?)
        }
    };
    write(&marks, request, output, format, progress)?;
    model.check_unchanged()?;
    Ok(level)
}

/// Draws the blocks of an octree of cells, as [`draw_exact`] does with [`DrawingStyle::Octants`],
/// and returns the level. Blocks have the colours of [`render`](super::render). At the level, an
/// occupancy tree shows blocks that are at least half full; other trees show all blocks that are
/// not VOID.
///
/// # Errors
/// Those of [`draw_exact`]; and if the tree is a quadtree.
pub fn draw_cells(
    tree: &Dataset,
    request: &RenderRequest,
    output: Output,
    format: DrawingFormat,
    progress: &dyn Progress,
) -> Result<u8> {
    request.check()?;
    request.refuse_parts("trees of cells")?;
    let mut marks = Marks::new(request.background);
    let level = octants::of_cells(tree, request, &mut marks, progress)?;
    write(&marks, request, output, format, progress)?;
    tree.check_unchanged()?;
    Ok(level)
}

fn write(
    marks: &Marks,
    request: &RenderRequest,
    output: Output,
    format: DrawingFormat,
    progress: &dyn Progress,
) -> Result<()> {
    match format {
        DrawingFormat::Svg => svg::write(marks, request, output, progress),
        DrawingFormat::Image(format) => painter::write(marks, request, output, format, progress),
    }
}

/// Viewer in some coordinate system: a point, or a direction to infinity.
#[derive(Clone, Copy, Debug)]
enum Viewer {
    At(DVec3),
    /// At infinity, in this direction.
    AtInfinity(DVec3),
}

impl Viewer {
    fn of(camera: &Camera) -> Viewer {
        match camera.eye() {
            Some(eye) => Viewer::At(eye),
            None => Viewer::AtInfinity(camera.towards),
        }
    }
}
