//! Lines that others cross.

use std::collections::BTreeSet;
use std::path::Path;

use super::joined::{Joined, JoinedPoint, locator_of};
use crate::export::{AttributeType, AttributeValue, VectorFormat};
use crate::import::feature::{Feature, FeatureGeometry, FeatureOptions, open_features};
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, SilentProgress};
use spinney_lines::LineTree;

/// Crossings of lines.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CrossingSummary {
    /// Number of features whose lines were asked for.
    pub lines: u64,
    /// Numbers of the features of the tree that they cross or touch; they ascend.
    pub features: Vec<u64>,
    /// Number of pairs of pieces that do.
    pub crossings: u64,
}

/// Vertices of lines that are asked for at a time.
const TOGETHER: usize = 1 << 16;

/// Finds what the lines of a file of features cross or touch in a tree of lines. With an output, a point is written for each pair of pieces between vertices that have a
/// place in common: the attributes of the file's feature, the number of the tree's feature (`line`, from 0), and the attributes of that one, or some of them. Lines in another coordinate
/// system are brought to the tree's, in which the points are.
///
/// # Errors
/// If a feature is no line, its system cannot be computed, there is no attribute of a name, a file cannot be read, or the output cannot be written.
pub fn join_crossing_lines(
    tree: &LineTree,
    lines: &Path,
    names: Option<&[String]>,
    output: Option<(Output, VectorFormat)>,
    progress: &dyn Progress,
) -> Result<CrossingSummary> {
    let mut reader = open_features(lines, &FeatureOptions::default())?;
    let locator = locator_of(tree, lines, &*reader, progress)?;
    let own = [("line", AttributeType::Integer)];
    // (All crossings lie on lines of the tree.)
    let mut bounds = || Ok(tree.bounds()?.unwrap_or_default());
    // (Crossings are on lines of the tree.)
    let crs = tree.metadata().frame.crs.clone().or_else(|| reader.schema().crs.clone());
    let mut joined = Joined::new(tree, names, (reader.schema(), &own), output, (crs, &mut bounds))?;
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
            // (Several points may come of one feature.)
            id: None,
            feature: &features[owners[crossing.line]],
            geometry: Some(FeatureGeometry::Points(vec![crossing.place])),
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

/// The lines of a feature, which it has no more.
fn lines_of(path: &Path, number: u64, feature: &mut Feature) -> Result<Vec<Vec<[f64; 2]>>> {
    match feature.geometry.take() {
        None => Ok(Vec::new()),
        Some(FeatureGeometry::Lines(lines)) => Ok(lines),
        Some(_) => {
            let advice = "crossings are asked for with lines alone";
            Err(Error::unsupported(path, format!("feature {number}, which is no line,"), advice))
        }
    }
}
