//! Intersection of a face with an octant: five tests, each closer than the one before, as in N. Trstenjak, B.
//! Zalik and N. Guid, "An algorithm for boundary to octree conversion", Informatica 2/91.
//!
//! The tests are the paper's; how they are decided is not. The paper counts how many vertices of the octant's
//! section with the face's plane lie inside, outside and on the boundary of the face, and its rule (10)
//! answers wrong where an edge of the face passes through two of these vertices, and not at all where it does
//! so with others inside and outside. Here an edge that passes through the octant's inside decides by itself,
//! and where none does, the section lies on one side of the boundary as a whole, so that one point of it
//! decides. Nothing is divided or rounded.

use super::box3::Box3;
use super::intersection::{Intersection, Stage};
use super::plane::Plane;
use super::triangle;
use super::triangulate::Triangulator;

/// A face with its holes on the integer grid, coordinates at most 2^31 in magnitude.
///
/// It is a closed set: its boundary, that of its holes included, belongs to it. Concave faces, any number of
/// holes, and holes that touch the boundary or one another are fine. Snapping to the grid bends faces; one
/// whose corners are not exactly in one plane is taken as the triangles of its triangulation, and so has no
/// cracks to its neighbours.
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

/// Reason why some rings are not a face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// The outer ring encloses no area: nothing is lost without this face.
    NoArea,
    /// Corners are not in one plane, and no triangles cover the face and nothing else: rings cross.
    NotSimple,
}

impl GridPolygon {
    /// A face of rings, the outer ring first; `ring_ends` says where each ring ends in `points`.
    ///
    /// # Errors
    /// If the rings are no face, see [`Flaw`]. Rings that cross go unnoticed if all corners are in one plane.
    ///
    /// # Panics
    /// If `ring_ends` does not rise up to the number of points.
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

    /// Whether all corners are exactly in one plane.
    pub fn is_planar(&self) -> bool {
        matches!(self.shape, Surface::Planar(_))
    }

    /// The least box around the face.
    pub fn bounds(&self) -> Box3 {
        self.bounds
    }

    /// Whether the face has a point in common with the octant's inside; touching a wall, an edge or a corner
    /// of the octant is not enough, and neither is lying in a wall. The octant's sides are at least one unit
    /// long.
    pub fn cuts(&self, octant: &Box3) -> Intersection {
        let decided = |cuts, stage| Intersection { cuts, stage };
        if !octant.inside_meets(&self.bounds) {
            return decided(false, Stage::Boxes);
        }
        match &self.shape {
            Surface::Planar(plane) if !plane.cuts(octant) => decided(false, Stage::Planes),
            // (2) and the part of (1) that does not ask for a plane.
            _ if self.points.iter().any(|point| octant.has_inside(point)) => decided(true, Stage::Vertices),
            Surface::Planar(plane) => self.cuts_by_section(plane, octant),
            Surface::Bent(triangles) => {
                let corners = |triangle: &[u32; 3]| triangle.map(|corner| self.points[corner as usize]);
                let cuts = triangles.iter().any(|t| triangle::cuts(&corners(t), octant.min, octant.max));
                decided(cuts, Stage::Triangles)
            }
        }
    }

    /// The rest of test 3, and tests 4 and 5, for a plane that cuts the octant, and no vertex inside (3).
    fn cuts_by_section(&self, plane: &Plane, octant: &Box3) -> Intersection {
        let decided = |cuts, stage| Intersection { cuts, stage };
        // (1) with all vertices on walls: the face is a part of the section, whose inside is inside the
        // octant.
        if self.outer().iter().all(|point| octant.contains(point)) {
            return decided(true, Stage::Vertices);
        }
        if crosses(self.outer(), octant) {
            return decided(true, Stage::Section);
        }
        // The section is not crossed by the boundary: any line into it tells on which side all of it is. This
        // is the centre point of (8), and it answers (7), (9) and (10) too.
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
        // Holes may touch the boundary and one another, so all of them are looked at, whatever (7) says. A
        // hole whose boundary does not cross the section has all of it (11 to 14) or nothing (15 to 17).
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

/// Whether an edge of the ring passes through the octant's inside.
fn crosses(ring: &[[i64; 3]], octant: &Box3) -> bool {
    (0..ring.len())
        .any(|i| triangle::segment_cuts(ring[i], ring[(i + 1) % ring.len()], octant.min, octant.max))
}
