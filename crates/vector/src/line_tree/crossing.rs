//! Line crossings.

use std::collections::BTreeSet;
use std::path::Path;

use super::joined::{JoinedLayer, JoinedPoint, locator_of};
use crate::export::{AttributeType, AttributeValue, VectorFormat};
use crate::import::feature::{Feature, FeatureGeometry, open_features};
use crate::zonal::options_over;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_lines::LineTree;

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

/// Finds the lines of a tree that the lines of a file cross or touch. With an output, a point is
/// written for each pair of segments with a common point. It has the attributes of the file's
/// feature, the number of the tree's feature (`line`, from 0), and all or some of that one's
/// attributes. Lines are transformed to the tree's coordinate system, which the points have, too.
///
/// # Errors
/// If a feature is not a line, its coordinate system is not supported, an attribute name is
/// unknown, a file cannot be read, or the output cannot be written.
pub fn join_crossing_lines(
    tree: &LineTree,
    lines: &Path,
    names: Option<&[String]>,
    output: Option<(Output, VectorFormat)>,
    progress: &dyn Progress,
) -> Result<CrossingSummary> {
    let mut reader = open_features(lines, &options_over(&tree.metadata().frame))?;
    let locator = locator_of(tree, lines, &*reader, progress)?;
    let own = [("line", AttributeType::Integer)];
    // All crossings lie on lines of the tree.
    let mut bounds = || Ok(tree.bounds()?.unwrap_or_default());
    // Crossings are in the coordinate system of the tree, or in that of the file if the tree has
    // none.
    let crs = tree.metadata().frame.crs.clone().or_else(|| reader.schema().crs.clone());
    let mut joined = JoinedLayer::new(tree, names, (reader.schema(), &own), output, (crs, &mut bounds))?;
    let count = reader.schema().count;
    let mut summary = CrossingSummary::default();
    let mut crossed = BTreeSet::new();
    loop {
        let (mut features, mut all, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        let mut vertices = 0;
        while vertices < TOGETHER && features.len() < TOGETHER {
            let Some(mut feature) = reader.next()? else { break };
            summary.lines += 1;
            for line in lines_of(lines, summary.lines, &mut feature)? {
                for line in locator.lines(line) {
                    vertices += line.len();
                    owners.push(features.len());
                    all.push(line);
                }
            }
            features.push(feature);
        }
        if features.is_empty() {
            break;
        }
        let found = tree.crossings(&all, &SilentProgress(progress))?;
        summary.crossings += found.len() as u64;
        crossed.extend(found.iter().map(|crossing| crossing.feature));
        let point = |crossing: &spinney_lines::LineCrossing| JoinedPoint {
            // One feature may yield several points.
            id: None,
            feature: &features[owners[crossing.line]],
            geometry: Some(FeatureGeometry::Points(vec![crossing.position])),
            line: Some(crossing.feature),
            own: vec![AttributeValue::Integer(crossing.feature as i64)],
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

/// Takes the lines out of a feature.
fn lines_of(path: &Path, number: u64, feature: &mut Feature) -> Result<Vec<Vec<[f64; 2]>>> {
    match feature.geometry.take() {
        None => Ok(Vec::new()),
        Some(FeatureGeometry::Lines(lines)) => Ok(lines),
        Some(_) => {
            let advice = "crossings can be queried with lines only";
            Err(Error::unsupported(path, format!("feature {number}, which is not a line,"), advice))
        }
    }
}
