//! Line drawings of exact models' edges.

use std::collections::BTreeSet;

use glam::DVec3;

use super::Viewer;
use super::edges::Triangles;
use super::marks::Marks;
use crate::camera::Camera;
use spinney_base::{Progress, Result};
use spinney_brep::exact::normal::triangle_normal;
use spinney_brep::{ExactModel, Faces as _, Grid};
use spinney_partitions::bsp::{Bsp, BspItem};

/// Image position of a point in grid coordinates.
fn project(point: [f64; 3], grid: &Grid, camera: &Camera) -> [f64; 2] {
    camera.project(DVec3::from(grid.to_world([0; 3])) + DVec3::from(point) * grid.width())
}

/// Draws all edges of a model, each once.
pub(super) fn wireframe(
    model: &ExactModel,
    parts: Option<&BTreeSet<u32>>,
    camera: &Camera,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<()> {
    let triangles = Triangles::of(model, parts, progress)?;
    for number in 0..triangles.corners.len() {
        let (corners, edges) = (&triangles.corners[number], triangles.edges(number));
        let points = corners.map(|corner| project(corner.map(f64::from), model.grid(), camera));
        let is_drawn = |side: &usize| {
            edges[*side] && triangles.triangle_across(number, *side).is_none_or(|other| number < other)
        };
        marks.lines((0..3).filter(is_drawn).map(|side| [points[side], points[(side + 1) % 3]]));
    }
    Ok(())
}

/// Viewer in grid coordinates: a point, or a direction to infinity.
#[derive(Clone, Copy)]
enum GridViewer {
    At([i32; 3]),
    AtInfinity([i32; 3]),
}

/// Coordinate limit, in grid units, of viewers that are points. Lines of sight from a more distant
/// viewer are parallel up to less than a grid unit.
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
            Viewer::AtInfinity(direction) => direction,
        };
        let scaled = direction / direction.abs().max_element() * FAR;
        GridViewer::AtInfinity(scaled.to_array().map(|at| at.round() as i32))
    }

    /// Whether a triangle faces the viewer.
    fn is_before(self, corners: &[[i32; 3]; 3]) -> bool {
        let to_eye = |axis: usize| match self {
            GridViewer::At(eye) => i128::from(eye[axis]) - i128::from(corners[0][axis]),
            GridViewer::AtInfinity(direction) => i128::from(direction[axis]),
        };
        let normal = triangle_normal(corners);
        (0..3).map(|axis| i128::from(normal[axis]) * to_eye(axis)).sum::<i128>() > 0
    }
}

/// Draws the edges that no face hides. Faces that face the viewer are painted from back to front,
/// and each covers the edges it hides before its own edges are drawn.
pub(super) fn hidden_lines(
    model: &ExactModel,
    parts: Option<&BTreeSet<u32>>,
    camera: &Camera,
    marks: &mut Marks,
    progress: &dyn Progress,
) -> Result<()> {
    let triangles = Triangles::of(model, parts, progress)?;
    let (grid, paper) = (model.grid(), marks.paper());
    let viewer = GridViewer::of(camera, grid);
    // Other faces hide those that face away, unless the viewer is inside of an unbounded solid, or
    // parts are open without the others.
    let may_be_open = model.is_unbounded() || parts.is_some();
    let is_seen = |number: &usize| may_be_open || viewer.is_before(&triangles.corners[*number]);
    let numbers: Vec<usize> = (0..triangles.corners.len()).filter(is_seen).collect();
    let seen: Vec<_> = numbers.iter().map(|number| triangles.corners[*number]).collect();
    let tree = Bsp::of_triangles(&seen)?;
    progress.check()?;
    // Edges in a node's plane are drawn after all of its faces.
    let mut lines = Vec::new();
    let mut take = |what: BspItem<'_>| match what {
        BspItem::Cell(..) => marks.lines(lines.drain(..)),
        BspItem::Fragment(fragment) => {
            let points: Vec<[f64; 2]> =
                tree.corners(fragment).into_iter().map(|corner| project(corner, grid, camera)).collect();
            let edges = triangles.edges(numbers[fragment.source]);
            for (i, side) in fragment.sides().enumerate() {
                if side.is_some_and(|side| edges[usize::from(side)]) {
                    lines.push([points[i], points[(i + 1) % points.len()]]);
                }
            }
            marks.fill(paper, points);
        }
    };
    match viewer {
        GridViewer::At(eye) => tree.back_to_front(eye, &mut take),
        GridViewer::AtInfinity(direction) => tree.back_to_front_from_afar(direction, &mut take),
    }
    marks.lines(lines);
    Ok(())
}
