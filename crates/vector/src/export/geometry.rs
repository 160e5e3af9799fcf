//! Geometries of exported features: parts with points.

use std::ops::Range;

use super::GeometryKind;
use spinney_base::Result;
use spinney_engine::query::Contour;

/// Geometry of a feature.
pub trait Geometry {
    /// Returns the number of parts, which are points, lines or rings. A geometry without parts is
    /// empty.
    fn parts(&self) -> usize;

    /// Returns the number of points of a part.
    fn count(&self, part: usize) -> u64;

    /// Yields the points of a part, in order, many at a time.
    ///
    /// # Errors
    /// If they cannot be read, or `each` fails.
    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()>;

    /// Returns whether a ring is an outer ring, which starts a new polygon, and not a hole. The
    /// default is true for the first part only, which fits single polygons.
    fn is_outer(&self, part: usize) -> bool {
        part == 0
    }

    /// Returns the kind of a part; `None` if it is that of the whole feature.
    fn part_kind(&self, _part: usize) -> Option<GeometryKind> {
        None
    }
}

impl Geometry for [Vec<[f64; 3]>] {
    fn parts(&self) -> usize {
        self.len()
    }

    fn count(&self, part: usize) -> u64 {
        self.get(part).map_or(0, |points| points.len() as u64)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self.get(part).map_or(Ok(()), |points| each(points))
    }
}

impl Geometry for Vec<Vec<[f64; 3]>> {
    fn parts(&self) -> usize {
        self.len()
    }

    fn count(&self, part: usize) -> u64 {
        self[..].count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self[..].points(part, each)
    }
}

impl<const PARTS: usize> Geometry for [Vec<[f64; 3]>; PARTS] {
    fn parts(&self) -> usize {
        PARTS
    }

    fn count(&self, part: usize) -> u64 {
        self[..].count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self[..].points(part, each)
    }
}

impl Geometry for Contour<'_> {
    fn parts(&self) -> usize {
        Contour::parts(self)
    }

    fn count(&self, part: usize) -> u64 {
        Contour::count(self, part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        Contour::points(self, part, each)
    }
}

impl Geometry for spinney_brep::query::SectionPolygon {
    fn parts(&self) -> usize {
        self.rings.len()
    }

    fn count(&self, part: usize) -> u64 {
        self.rings[..].count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        self.rings[..].points(part, each)
    }
}

impl Geometry for spinney_brep::surface_intersection::IntersectionLine {
    fn parts(&self) -> usize {
        1
    }

    fn count(&self, part: usize) -> u64 {
        std::slice::from_ref(&self.points).count(part)
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        std::slice::from_ref(&self.points).points(part, each)
    }
}

/// Geometry of a feature, divided into its points, lines and polygons.
pub(super) struct Shape<'a> {
    pub(super) geometry: &'a dyn Geometry,
    /// Kind of all members; `None` if they are of several kinds.
    pub(super) kind: Option<GeometryKind>,
    /// Kind and parts of each member.
    pub(super) members: Vec<(GeometryKind, Range<usize>)>,
}

impl<'a> Shape<'a> {
    pub(super) fn of(geometry: &'a dyn Geometry, kind: GeometryKind) -> Shape<'a> {
        let mut members: Vec<(GeometryKind, Range<usize>)> = Vec::with_capacity(1);
        for part in 0..geometry.parts() {
            let own = geometry.part_kind(part).unwrap_or(kind);
            match members.last_mut() {
                Some((GeometryKind::Polygon, rings))
                    if own == GeometryKind::Polygon && !geometry.is_outer(part) =>
                {
                    rings.end += 1;
                }
                _ => members.push((own, part..part + 1)),
            }
        }
        let first = members.first().map_or(kind, |(kind, _)| *kind);
        let kind = members.iter().all(|(kind, _)| *kind == first).then_some(first);
        Shape { geometry, kind, members }
    }

    /// Returns the number of points of all parts.
    #[cfg(any(feature = "flatgeobuf", feature = "geopackage"))]
    pub(super) fn count(&self) -> u64 {
        (0..self.geometry.parts()).fold(0, |sum, part| self.geometry.count(part).saturating_add(sum))
    }
}
