//! `spinney section MODEL MODEL`: what the surfaces of two exact models have in common.

use anyhow::{Context as _, Result, bail};
use spinney::Progress as _;
use spinney::brep::surface_intersection::{LineKind, SurfaceIntersection, surface_intersection};
use spinney::brep::{ExactModel, Faces};
use spinney::export::vector::{
    AttributeType, AttributeValue, GeometryKind, VectorFormat, VectorLayer, VectorWriter,
};

use super::Args;
use crate::cli::Global;
use crate::cli::report::Work;

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

/// Writes what they have in common; says what there is.
pub(super) fn write(
    args: &Args,
    [a, b]: [&ExactModel; 2],
    format: VectorFormat,
    global: &Global,
) -> Result<String> {
    if args.flat {
        bail!("--flat is for planes: what two models have in common lies in none");
    }
    let work = Work::start(global, "faces")?;
    let found = surface_intersection(a, b, args.memory.bytes, &work)?;
    let layer = VectorLayer {
        name: "intersection".into(),
        kind: None,
        has_z: true,
        attributes: ATTRIBUTES.map(|(name, kind)| (name.into(), kind)).to_vec(),
        crs: a.crs().or(b.crs()).cloned(),
        bounds: bounds(&found).map_or_else(|| a.bounds().map(|bounds| bounds.map(|[x, y, _]| [x, y])), Ok)?,
    };
    let write = || -> Result<()> {
        let remark = layer.remark(format);
        let mut writer = VectorWriter::create(args.limit.create(&args.output)?, format, layer)?;
        remark.iter().for_each(|remark| work.warn(&args.output, remark));
        let none = AttributeValue::None;
        for line in &found.lines {
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
            writer.write_as(GeometryKind::Line, line, &attributes)?;
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
            writer.write_as(GeometryKind::Polygon, &area.polygon, &attributes)?;
        }
        for point in &found.points {
            let [a, b] = point.faces.map(|face| [face]);
            let [a, b] = [&a, &b].map(|face| AttributeValue::PerSegment(face));
            let attributes = [AttributeValue::Text("point"), none, none, none, a, a, b, b];
            writer.write_as(GeometryKind::Point, &[vec![point.point]], &attributes)?;
        }
        a.check_unchanged()?;
        b.check_unchanged()?;
        Ok(writer.finish()?)
    };
    write().with_context(|| format!("cannot write {}", args.output.display()))?;
    work.finish();
    let lines = |kind: LineKind| {
        let lines = found.lines.iter().filter(|line| line.kind == kind);
        lines.fold((0, 0.0), |(count, length), line| (count + 1, length + line.length()))
    };
    let ((crossing, length), (touching, touch_length)) = (lines(LineKind::Crossing), lines(LineKind::Touch));
    let area = found.areas.iter().fold(0.0, |sum, area| sum + area.polygon.area);
    Ok(format!(
        "{crossing} lines where surfaces pass through each other (length {length}), {touching} where they touch \
         ({touch_length}), {} areas ({area}), {} points",
        found.areas.len(),
        found.points.len()
    ))
}

/// Least and greatest x and y of what was found.
fn bounds(found: &SurfaceIntersection) -> Option<[[f64; 2]; 2]> {
    let points = found.all_points().map(|[x, y, _]| [*x, *y]);
    points.map(|point| [point; 2]).reduce(|[low, high], [point, _]| {
        [[low[0].min(point[0]), low[1].min(point[1])], [high[0].max(point[0]), high[1].max(point[1])]]
    })
}
