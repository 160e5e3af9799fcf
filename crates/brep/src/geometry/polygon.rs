//! Intersection of a face with an octant in five stages of increasing accuracy, as in N. Trstenjak,
//! B. Zalik and N. Guid, "An algorithm for boundary to octree conversion", Informatica 2/91.
//!
//! The stages are the paper's, but their criteria differ. The paper counts the vertices of the
//! octant's section with the face's plane that are inside, outside and on the boundary of the face.
//! Its rule (10) is wrong where an edge of the face passes through two of these vertices, and
//! undefined where others are both inside and outside. Here, an edge that passes through the
//! octant's interior decides alone. If there is none, the whole section is on one side of the
//! boundary, so one point of it decides. Nothing is divided or rounded.

use super::box3::Box3;
use super::intersection::{Intersection, Stage};
use super::plane::Plane;
use super::triangle;
use super::triangulate::Triangulator;

/// A face with its holes on the integer grid; coordinates are at most 2^31 in magnitude.
///
/// The face is a closed set: it includes its boundary and those of its holes. Concave faces, any
/// number of holes, and holes that touch the boundary or each other are supported. Snapping to the
/// grid bends faces: a face whose vertices are not exactly in one plane is represented by its
/// triangulation, and so has no cracks to its neighbours.
#[derive(Clone, Debug)]
pub struct GridPolygon {
    points: Vec<[i64; 3]>,
    ring_ends: Vec<usize>,
    bounds: Box3,
    shape: Surface,
}

#[derive(Clone, Debug)]
enum Surface {
    Planar(Plane),
    Bent(Vec<[u32; 3]>),
}

/// Reason why rings are not a valid face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// The outer ring encloses no area: the face can be dropped without loss.
    NoArea,
    /// Vertices are not in one plane, and no triangulation covers exactly the face: rings cross.
    NotSimple,
}

impl GridPolygon {
    /// Creates a face from rings, the outer ring first; `ring_ends` has the end of each ring in
    /// `points`.
    ///
    /// # Errors
    /// If the rings are not a face, see [`Flaw`]. Crossing rings are not detected if all vertices
    /// are in one plane.
    ///
    /// # Panics
    /// If `ring_ends` does not ascend to the number of points.
    pub fn new(
        points: &[[i64; 3]],
        ring_ends: &[usize],
        triangulator: &mut Triangulator,
    ) -> Result<GridPolygon, Flaw> {
        let outer = &points[..ring_ends.first().copied().unwrap_or(0)];
        let (Some(bounds), Some(plane)) = (Box3::around(points), Plane::of_ring(outer)) else {
            return Err(Flaw::NoArea);
        };
        let shape = if points.iter().all(|point| plane.contains(point)) {
            Surface::Planar(plane)
        } else {
            let mut triangles = Vec::new();
            if !triangulator.triangulate(points, ring_ends, &mut triangles) {
                return Err(Flaw::NotSimple);
            }
            Surface::Bent(triangles)
        };
        Ok(GridPolygon { points: points.to_vec(), ring_ends: ring_ends.to_vec(), bounds, shape })
    }

    /// Returns whether all vertices are exactly in one plane.
    pub fn is_planar(&self) -> bool {
        matches!(self.shape, Surface::Planar(_))
    }

    /// Returns the bounding box of the face.
    pub fn bounds(&self) -> Box3 {
        self.bounds
    }

    /// Tests whether the face shares a point with the octant's interior. A face that touches a
    /// wall, an edge or a corner of the octant, or is in a wall, does not. The octant's sides are
    /// at least one unit long.
    pub fn cuts(&self, octant: &Box3) -> Intersection {
        let decided = |cuts, stage| Intersection { cuts, stage };
        if !octant.inside_meets(&self.bounds) {
            return decided(false, Stage::Boxes);
        }
        match &self.shape {
            Surface::Planar(plane) if !plane.cuts(octant) => decided(false, Stage::Planes),
            // (2), and the case of (1) that needs no plane.
            _ if self.points.iter().any(|point| octant.has_inside(point)) => decided(true, Stage::Vertices),
            Surface::Planar(plane) => self.cuts_by_section(plane, octant),
            Surface::Bent(triangles) => {
                let corners = |triangle: &[u32; 3]| triangle.map(|corner| self.points[corner as usize]);
                let cuts = triangles.iter().any(|t| triangle::cuts(&corners(t), octant.min, octant.max));
                decided(cuts, Stage::Triangles)
            }
        }
    }

    /// Decides the rest of stage 3, and stages 4 and 5, for a plane that cuts the octant, and no
    /// vertex inside (3).
    fn cuts_by_section(&self, plane: &Plane, octant: &Box3) -> Intersection {
        let decided = |cuts, stage| Intersection { cuts, stage };
        // (1) with all vertices on walls: the face is a subset of the section, whose interior is
        // inside the octant.
        if self.outer().iter().all(|point| octant.contains(point)) {
            return decided(true, Stage::Vertices);
        }
        if crosses(self.outer(), octant) {
            return decided(true, Stage::Section);
        }
        // The boundary does not cross the section, so any line into the section decides on which
        // side of the boundary it is. This is the centre point of (8), and decides (7), (9) and
        // (10), too.
        let Some(line) = plane.line_into(octant) else {
            unreachable!(
                "a plane that cuts an octant, without a line that meets it there: {plane:?}, {octant:?}"
            );
        };
        if !line.passes_through(self.outer()) {
            return decided(false, Stage::Section);
        }
        if self.ring_ends.len() == 1 {
            return decided(true, Stage::Section);
        }
        // Holes may touch the boundary and each other, so all of them are tested, regardless of
        // (7). A hole whose boundary does not cross the section contains all of it (11 to 14) or
        // nothing (15 to 17).
        let cuts = self.holes().any(|hole| crosses(hole, octant))
            || !self.holes().any(|hole| line.passes_through(hole));
        decided(cuts, Stage::Holes)
    }

    fn outer(&self) -> &[[i64; 3]] {
        &self.points[..self.ring_ends[0]]
    }

    fn holes(&self) -> impl Iterator<Item = &[[i64; 3]]> {
        self.ring_ends.windows(2).map(|ends| &self.points[ends[0]..ends[1]])
    }
}

/// Returns whether an edge of the ring passes through the octant's interior.
fn crosses(ring: &[[i64; 3]], octant: &Box3) -> bool {
    (0..ring.len())
        .any(|i| triangle::segment_cuts(ring[i], ring[(i + 1) % ring.len()], octant.min, octant.max))
}
