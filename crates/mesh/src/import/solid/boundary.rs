//! Faces in a cell that bound the inside of a solid: the inside is on one of their sides only.
//!
//! Where bodies overlap, fragments of their faces are inside of other bodies. Faces are split where
//! others meet them, so that each fragment has a constant winding number on either side. A line
//! from the cell's centre, whose winding number is known, determines it. Crossings on the line are
//! ordered and counted exactly.

use super::face_sums::FaceSums;
use super::grid::Triangle;
use super::inside::Inside;
use super::windings::change;
use spinney_brep::exact::lattice::Projected;
use spinney_brep::exact::vector::{cross, dot, subtract};
use spinney_brep::geometry::clipped::{ClippedPolygon, Point, clip, range};

/// Maximum number of triangles that are compared with each other.
const MAX_TRIANGLES: usize = 48;
/// Maximum number of face fragments in a cell.
const MAX_PARTS: usize = 2048;
/// Distance in grid units below which two crossings of a line count as one point. Faces of touching
/// bodies are snapped to the grid by less than a unit each, but not by the same amount.
const AT_ONE_POINT: f64 = 1e-3;
/// Distance in cells that counts as zero. It is many times the rounding error of a cell's
/// coordinates after a fragment is split repeatedly, and less than a grid unit of the finest grid.
const NEAR: f64 = 1e-9;

/// Cell, and all triangles that reach into it.
pub(super) struct Neighbourhood<'a> {
    pub(super) triangles: &'a [Triangle],
    /// Grid point of the cell's minimum corner.
    pub(super) min: [i32; 3],
    /// Width of the cell in grid units.
    pub(super) cell: i32,
    /// Winding number at the cell's centre.
    pub(super) winding: i32,
}

/// Fragment of a triangle in a cell; coordinates are in cells from the cell's minimum corner.
struct FaceFragment {
    triangle: usize,
    polygon: ClippedPolygon,
    /// Minimum and maximum coordinate along each axis.
    ranges: [(f64, f64); 3],
    plane: Plane,
}

/// Plane with a unit normal.
struct Plane {
    normal: Point,
    offset: f64,
}

impl Plane {
    fn new(normal: Point, through: Point) -> Plane {
        let length = dot(normal, normal).sqrt();
        let normal = normal.map(|n| n / length);
        Plane { normal, offset: dot(normal, through) }
    }

    fn distance(&self, point: &Point) -> f64 {
        let distance = dot(self.normal, *point) - self.offset;
        if distance.abs() < NEAR { 0.0 } else { distance }
    }

    /// Minimum and maximum distance of a polygon's vertices.
    fn distances(&self, polygon: &ClippedPolygon) -> (f64, f64) {
        range(polygon.points().iter().map(|point| self.distance(point)))
    }
}

