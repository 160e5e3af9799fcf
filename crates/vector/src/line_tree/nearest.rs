//! Join of points with their nearest lines.

use std::path::Path;

use super::in_plane;
use super::joined::{JoinedLayer, JoinedPoint, locator_of};
use crate::export::{AttributeType, AttributeValue, VectorFormat};
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
/// Distances are those in space if the tree and the point have heights of the unit of x and y,
/// otherwise those in x and y.
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
    // The properties of the layer must be known before the first point is written.
    let extent = match &output {
        Some((_, format)) => PointExtent::read(points, &reading, format.wants_bounds(), progress)?,
        None => PointExtent::default(),
    };
    let has_z = extent.has_heights && !extent.lacks_heights;
    let mut dropped = 0u64;
    let mut joined = JoinedLayer::new(
        tree,
        names,
        (reader.schema(), &own),
        output,
        (crs, has_z, &mut || Ok(in_plane(extent.bounds))),
    )?;
    let count = reader.schema().count;
    let nearest = NearestLines::new(tree, MEMORY)?;
    let mut summary = JoinSummary::default();
    loop {
        // Features with their positions in the file, and those with a position in the tree.
        let (mut features, mut own, mut positions) = (Vec::new(), Vec::new(), Vec::new());
        while features.len() < TOGETHER {
            let Some(feature) = reader.next()? else { break };
            let number = summary.points + features.len() as u64 + 1;
            let position = position_of(points, number, &feature)?;
            if let Some([x, y, z]) = position {
                dropped += u64::from(!z.is_nan() && !has_z);
                let [x, y] = locator.position([x, y]).ok_or_else(|| no_position(points, number, [x, y]))?;
                positions.push([x, y, z]);
            }
            own.push(position);
            features.push(feature);
        }
        if features.is_empty() {
            break;
        }
        let found = nearest.find(&positions, 1, within, &SilentProgress(progress))?;
        let mut found = found.into_iter().map(|near| near.first().copied());
        let near: Vec<Option<NearLine>> =
            own.iter().map(|position| position.and_then(|_| found.next().flatten())).collect();
        for near in near.iter().flatten() {
            summary.joined += 1;
            summary.sum += near.distance;
            summary.most = summary.most.max(near.distance);
        }
        summary.points += features.len() as u64;
        let parts = features.iter().zip(own).zip(near);
        let points = parts.map(|((feature, position), near)| JoinedPoint {
            id: feature.id.as_ref().filter(|_| keeps_ids),
            feature,
            position,
            line: near.map(|near| near.feature),
            own: vec![
                near.map_or(AttributeValue::None, |near| AttributeValue::Integer(near.feature as i64)),
                near.map_or(AttributeValue::None, |near| AttributeValue::Number(near.distance)),
            ],
        });
        joined.write(points.collect())?;
        progress.advance(features.len() as u64, count.unwrap_or(summary.points));
    }
    let is_written = joined.finish(progress)?;
    if dropped > 0 && is_written {
        let text = format!("the heights of {dropped} points are not written, since other points have none");
        progress.warn(points, &text);
    }
    Ok(summary)
}

/// Returns the position of a feature, with a z of NaN without a height; `None` without a geometry.
fn position_of(path: &Path, number: u64, feature: &Feature) -> Result<Option<[f64; 3]>> {
    match &feature.geometry {
        None => Ok(None),
        Some(FeatureGeometry::Points(points)) if points.len() == 1 => {
            let [x, y] = points[0];
            Ok(Some([x, y, feature.heights.of_points.first().copied().unwrap_or(f64::NAN)]))
        }
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

/// Bounds of the points of a file, and whether some have heights, and some have none.
#[derive(Default)]
struct PointExtent {
    bounds: Option<[[f64; 3]; 2]>,
    has_heights: bool,
    lacks_heights: bool,
}

impl PointExtent {
    /// Reads all points, or without bounds those before the first one that has no height.
    fn read(
        path: &Path,
        options: &FeatureOptions,
        with_bounds: bool,
        progress: &dyn Progress,
    ) -> Result<PointExtent> {
        let mut reader = open_features(path, options)?;
        let mut extent = PointExtent::default();
        let mut number = 0u64;
        while with_bounds || !extent.lacks_heights {
            let Some(feature) = reader.next()? else { break };
            number += 1;
            if number.is_multiple_of(1 << 14) {
                progress.check()?;
            }
            let Some(position) = position_of(path, number, &feature)? else { continue };
            *if position[2].is_nan() { &mut extent.lacks_heights } else { &mut extent.has_heights } = true;
            let [low, high] = extent.bounds.get_or_insert([position; 2]);
            for axis in 0..3 {
                (low[axis], high[axis]) = (low[axis].min(position[axis]), high[axis].max(position[axis]));
            }
        }
        Ok(extent)
    }
}
