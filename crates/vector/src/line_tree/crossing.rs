//! Line crossings.

use std::collections::BTreeSet;
use std::path::Path;

use super::in_plane;
use super::joined::{JoinedLayer, JoinedPoint, locator_of};
use crate::export::{AttributeType, AttributeValue, VectorFormat};
use crate::import::feature::open_features;
use crate::zonal::options_over;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_lines::{LineCrossing, LineTree};

/// Crossings of lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CrossingSummary {
    /// Number of query features.
    pub lines: u64,
    /// Ascending numbers of the tree's features that they cross or touch.
    pub features: Vec<u64>,
    /// Number of pairs of segments that cross or touch.
    pub crossings: u64,
}

/// Number of vertices of lines that are queried at a time.
const TOGETHER: usize = 1 << 16;

/// Finds the lines of a tree that the lines of a file cross or touch, or that are at most the
/// distance `within` from them. With an output, a point is written for each such pair of segments.
/// It has the attributes of the file's feature, the number of the tree's feature (`line`, from 0),
/// with a distance that one (`distance`), and all or some attributes of the tree's feature. Lines
/// are transformed to the tree's coordinate system, which the points have, too. A feature without
/// heights crosses lines at any height.
///
/// # Errors
/// If a feature is not a line, its coordinate system is not supported, an attribute name is
/// unknown, a file cannot be read, or the output cannot be written.
pub fn join_crossing_lines(
    tree: &LineTree,
    (lines, within): (&Path, f64),
    names: Option<&[String]>,
    output: Option<(Output, VectorFormat)>,
    progress: &dyn Progress,
) -> Result<CrossingSummary> {
    let mut reader = open_features(lines, &options_over(&tree.metadata().frame))?;
    let locator = locator_of(tree, lines, &*reader, progress)?;
    let mut own = vec![("line", AttributeType::Integer)];
    own.extend((within > 0.0).then_some(("distance", AttributeType::Number)));
    // All positions are near lines of the tree.
    let mut bounds = || {
        let [low, high] = in_plane(tree.bounds()?);
        Ok([low.map(|at| at - within), high.map(|at| at + within)])
    };
    let has_z = tree.grid().axes() == 3;
    // Crossings are in the coordinate system of the tree, or in that of the file if the tree has
    // none.
    let crs = tree.metadata().frame.crs.clone().or_else(|| reader.schema().crs.clone());
    let mut joined =
        JoinedLayer::new(tree, names, (reader.schema(), &own), output, (crs, has_z, &mut bounds))?;
    let count = reader.schema().count;
    let mut summary = CrossingSummary::default();
    let mut crossed = BTreeSet::new();
    loop {
        let (mut features, mut all, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        let mut vertices = 0;
        while vertices < TOGETHER && features.len() < TOGETHER {
            let Some(mut feature) = reader.next()? else { break };
            summary.lines += 1;
            let own = feature.take_lines().map_err(|found| {
                let found = format!("feature {}, which is {found} and not a line,", summary.lines);
                Error::unsupported(lines, found, "crossings can be queried with lines only")
            })?;
            for line in own.into_iter().flat_map(|line| locator.lines(line)) {
                vertices += line.len();
                owners.push(features.len());
                all.push(line);
            }
            features.push(feature);
        }
        if features.is_empty() {
            break;
        }
        let found = tree.crossings(&all, within, &SilentProgress(progress))?;
        summary.crossings += found.len() as u64;
        crossed.extend(found.iter().map(|crossing| crossing.feature));
        let point = |crossing: &LineCrossing| {
            let mut own = vec![AttributeValue::Integer(crossing.feature as i64)];
            own.extend((within > 0.0).then_some(AttributeValue::Number(crossing.distance)));
            JoinedPoint {
                // One feature may yield several points.
                id: None,
                feature: &features[owners[crossing.line]],
                position: Some(crossing.position),
                line: Some(crossing.feature),
                own,
            }
        };
        for found in found.chunks(TOGETHER) {
            progress.check()?;
            joined.write(found.iter().map(point).collect())?;
        }
        progress.advance(features.len() as u64, count.unwrap_or(summary.lines));
    }
    joined.finish(progress)?;
    summary.features = crossed.into_iter().collect();
    Ok(summary)
}
