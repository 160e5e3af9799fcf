//! Line drawings of solids: all edges, edges without what is hidden, and the blocks of octrees.
//!
//! A drawing is a list of flat polygons and lines from back to front (`marks.rs`), each over those before it: the painter's algorithm. `edges.rs` finds the edges of exact
//! models, `faces.rs` orders their faces by a BSP tree, `octants.rs` the blocks of octrees by their nodes; `svg.rs` writes the list,
//! `painter.rs` paints it.

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
use crate::exact::Solid;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_brep::ExactModel;
use spinney_engine::dataset::Dataset;
use spinney_raster::image::Format;

/// How a solid is drawn by lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawingStyle {
    /// All edges of an exact model.
    Wireframe,
    /// Its edges without what is hidden.
    HiddenLines,
    /// The blocks of its octree, or of an octree of cells.
    Octants,
}

/// File formats of drawings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DrawingFormat {
    /// Paths, in SVG 1.1.
    Svg,
    /// Pixels.
    Picture(Format),
}

/// Draws an exact model by lines, and returns the level of the octree, where it is one that is drawn.
///
/// Edges between faces of one plane are left out. Camera and background are those of [`render_exact`](super::render_exact); faces that hide others have the
/// background's colour, and blocks are flat, of the light of their side. Of [`DrawingStyle::Octants`], a block is drawn if it is inside, or, at the level, if at least half of
/// it is; without a level it is the coarsest that has 32 blocks along the body's longest side.
///
/// # Errors
/// If a number of the request makes no sense, a level is asked for that means nothing or is not there, there are more faces or blocks than can be held in memory at
/// once, the format cannot hold colours of 8 bits, the file is damaged, or on interruption.
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
        return Err(Error::invalid("level", level.to_string(), "none, of edges of an exact model"));
    }
    let corners = model.bounds()?.map(DVec3::from);
    let camera = request.camera(&Solid { model, corners })?;
    let mut marks = Marks::new(request.background);
    let level = match style {
        DrawingStyle::Wireframe => {
            faces::wireframe(model, &camera, &mut marks, progress)?;
            None
        }
        DrawingStyle::HiddenLines => {
            faces::hidden_lines(model, &camera, &mut marks, progress)?;
            None
        }
        DrawingStyle::Octants => {
            Some(octants::of_model(model, corners, request.level, &camera, &mut marks, progress)?)
        }
    };
    write(&marks, request, output, format, progress)?;
    model.check_unchanged()?;
    Ok(level)
}

/// Draws an octree of cells by its blocks, as [`DrawingStyle::Octants`] of [`draw_exact`] does, and returns the level. Blocks have the colours of
/// [`render`](super::render); of those at the level, trees of occupancy show the ones that are at least half full, and all others what is not VOID.
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
        DrawingFormat::Picture(format) => painter::write(marks, request, output, format, progress),
    }
}

/// A place from which something is seen, in the coordinates of what is asked.
#[derive(Clone, Copy, Debug)]
enum Viewer {
    At(DVec3),
    /// Far away, in this direction.
    FarAway(DVec3),
}

impl Viewer {
    fn of(camera: &Camera) -> Viewer {
        match camera.eye() {
            Some(eye) => Viewer::At(eye),
            None => Viewer::FarAway(camera.towards),
        }
    }
}
