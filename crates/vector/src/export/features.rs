//! Adapts imported features for export.

use super::{AttributeValue, Geometry, GeometryKind};
use crate::import::feature::{FeatureAttribute, FeatureGeometry};
use spinney_base::Result;

/// A point, a line, or a ring of a polygon.
struct SimpleGeometry<'a> {
    kind: GeometryKind,
    is_outer: bool,
    points: &'a [[f64; 2]],
    /// Heights of the points; empty if there are none.
    heights: &'a [f64],
}

impl SimpleGeometry<'_> {
    /// Returns a point with its height, or 0.
    fn point(&self, index: usize) -> [f64; 3] {
        let [x, y] = self.points[index];
        [x, y, self.heights.get(index).copied().unwrap_or(0.0)]
    }

    /// Returns the first point of a ring that is not closed.
    fn closing(&self) -> Option<[f64; 3]> {
        let is_open = self.kind == GeometryKind::Polygon && self.points.first() != self.points.last();
        (is_open && !self.points.is_empty()).then(|| self.point(0))
    }
}

/// Geometry of an imported feature, for export. Rings are closed, and nested collections are
/// flattened.
pub struct FeatureParts<'a> {
    parts: Vec<SimpleGeometry<'a>>,
    kind: GeometryKind,
}

impl<'a> FeatureParts<'a> {
    /// Collects the points, lines and rings of a geometry.
    pub fn of(geometry: &'a FeatureGeometry) -> FeatureParts<'a> {
        FeatureParts::with_heights(geometry, &[])
    }

    /// Collects the points, lines and rings of a geometry, with the heights of all of its points;
    /// `heights` may be empty.
    pub(crate) fn with_heights(geometry: &'a FeatureGeometry, mut heights: &'a [f64]) -> FeatureParts<'a> {
        let mut parts = Vec::new();
        collect(geometry, &mut parts);
        for part in &mut parts {
            let (own, rest) = heights.split_at(part.points.len().min(heights.len()));
            (part.heights, heights) = (own, rest);
        }
        let first = parts.first().map(|part| part.kind);
        let kind = geometry.kind().or(first).unwrap_or(GeometryKind::Polygon);
        FeatureParts { parts, kind }
    }

    /// Returns all points, including those of lines and rings.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = &[f64; 2]> {
        self.parts.iter().flat_map(|part| part.points)
    }

    /// Returns the kind of the geometry, or of a collection's first member.
    pub fn kind(&self) -> GeometryKind {
        self.kind
    }
}

fn collect<'a>(geometry: &'a FeatureGeometry, parts: &mut Vec<SimpleGeometry<'a>>) {
    match geometry {
        FeatureGeometry::Points(points) => {
            let part = |point| SimpleGeometry {
                kind: GeometryKind::Point,
                is_outer: true,
                points: std::slice::from_ref(point),
                heights: &[],
            };
            parts.extend(points.iter().map(part));
        }
        FeatureGeometry::Lines(lines) => {
            let part = |points: &'a Vec<_>| SimpleGeometry {
                kind: GeometryKind::Line,
                is_outer: true,
                points,
                heights: &[],
            };
            parts.extend(lines.iter().map(part));
        }
        FeatureGeometry::Polygons(polygons) => {
            for rings in polygons {
                let part = |(index, points): (usize, &'a Vec<_>)| SimpleGeometry {
                    kind: GeometryKind::Polygon,
                    is_outer: index == 0,
                    points,
                    heights: &[],
                };
                parts.extend(rings.iter().enumerate().map(part));
            }
        }
        FeatureGeometry::Collection(members) => members.iter().for_each(|member| collect(member, parts)),
    }
}

/// Returns the minimum and maximum of x and y; zeros if there are no points.
pub(crate) fn bounds_of(vertices: &mut dyn Iterator<Item = &[f64; 2]>) -> [[f64; 2]; 2] {
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for vertex in vertices {
        for axis in 0..2 {
            bounds[0][axis] = bounds[0][axis].min(vertex[axis]);
            bounds[1][axis] = bounds[1][axis].max(vertex[axis]);
        }
    }
    if bounds[0][0] > bounds[1][0] { [[0.0; 2]; 2] } else { bounds }
}

impl Geometry for FeatureParts<'_> {
    fn parts(&self) -> usize {
        self.parts.len()
    }

    fn count(&self, part: usize) -> u64 {
        let count = |part: &SimpleGeometry<'_>| part.points.len() + usize::from(part.closing().is_some());
        self.parts.get(part).map_or(0, count) as u64
    }

    fn points(&self, part: usize, each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>) -> Result<()> {
        let Some(part) = self.parts.get(part) else { return Ok(()) };
        let count = part.points.len();
        let mut held = Vec::with_capacity(count.min(1024));
        for first in (0..count).step_by(1024) {
            held.clear();
            held.extend((first..count.min(first + 1024)).map(|index| part.point(index)));
            each(&held)?;
        }
        part.closing().map_or(Ok(()), |point| each(&[point]))
    }

    fn is_outer(&self, part: usize) -> bool {
        self.parts.get(part).is_some_and(|part| part.is_outer)
    }

    fn part_kind(&self, part: usize) -> Option<GeometryKind> {
        self.parts.get(part).map(|part| part.kind)
    }
}

impl<'a> From<&'a FeatureAttribute> for AttributeValue<'a> {
    fn from(attribute: &'a FeatureAttribute) -> AttributeValue<'a> {
        match attribute {
            FeatureAttribute::None => AttributeValue::None,
            FeatureAttribute::Integer(number) => AttributeValue::Integer(*number),
            FeatureAttribute::Number(number) => AttributeValue::Number(*number),
            FeatureAttribute::Text(text) => AttributeValue::Text(text),
            FeatureAttribute::Boolean(is) => AttributeValue::Boolean(*is),
            FeatureAttribute::Json(text) => AttributeValue::Json(text),
        }
    }
}
