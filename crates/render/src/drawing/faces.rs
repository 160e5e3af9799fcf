//! Drawings of exact models' edges.

use glam::DVec3;

use super::Viewer;
use super::edges::Triangles;
use super::marks::Marks;
use crate::camera::Camera;
use spinney_base::{Progress, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::{ExactModel, Faces as _, Grid};
use spinney_partitions::bsp::{Bsp, Seen};

/// Where a point of the grid, or between its points, is in the picture.
fn place(point: [f64; 3], grid: &Grid, camera: &Camera) -> [f64; 2] {
    camera.place(DVec3::from(grid.to_world([0; 3])) + DVec3::from(point) * grid.width())
}

/// Draws all edges of a model, each once.
pub(super) fn wireframe(
    model: &ExactModel,
    camera: &Camera,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<()> {
    let triangles = Triangles::of(model, progress)?;
    for number in 0..triangles.corners.len() {
        let (corners, edges) = (&triangles.corners[number], triangles.edges(number));
        let places = corners.map(|corner| place(corner.map(f64::from), model.grid(), camera));
        let is_drawn =
            |side: &usize| edges[*side] && triangles.beside(number, *side).is_none_or(|other| number < other);
        marks.lines((0..3).filter(is_drawn).map(|side| [places[side], places[(side + 1) % 3]]));
    }
    Ok(())
}

/// A viewer on the grid of a model.
#[derive(Clone, Copy)]
enum GridViewer {
    At([i32; 3]),
    FarAway([i32; 3]),
}

/// Coordinates of viewers in steps that are known by their places; from farther away, lines of sight are parallel but for less than a step.
const FAR: f64 = (1u32 << 30) as f64;

impl GridViewer {
    fn of(camera: &Camera, grid: &Grid) -> GridViewer {
        let direction = match Viewer::of(camera) {
            Viewer::At(eye) => {
                let eye = DVec3::from(grid.to_grid(eye.to_array()));
                if eye.abs().max_element() < FAR {
                    return GridViewer::At(eye.to_array().map(|at| at.round() as i32));
                }
                eye
            }
            Viewer::FarAway(direction) => direction,
        };
        let scaled = direction / direction.abs().max_element() * FAR;
        GridViewer::FarAway(scaled.to_array().map(|at| at.round() as i32))
    }

    /// Whether a triangle is seen from outside.
    fn is_before(self, corners: &[[i32; 3]; 3]) -> bool {
        let to_eye = |axis: usize| match self {
            GridViewer::At(eye) => i128::from(eye[axis]) - i128::from(corners[0][axis]),
            GridViewer::FarAway(direction) => i128::from(direction[axis]),
        };
        let normal = triangle_normal(corners);
        (0..3).map(|axis| i128::from(normal[axis]) * to_eye(axis)).sum::<i128>() > 0
    }
}

/// Draws the edges that no face hides: faces that are turned to the viewer from back to front, each with its edges over those behind it.
pub(super) fn hidden_lines(
    model: &ExactModel,
    camera: &Camera,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<()> {
    let triangles = Triangles::of(model, progress)?;
    let (grid, paper) = (model.grid(), marks.paper());
    let viewer = GridViewer::of(camera, grid);
    // Faces that are turned away have others before them, unless the viewer is inside of what goes on without an end.
    let is_seen = |number: &usize| model.is_unbounded() || viewer.is_before(&triangles.corners[*number]);
    let numbers: Vec<usize> = (0..triangles.corners.len()).filter(is_seen).collect();
    let seen: Vec<_> = numbers.iter().map(|number| triangles.corners[*number]).collect();
    let tree = Bsp::of_triangles(&seen)?;
    progress.check()?;
    // Edges of a plane's pieces go over all of its faces.
    let mut lines = Vec::new();
    let mut take = |what: Seen<'_>| match what {
        Seen::Cell(..) => marks.lines(lines.drain(..)),
        Seen::Piece(piece) => {
            let places: Vec<[f64; 2]> =
                tree.corners(piece).into_iter().map(|corner| place(corner, grid, camera)).collect();
            let edges = triangles.edges(numbers[piece.source]);
            for (i, side) in piece.sides().enumerate() {
                if side.is_some_and(|side| edges[usize::from(side)]) {
                    lines.push([places[i], places[(i + 1) % places.len()]]);
                }
            }
            marks.fill(paper, places);
        }
    };
    match viewer {
        GridViewer::At(eye) => tree.back_to_front(eye, &mut take),
        GridViewer::FarAway(direction) => tree.back_to_front_from_afar(direction, &mut take),
    }
    marks.lines(lines);
    Ok(())
}