impl Neighbourhood<'_> {
    fn centre(&self) -> [i32; 3] {
        self.min.map(|min| min + self.cell / 2)
    }

    /// Winding number at a grid point in the cell.
    pub(super) fn winding_at(&self, point: [i32; 3]) -> i32 {
        let mut at = self.centre();
        self.winding
            + change::<2>(self.triangles, &mut at, point)
            + change::<1>(self.triangles, &mut at, point)
            + change::<0>(self.triangles, &mut at, point)
    }

    /// Change of inside (1, -1 or 0) where the winding number increases by one, if it is the same
    /// everywhere in the cell. `None` if it differs, or cannot be determined cheaply.
    ///
    /// If no two faces have opposite normals along any axis, there is a path along the axes,
    /// monotonic in each of them, from one corner of the cell through any of its points to the
    /// opposite corner. All winding numbers then lie between those of the two corners.
    pub(super) fn weight(&self, inside: &Inside) -> Option<f64> {
        if matches!(inside, Inside::Parity) {
            return None;
        }
        let (mut up, mut down) = ([false; 3], [false; 3]);
        for triangle in self.triangles {
            for (axis, normal) in triangle.normal().into_iter().enumerate() {
                up[axis] |= normal > 0;
                down[axis] |= normal < 0;
            }
        }
        if (0..3).any(|axis| up[axis] && down[axis]) {
            return None;
        }
        // Going up an axis leaves the solid through faces with a normal up that axis.
        let corner = |outside: bool| {
            let last = self.cell - 1;
            self.winding_at(std::array::from_fn(|axis| {
                self.min[axis] + if up[axis] == outside { last } else { 0 }
            }))
        };
        match (corner(true), corner(false)) {
            (0, 1) => Some(1.0),
            (-1, 0) => Some(-1.0),
            (least, most) if least == most || least > 0 || most < 0 => Some(0.0),
            _ => None,
        }
    }

    /// Sums over the face fragments that bound the inside; `None` if there are too many.
    pub(super) fn bounding_faces(&self, inside: &Inside) -> Option<FaceSums> {
        if self.triangles.len() > MAX_TRIANGLES {
            return None;
        }
        let mut parts = Vec::with_capacity(self.triangles.len());
        for (triangle, it) in self.triangles.iter().enumerate() {
            clip(ClippedPolygon::of_triangle(&it.corners, self.min, self.cell), 1, &mut |polygon, _, _| {
                let plane = Plane::new(it.normal().map(|n| n as f64), polygon.points()[0]);
                let ranges = [0, 1, 2].map(|axis| polygon.range(axis));
                parts.push(FaceFragment { triangle, polygon: *polygon, ranges, plane });
            });
        }
        let mut faces = FaceSums::default();
        let mut count = 0;
        for part in &parts {
            let cut = self.cut(part, &parts)?;
            count += cut.len();
            if count > MAX_PARTS {
                return None;
            }
            for polygon in &cut {
                let weight = self.weight_at(part.triangle, polygon.middle(), inside);
                if let Some(weight) = weight.filter(|weight| *weight != 0) {
                    faces.add(polygon, [0; 3], f64::from(weight));
                }
            }
        }
        Some(faces)
    }

    /// Splits a face fragment wherever another one meets it.
    fn cut(&self, part: &FaceFragment, others: &[FaceFragment]) -> Option<Vec<ClippedPolygon>> {
        let mut fragments = vec![part.polygon];
        for other in others.iter().filter(|other| other.triangle != part.triangle) {
            let is_disjoint =
                part.ranges.iter().zip(&other.ranges).any(|(a, b)| a.0 > b.1 + NEAR || b.0 > a.1 + NEAR);
            if is_disjoint {
                continue;
            }
            let (low, high) = part.plane.distances(&other.polygon);
            if low > 0.0 || high < 0.0 {
                continue;
            }
            if low == 0.0 && high == 0.0 {
                // Coplanar: split along the other's edges.
                let points = other.polygon.points();
                for (a, b) in points.iter().zip(points.iter().cycle().skip(1)) {
                    let across = cross(subtract(*b, *a), part.plane.normal);
                    if dot(across, across) > NEAR * NEAR {
                        fragments = split(fragments, &Plane::new(across, *a))?;
                    }
                }
            } else if is_crossed(&part.polygon, &other.plane) {
                fragments = split(fragments, &other.plane)?;
            }
        }
        Some(fragments)
    }

    /// Change of inside at a point of a triangle where the winding number increases by one. `None`
    /// if the triangle is too small there to be hit by a line.
    fn weight_at(&self, triangle: usize, at: Point, inside: &Inside) -> Option<i32> {
        let normal = self.triangles[triangle].normal().map(i64::unsigned_abs);
        match (0..3).max_by_key(|axis| normal[*axis]) {
            Some(0) => self.weight_along::<0>(triangle, at, inside),
            Some(1) => self.weight_along::<1>(triangle, at, inside),
            _ => self.weight_along::<2>(triangle, at, inside),
        }
    }

    fn weight_along<const D: usize>(&self, triangle: usize, at: Point, inside: &Inside) -> Option<i32> {
        let mut from: [i32; 3] = std::array::from_fn(|axis| {
            self.min[axis] + ((at[axis] * f64::from(self.cell)) as i32).clamp(0, self.cell - 1)
        });
        from[D] = self.centre()[D];
        let met: Vec<(usize, Projected<D>)> = (0..)
            .zip(self.triangles)
            .filter_map(|(number, triangle)| Some((number, Projected::<D>::new(&triangle.corners)?)))
            .filter(|(_, projected)| projected.is_met(from))
            .collect();
        let here = met.iter().find(|(number, _)| *number == triangle)?;
        let place = |(number, projected): &(usize, Projected<D>)| {
            (projected.height_over(from), projected.change(), *number)
        };
        let this = place(here);
        // A touching body is left before the next one is entered. Crossings at one point have the
        // same order on all lines.
        let is_before = |other: (f64, i32, usize)| {
            if (other.0 - this.0).abs() > AT_ONE_POINT {
                other.0 < this.0
            } else {
                (other.1, other.2) < (this.1, this.2)
            }
        };
        let starts_beyond = here.1.is_beyond(from);
        let mut before = self.winding_at(from);
        for other in &met {
            let passes = other.1.is_beyond(from) == starts_beyond && is_before(place(other)) != starts_beyond;
            if passes {
                before += if starts_beyond { -other.1.change() } else { other.1.change() };
            }
        }
        let change = here.1.change();
        let is_inside = |winding: i32| i32::from(inside.has(winding));
        Some((is_inside(before + change) - is_inside(before)) * change)
    }
}

/// Whether a polygon has vertices on both sides of a plane.
fn is_crossed(polygon: &ClippedPolygon, plane: &Plane) -> bool {
    let (low, high) = plane.distances(polygon);
    low < 0.0 && high > 0.0
}

/// Splits polygons by a plane; `None` if there are too many.
fn split(polygons: Vec<ClippedPolygon>, plane: &Plane) -> Option<Vec<ClippedPolygon>> {
    let mut cut = Vec::with_capacity(polygons.len() + 1);
    for polygon in polygons.iter().flat_map(ClippedPolygon::halves) {
        if is_crossed(&polygon, plane) {
            let (below, above) = polygon.split_by(|point| plane.distance(point), |_| ());
            cut.extend([below, above].into_iter().filter(|polygon| polygon.points().len() > 2));
        } else {
            cut.push(polygon);
        }
    }
    (cut.len() <= MAX_PARTS).then_some(cut)
}
