//! Intersection of the surfaces of two bodies: lines in which they pass through each other or touch, areas in which they lie on each
//! other, and points; exact, and rounded once.
//!
//! The problem is that of "Construction of the spatial intersection line of polygon meshes" (Chernihiv, 2012): of pairs of faces whose boxes
//! touch, the line of both planes is asked for where it meets both polygons, and these parts are asked for what they have in common. Boxes
//! are found through the octrees here and not by a matrix of all pairs, signs are those of whole numbers instead of coordinates in frames of faces,
//! and what the article leaves open is decided: corners and edges that lie in faces, faces in one plane, and the order of the pieces.

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

/// The way in which surfaces have a line in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// They pass through each other: on the line's left side the surface of the first body is inside of the second one, on its right side
    /// outside. Walls that lie on each other and face the same way count as inside.
    Crossing,
    /// They touch, and are on the same sides of each other beside the line.
    Touch,
}

/// A line that two surfaces have in common.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionLine {
    /// The way in which they have it in common.
    pub kind: LineKind,
    /// Its points in the world, one or more segments; a closed line ends with the point that it begins with.
    pub points: Vec<[f64; 3]>,
    /// The faces on both sides of each segment, of the first model and of the second one: to the left and to the right as seen from
    /// outside of that body. Both are the same where the segment passes through a face. Numbers are those of the faces of the file that the model
    /// was built from (`Face::source`).
    pub faces: Vec<[[u64; 2]; 2]>,
}

impl IntersectionLine {
    /// Whether it ends where it begins.
    pub fn is_closed(&self) -> bool {
        self.points.first() == self.points.last()
    }

    /// Its length.
    pub fn length(&self) -> f64 {
        let square =
            |ends: &[[f64; 3]]| (0..3).map(|axis| (ends[1][axis] - ends[0][axis]).powi(2)).sum::<f64>();
        self.points.windows(2).map(|ends| square(ends).sqrt()).sum()
    }
}

/// An area in which two surfaces lie on each other.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionArea {
    /// Its rings, counterclockwise as seen from outside of the first body, and size.
    pub polygon: SectionPolygon,
    /// Whether both surfaces face the same way there: the bodies are on one side of it. Otherwise they touch from outside.
    pub is_same_side: bool,
}

/// A point in which two surfaces touch that is on no common line or area.
#[derive(Clone, Debug, PartialEq)]
pub struct IntersectionPoint {
    /// The point in the world.
    pub point: [f64; 3],
    /// A face of each model that it lies on, as in [`IntersectionLine::faces`].
    pub faces: [u64; 2],
}

/// Lines, areas and points that the surfaces of two bodies have in common.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SurfaceIntersection {
    /// Lines in which they pass through each other, all of them closed, then those in which they touch. At points where more than two
    /// segments of the latter meet, lines end. What bounds an area is among them only where the surfaces pass through each other there.
    pub lines: Vec<IntersectionLine>,
    /// Areas, none beside another of its kind.
    pub areas: Vec<IntersectionArea>,
    /// Points on none of these.
    pub points: Vec<IntersectionPoint>,
}

/// Finds what the surfaces of two bodies have in common. Grids must fit together as for set operations
/// ([`combine`](super::combine)). What is found depends on no number of threads.
///
/// Takes time and memory with the number of faces near the other body, about 400 bytes each, and about 700 bytes for each pair of faces that
/// have points in common.
///
/// ```
/// use spinney::ExactModel;
/// use spinney::raw::brep::surface_intersection::{LineKind, surface_intersection};
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # use spinney::Output;
/// # let folder = tempfile::tempdir().unwrap();
/// # let made = |name: &str, [x, y, z]: [i32; 3]| -> spinney::Result<ExactModel> {
/// #     let [mesh, path] = ["off", "goblin"].map(|ending| folder.path().join(name).with_extension(ending));
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
/// If grids, coordinate systems or units do not fit together, if `memory` bytes are not enough, if files are damaged or cannot be read, or on
/// interruption.
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
        turns_roots: false,
        most_contacts: 0,
        keeps_apart: false,
        changed: &[],
        winding: &|_, _| None,
        rest: None,
        is_inside: &|_| false,
    };
    let surface = Surface::new(&faces, &operands, a.path(), memory, progress)?;
    // (As much goes into segments and points.)
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
        false => Err(Error::corrupt(a.path(), "faces", "faces whose corners lie in no plane", "flat faces")),
    }
}

impl SurfaceIntersection {
    /// All points of all features, in the world.
    pub fn all_points(&self) -> impl Iterator<Item = &[f64; 3]> {
        let rings = self.areas.iter().flat_map(|area| &area.polygon.rings);
        let lines = self.lines.iter().map(|line| &line.points).chain(rings).flatten();
        lines.chain(self.points.iter().map(|point| &point.point))
    }
}
