//! `spinney combine` of polygons.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::import::feature::{FeatureFilter, FeatureOptions, PolygonLayer, open_features, read_polygons};
use spinney::io::Output;
use spinney::overlay::{OverlayOperation, OverlayReport, OverlayRequest, overlay_features};

use super::Global;
use super::args::{Memory, check_output, vector_format};
use super::report::{Work, report_output};

/// What a result is limited to.
pub(super) enum Region {
    /// Least and greatest x and y, in coordinates of the first file.
    Box([f64; 2], [f64; 2]),
    /// A file of polygons in the coordinates of the first one.
    Polygons(PathBuf),
}

/// What is asked of files of polygons.
pub(super) struct Question<'a> {
    pub(super) name: &'a str,
    pub(super) files: &'a [PathBuf],
    /// Conditions for the features of all of them.
    pub(super) filter: FeatureFilter,
    pub(super) within: Option<Region>,
    pub(super) snap: Option<f64>,
    pub(super) memory: Memory,
}

/// The conditions for each file: those on attributes that it has, which one of the files must have.
fn filters(files: &[PathBuf], filter: &FeatureFilter) -> Result<Vec<FeatureFilter>> {
    if filter.conditions.is_empty() {
        return Ok(vec![FeatureFilter::default(); files.len()]);
    }
    let mut is_known = vec![false; filter.conditions.len()];
    let mut filters = Vec::new();
    for file in files {
        let reader = open_features(file, &FeatureOptions::default())?;
        let mut own = FeatureFilter::default();
        for (condition, is_known) in filter.conditions.iter().zip(&mut is_known) {
            let single = FeatureFilter { conditions: vec![condition.clone()] };
            if single.names().all(|name| reader.schema().position(name).is_some()) {
                *is_known = true;
                own.conditions.push(condition.clone());
            }
        }
        filters.push(own);
    }
    // (A condition that no file knows is one that the first complains of.)
    for (condition, is_known) in filter.conditions.iter().zip(is_known) {
        if !is_known && let Some(first) = filters.first_mut() {
            first.conditions.push(condition.clone());
        }
    }
    Ok(filters)
}

/// Writes the polygons that an operation makes of those of some files.
pub(super) fn run(question: &Question<'_>, path: &Path, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Question { name, files, filter, within, snap, memory } = question;
    let operation = OverlayOperation::named(name)
        .with_context(|| format!("{name} is for trees; polygons have no values (see --help)"))?;
    check_output(files.iter().map(PathBuf::as_path), path)?;
    let format = vector_format(None, path)?;
    let memory = memory.bytes;
    let read = |file: &PathBuf, filter: &FeatureFilter| -> Result<(PathBuf, PolygonLayer)> {
        let options = FeatureOptions { memory, filter: filter.clone(), ..FeatureOptions::default() };
        Ok((file.clone(), read_polygons(file, &options)?))
    };
    let work = Work::start(global, "edges")?;
    let filters = filters(files, filter)?;
    let layers = files.iter().zip(&filters).map(|(file, filter)| read(file, filter));
    let layers = layers.collect::<Result<Vec<_>>>()?;
    let counts: Vec<usize> = layers.iter().map(|(_, layer)| layer.features.len()).collect();
    let mut request = OverlayRequest { snap: *snap, memory, ..OverlayRequest::new(operation) };
    match within {
        Some(Region::Box(low, high)) => request.within_box(*low, *high),
        Some(Region::Polygons(file)) => {
            let (_, region) = read(file, &FeatureFilter::default())?;
            request.within = Some(region.features.into_iter().flat_map(|feature| feature.parts).collect());
        }
        None => {}
    }
    let report = overlay_features(layers, &request, Output::create(path)?, format, &work)
        .with_context(|| format!("cannot make {}", path.display()))?;
    work.finish();
    for (file, count) in files.iter().zip(counts) {
        global.report("input", format_args!("{}: {count} features", file.display()));
    }
    let OverlayReport { summary, parts, polygons, area, shared } = report;
    let (edges, crossings) = (summary.edges, summary.crossings);
    global.report("edges", format_args!("{edges}, which cross in {crossings} places"));
    if summary.repeated_corners > 0 {
        global.report(
            "repaired",
            format_args!("{} corners that repeat the one before", summary.repeated_corners),
        );
    }
    if shared > 0 {
        let told = "parts are in several features of one file: attributes are those of the last";
        global.report("shared", format_args!("{shared} {told}"));
    }
    let (cell, bound) = (summary.cell, summary.area_bound);
    global.report("grid", format_args!("{cell:e}, on which areas are off by {bound:.3e} at most"));
    global.report("result", format_args!("{parts} features of {polygons} polygons, area {area}"));
    report_output(global, path, start);
    Ok(())
}
