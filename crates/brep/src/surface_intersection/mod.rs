//! Intersection of the surfaces of two bodies: lines in which they intersect or touch, areas in
//! which they coincide, and points. Exact, and rounded once.
//!
//! The problem is that of "Construction of the spatial intersection line of polygon meshes"
//! (Chernihiv, 2012). For each pair of faces whose boxes touch, the line of both planes is
//! intersected with both polygons, and the resulting intervals with each other. Unlike the article,
//! this module finds the pairs through the octrees instead of a matrix of all pairs, and uses signs
//! of integers instead of coordinates in the frames of faces. It also covers what the article
//! leaves open: vertices and edges that lie in faces, coplanar faces, and the order of the
//! segments.

pub(crate) mod areas;
mod around;
mod lines;
mod segments;
#[cfg(test)]
mod tests;

use self::segments::Segments;
use super::arrangement::{Operands, Surface};
use super::combine::NearFaces;
use super::query::SectionPolygon;
use super::{ExactModel, Faces};
use spinney_base::{Error, Progress, Result};

/// How two surfaces meet along a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// They intersect. To the left of the line, the surface of the first body is inside of the
    /// second body, to the right outside. Where the surfaces coincide with equal orientation, that
    /// counts as inside.
    Crossing,
    /// They touch: next to the line, each surface is on one side of the other.
    Touch,
}

/// A line that two surfaces have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionLine {
    /// How the surfaces meet along the line.
    pub kind: LineKind,
    /// Points in world coordinates; at least two. The last point of a closed line equals the first.
    pub points: Vec<[f64; 3]>,
    /// Faces at each segment, of the first model and of the second: to the left and to the right as
    /// seen from outside of that body. Both are equal where the segment crosses a face. Numbers are
    /// those of the faces in the file from which the model was built (`Face::source`).
    pub faces: Vec<[[u64; 2]; 2]>,
}

impl IntersectionLine {
    /// Whether the line ends where it starts.
    pub fn is_closed(&self) -> bool {
        self.points.first() == self.points.last()
    }

    /// Returns the line's length.
    pub fn length(&self) -> f64 {
        let square =
            |ends: &[[f64; 3]]| (0..3).map(|axis| (ends[1][axis] - ends[0][axis]).powi(2)).sum::<f64>();
        self.points.windows(2).map(|ends| square(ends).sqrt()).sum()
    }
}

/// An area in which two surfaces coincide.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionArea {
    /// Rings, counterclockwise as seen from outside of the first body, and area.
    pub polygon: SectionPolygon,
    /// Whether both surfaces have equal orientation, so that the bodies are on one side of the
    /// area. Otherwise they touch from outside.
    pub is_same_side: bool,
}

/// A point in which two surfaces touch, on no common line or area.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionPoint {
    /// The point in world coordinates.
    pub point: [f64; 3],
    /// A face of each model at the point, as in [`IntersectionLine::faces`].
    pub faces: [u64; 2],
}

/// Lines, areas and points that the surfaces of two bodies have in common.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SurfaceIntersection {
    /// Lines in which the surfaces intersect, all of them closed, then lines in which they touch.
    /// The latter end at points where other than two of their segments meet. The border of an area
    /// is included only where the surfaces intersect there.
    pub lines: Vec<IntersectionLine>,
    /// Areas; adjacent areas of one kind are merged.
    pub areas: Vec<IntersectionArea>,
    /// Points on none of these lines and areas.
    pub points: Vec<IntersectionPoint>,
}

