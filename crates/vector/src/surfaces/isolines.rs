//! Isolines of triangulated surfaces as features.

use crate::export::{
    AttributeType, AttributeValue, ContourFeatures, GeometryKind, Smoothed, VectorFormat, VectorLayer,
    VectorWriter,
};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result};
use spinney_crs::Crs;
use spinney_engine::query::{ContourLevels, Levels};
use spinney_tin::Tin;

/// Writes the isolines of a surface like raster contours, with the attribute value. They are exact
/// on its triangles. Returns the numbers of lines and points.
///
/// # Errors
/// If levels are invalid or too many, areas are requested, the output cannot be written, or on
/// cancellation.
pub fn export_isolines(
    tin: &Tin,
    crs: Option<Crs>,
    levels: &ContourLevels,
    features: &ContourFeatures,
    output: Output,
    format: VectorFormat,
    progress: &dyn Progress,
) -> Result<(u64, u64)> {
    if features.filled {
        return Err(Error::invalid("contours of a surface", "filled areas", "lines"));
    }
    let levels = Levels::new(levels)?.reached(tin.range().unwrap_or_default())?;
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for [x, y, _] in tin.vertices() {
        bounds = [[bounds[0][0].min(x), bounds[0][1].min(y)], [bounds[1][0].max(x), bounds[1][1].max(y)]];
    }
    let layer = VectorLayer {
        name: "contours".into(),
        kind: Some(GeometryKind::Line),
        is_multi: false,
        has_z: features.has_z,
        attributes: vec![("value".into(), AttributeType::Number)],
        crs,
        bounds,
    };
    let mut writer = VectorWriter::create(output, format, layer)?;
    let (mut count, mut points) = (0, 0);
    tin.isolines(&levels, &mut |line| {
        progress.check()?;
        count += 1;
        points += line.points.len() as u64;
        let line_points = [line.points.iter().map(|[x, y]| [*x, *y, line.level]).collect()];
        let smoothed = Smoothed::new(&line_points, line.is_closed(), features.smooth);
        writer.write(&smoothed, &[AttributeValue::Number(line.level)])
    })?;
    writer.finish(progress).map(|()| (count, points))
}
