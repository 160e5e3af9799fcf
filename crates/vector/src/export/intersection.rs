//! Intersection of the surfaces of two exact models, as features: lines, areas and points.

use super::{
    AttributeType, AttributeValue, GeometryKind, VectorFeature, VectorFormat, VectorLayer, VectorWriter,
};
use spinney_base::io::Output;
use spinney_base::{Progress, Result};
use spinney_brep::surface_intersection::{LineKind, SurfaceIntersection};
use spinney_brep::{ExactModel, Faces};

/// Names and types of the attributes.
const ATTRIBUTES: [(&str, AttributeType); 8] = [
    ("kind", AttributeType::Text),
    ("length", AttributeType::Number),
    ("area", AttributeType::Number),
    ("side", AttributeType::Text),
    ("a_left", AttributeType::PerSegment),
    ("a_right", AttributeType::PerSegment),
    ("b_left", AttributeType::PerSegment),
    ("b_right", AttributeType::PerSegment),
];

/// Summary of an intersection of two surfaces.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct IntersectionSummary {
    /// Number of lines where the surfaces cross.
    pub crossings: u64,
    /// Total length of these.
    pub crossing_length: f64,
    /// Number of lines where they touch.
    pub touches: u64,
    /// Total length of these.
    pub touch_length: f64,
    /// Number of areas in which they coincide.
    pub overlaps: u64,
    /// Total area of these.
    pub overlap_area: f64,
    /// Number of isolated points.
    pub points: u64,
}

impl IntersectionSummary {
    fn of(found: &SurfaceIntersection) -> IntersectionSummary {
        let lines = |kind: LineKind| {
            let lines = found.lines.iter().filter(|line| line.kind == kind);
            lines.fold((0, 0.0), |(count, length), line| (count + 1, length + line.length()))
        };
        let (crossings, crossing_length) = lines(LineKind::Crossing);
        let (touches, touch_length) = lines(LineKind::Touch);
        IntersectionSummary {
            crossings,
            crossing_length,
            touches,
            touch_length,
            overlaps: found.areas.len() as u64,
            overlap_area: found.areas.iter().fold(0.0, |sum, area| sum + area.polygon.area),
            points: found.points.len() as u64,
        }
    }
}

/// Writes the intersection of the surfaces of two exact models
/// ([`surface_intersection`](spinney_brep::surface_intersection::surface_intersection)). Features
/// are lines where the surfaces cross (`kind` crossing) or touch (touch), areas in which they
/// coincide (overlap; `side` is `same` or `opposite`, for the directions that they face), and
/// isolated points (point). `a_left`, `a_right`, `b_left` and `b_right` are the faces of both
/// models next to each segment.
///
/// # Errors
/// If a file changed in the meantime, or the output cannot be written.
pub fn export_intersection(
    found: &SurfaceIntersection,
    [a, b]: [&ExactModel; 2],
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<IntersectionSummary> {
    let layer = VectorLayer {
        name: "intersection".into(),
        kind: None,
        is_multi: false,
        has_z: true,
        attributes: ATTRIBUTES.map(|(name, kind)| (name.into(), kind)).to_vec(),
        crs: a.crs().or(b.crs()).cloned(),
        bounds: bounds(found).map_or_else(|| a.bounds().map(|bounds| bounds.map(|[x, y, _]| [x, y])), Ok)?,
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let none = AttributeValue::None;
    for line in &found.lines {
        progress.check()?;
        let kind = match line.kind {
            LineKind::Crossing => "crossing",
            LineKind::Touch => "touch",
        };
        let faces = |body: usize, side: usize| -> Vec<u64> {
            line.faces.iter().map(|faces| faces[body][side]).collect()
        };
        let [a_left, a_right, b_left, b_right] = [faces(0, 0), faces(0, 1), faces(1, 0), faces(1, 1)];
        let attributes = [
            AttributeValue::Text(kind),
            AttributeValue::Number(line.length()),
            none,
            none,
            AttributeValue::PerSegment(&a_left),
            AttributeValue::PerSegment(&a_right),
            AttributeValue::PerSegment(&b_left),
            AttributeValue::PerSegment(&b_right),
        ];
        writer.write_feature(&VectorFeature {
            id: None,
            geometry: Some((GeometryKind::Line, line)),
            attributes: &attributes,
        })?;
    }
    for area in &found.areas {
        let side = if area.is_same_side { "same" } else { "opposite" };
        let attributes = [
            AttributeValue::Text("overlap"),
            none,
            AttributeValue::Number(area.polygon.area),
            AttributeValue::Text(side),
            none,
            none,
            none,
            none,
        ];
        writer.write_feature(&VectorFeature {
            id: None,
            geometry: Some((GeometryKind::Polygon, &area.polygon)),
            attributes: &attributes,
        })?;
    }
    for point in &found.points {
        let [a, b] = point.faces.map(|face| [face]);
        let [a, b] = [&a, &b].map(|face| AttributeValue::PerSegment(face));
        let attributes = [AttributeValue::Text("point"), none, none, none, a, a, b, b];
        writer.write_feature(&VectorFeature {
            id: None,
            geometry: Some((GeometryKind::Point, &[vec![point.point]])),
            attributes: &attributes,
        })?;
    }
    a.check_unchanged()?;
    b.check_unchanged()?;
    writer.finish(progress).map(|()| IntersectionSummary::of(found))
}

/// Returns the minimum and maximum x and y of the intersection.
fn bounds(found: &SurfaceIntersection) -> Option<[[f64; 2]; 2]> {
    let points = found.all_points().map(|[x, y, _]| [*x, *y]);
    points.map(|point| [point; 2]).reduce(|[low, high], [point, _]| {
        [[low[0].min(point[0]), low[1].min(point[1])], [high[0].max(point[0]), high[1].max(point[1])]]
    })
}