/// Returns what the surfaces of two bodies have in common. Grids must be compatible as for set
/// operations ([`combine`](super::combine)). The result does not depend on the number of threads.
///
/// Time and memory are proportional to the number of faces near the other body, about 400 bytes
/// each, plus about 700 bytes for each pair of faces with common points.
///
/// ```
/// use spinney::ExactModel;
/// use spinney::raw::brep::surface_intersection::{LineKind, surface_intersection};
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # use spinney::Output;
/// # let directory = tempfile::tempdir().unwrap();
/// # let made = |name: &str, [x, y, z]: [i32; 3]| -> spinney::Result<ExactModel> {
/// #     let [mesh, path] = ["off", "goblin"].map(|ending| directory.path().join(name).with_extension(ending));
/// #     let points = format!("{x} {y} {z}\n{} {y} {z}\n{x} {} {z}\n{x} {y} {}\n", x + 6, y + 6, z + 6);
/// #     std::fs::write(&mesh, format!("OFF\n4 4 0\n{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")).unwrap();
/// #     let mut options = ExactOptions::new();
/// #     options.snap = Some(1.0);
/// #     import_exact(open_all(&[mesh], 64 << 20)?, &options, Output::create(&path)?, &())?;
/// #     ExactModel::open(&path, &Default::default())
/// # };
/// // Two corners of cubes, the second one moved.
/// let (a, b) = (made("a", [0, 0, 0])?, made("b", [1, 1, 1])?);
/// let found = surface_intersection(&a, &b, 64 << 20, &())?;
/// assert_eq!((found.lines.len(), found.areas.len(), found.points.len()), (1, 0, 0));
/// assert!(found.lines[0].kind == LineKind::Crossing && found.lines[0].is_closed());
/// assert_eq!(found.lines[0].points.len(), 4);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If grids, coordinate systems or units are incompatible, if `memory` bytes are insufficient, if
/// files are corrupt or cannot be read, or on cancellation.
pub fn surface_intersection(
    a: &ExactModel,
    b: &ExactModel,
    memory: u64,
    progress: &dyn Progress,
) -> Result<SurfaceIntersection> {
    a.check_surface(progress)?;
    if !std::ptr::eq(a, b) {
        b.check_surface(progress)?;
    }
    let NearFaces { faces, ends, first_sources } = NearFaces::of([a, b], memory / 2, progress)?;
    let operands = Operands {
        ends: &ends,
        far: &[a.far_winding(), b.far_winding()],
        are_bodies: true,
        ..Operands::NONE
    };
    let surface = Surface::new(&faces, &operands, a.path(), memory, progress)?;
    // (Segments and points need as much.)
    let contacts = surface.contacts_of_first(memory / 2, progress)?;
    let source = |face: u32| surface.face(face).source - first_sources[surface.operand(face)];
    let mut segments = Segments::of(&surface, &contacts, progress)?;
    let grid = faces.list.grid();
    let points = segments
        .lone_points(&contacts)
        .into_iter()
        .map(|(point, faces)| IntersectionPoint { point: point.to_world(grid), faces: faces.map(source) });
    let points = points.collect();
    let areas = areas::areas(&surface, &contacts, grid, memory, progress)?;
    progress.check()?;
    let world: Vec<[f64; 3]> = segments.vertices.list().iter().map(|point| point.to_world(grid)).collect();
    let lines = segments.lines().into_iter().map(|chain| IntersectionLine {
        kind: if chain.is_crossing { LineKind::Crossing } else { LineKind::Touch },
        points: chain.vertices.iter().map(|vertex| world[*vertex as usize]).collect(),
        faces: chain.faces.iter().map(|faces| faces.map(|sides| sides.map(source))).collect(),
    });
    let found = SurfaceIntersection { lines: lines.collect(), areas, points };
    let are_numbers = found.all_points().flatten().all(|at| at.is_finite());
    match are_numbers {
        true => Ok(found),
        false => Err(Error::corrupt(
            a.path(),
            "faces",
            "faces whose vertices are not in one plane",
            "planar faces",
        )),
    }
}

impl SurfaceIntersection {
    /// Yields all points of all features, in world coordinates.
    pub fn all_points(&self) -> impl Iterator<Item = &[f64; 3]> {
        let rings = self.areas.iter().flat_map(|area| &area.polygon.rings);
        let lines = self.lines.iter().map(|line| &line.points).chain(rings).flatten();
        lines.chain(self.points.iter().map(|point| &point.point))
    }
}
