//! Join of points with their nearest lines.

use std::path::Path;

use super::joined::{JoinedLayer, JoinedPoint, locator_of};
use crate::export::{AttributeType, AttributeValue, VectorFormat, bounds_of};
use crate::import::feature::{Feature, FeatureGeometry, FeatureOptions, open_features};
use crate::zonal::options_over;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_lines::{LineTree, NearLine, NearestLines};

/// Result of joining points with lines.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JoinSummary {
    /// Number of points.
    pub points: u64,
    /// Number of points with a line near enough.
    pub joined: u64,
    /// Sum of their distances.
    pub sum: f64,
    /// Maximum of their distances.
    pub most: f64,
}

/// Number of points that are joined at a time.
const TOGETHER: usize = 1 << 16;
/// Memory for lines cached between batches, in bytes.
const MEMORY: u64 = 256 << 20;

/// Joins each point of a file with its nearest line within a distance. Its attributes are extended
/// by the number of the line's feature (`line`, from 0), the distance, and all or some of that
/// feature's attributes. With an output, the points are written to it. Points are transformed to
/// the tree's coordinate system, in which distances are; the output keeps their own coordinates.
///
/// # Errors
/// If a feature is not a single point, or has no position in the tree's coordinate system, a
/// coordinate system is not supported, an attribute name is unknown, a file cannot be read, or the
/// output cannot be written.
pub fn join_nearest_lines(
    tree: &LineTree,
    points: &Path,
    within: f64,
    names: Option<&[String]>,
    output: Option<(Output, VectorFormat)>,
    progress: &dyn Progress,
) -> Result<JoinSummary> {
    let reading = options_over(&tree.metadata().frame);
    let mut reader = open_features(points, &reading)?;
    let locator = locator_of(tree, points, &*reader, progress)?;
    let own = [("line", AttributeType::Integer), ("distance", AttributeType::Number)];
    // Row ids must be unique integers, which only another such table guarantees.
    let is_table = |path: &Path| path.to_string_lossy().to_ascii_lowercase().contains(".gpkg");
    let keeps_ids = !matches!(output, Some((_, VectorFormat::GeoPackage))) || is_table(points);
    // The points are written in the coordinates of their file.
    let crs = reader.schema().crs.clone().or_else(|| tree.metadata().frame.crs.clone());
    let mut joined = JoinedLayer::new(
        tree,
        names,
        (reader.schema(), &own),
        output,
        (crs, &mut || bounds_in(points, &reading, progress)),
    )?;
    let count = reader.schema().count;
    let nearest = NearestLines::new(tree, MEMORY)?;
    let mut summary = JoinSummary::default();
    loop {
        let (mut features, mut positions) = (Vec::new(), Vec::new());
        while features.len() < TOGETHER {
            let Some(feature) = reader.next()? else { break };
            let number = summary.points + features.len() as u64 + 1;
            if let Some(position) = position_of(points, number, &feature)? {
                positions
                    .push(locator.position(position).ok_or_else(|| no_position(points, number, position))?);
            }
            features.push(feature);
        }
        if features.is_empty() {
            break;
        }
        let found = nearest.find(&positions, 1, within, &SilentProgress(progress))?;
        let mut found = found.into_iter().map(|near| near.first().copied());
        let near: Vec<Option<NearLine>> = features
            .iter()
            .map(|feature| feature.geometry.as_ref().and_then(|_| found.next().flatten()))
            .collect();
        for near in near.iter().flatten() {
            summary.joined += 1;
            summary.sum += near.distance;
            summary.most = summary.most.max(near.distance);
        }
        summary.points += features.len() as u64;
        let geometries: Vec<_> = features.iter_mut().map(|feature| feature.geometry.take()).collect();
        let parts = features.iter().zip(geometries).zip(near);
        let points = parts.map(|((feature, geometry), near)| JoinedPoint {
            id: feature.id.as_ref().filter(|_| keeps_ids),
            feature,
            geometry,
            line: near.map(|near| near.feature),
            own: vec![
                near.map_or(AttributeValue::None, |near| AttributeValue::Integer(near.feature as i64)),
                near.map_or(AttributeValue::None, |near| AttributeValue::Number(near.distance)),
            ],
        });
        joined.write(points.collect())?;
        progress.advance(features.len() as u64, count.unwrap_or(summary.points));
    }
    joined.finish(progress)?;
    Ok(summary)
}

/// Returns the position of a feature; `None` without a geometry.
fn position_of(path: &Path, number: u64, feature: &Feature) -> Result<Option<[f64; 2]>> {
    match &feature.geometry {
        None => Ok(None),
        Some(FeatureGeometry::Points(points)) if points.len() == 1 => Ok(Some(points[0])),
        Some(_) => {
            let advice = "nearest lines can be queried with points only";
            Err(Error::unsupported(path, format!("feature {number}, which is not a single point,"), advice))
        }
    }
}

/// Error for a feature outside the domain of the tree's coordinate system.
fn no_position(path: &Path, number: u64, [x, y]: [f64; 2]) -> Error {
    let found =
        format!("feature {number} at {x},{y}, which is outside the domain of the tree's coordinate system,");
    Error::unsupported(path, found, "remove it, or correct it")
}

/// Returns the bounds of all points of a file.
fn bounds_in(path: &Path, options: &FeatureOptions, progress: &dyn Progress) -> Result<[[f64; 2]; 2]> {
    let mut reader = open_features(path, options)?;
    let mut bounds: Option<[[f64; 2]; 2]> = None;
    let mut number = 0u64;
    while let Some(feature) = reader.next()? {
        number += 1;
        if number.is_multiple_of(1 << 14) {
            progress.check()?;
        }
        if let Some(position) = position_of(path, number, &feature)? {
            let around = bounds.get_or_insert([position; 2]);
            let corners = [around[0], around[1], position];
            *around = bounds_of(&mut corners.iter());
        }
    }
    Ok(bounds.unwrap_or_default())
}
