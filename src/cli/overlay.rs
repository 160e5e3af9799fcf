//! `spinney combine` of polygons.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::export::VectorFormat;
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::raw::import::feature::read_polygons;
use spinney::raw::overlay::{
    OverlayOperation, OverlayReport, OverlayRequest, overlay_features, read_polygon_layers,
};

use super::Global;
use super::args::{Memory, VECTOR_ENDINGS, check_output};
use super::report::{Work, report_output};

/// A region that limits a result.
pub(super) enum Region {
    /// Minimum and maximum x and y, in coordinates of the first file.
    Box([f64; 2], [f64; 2]),
    /// A polygon file in the coordinates of the first one.
    Polygons(PathBuf),
}

/// A request for an overlay of polygon files.
pub(super) struct PairQuery<'a> {
    pub(super) name: &'a str,
    pub(super) files: &'a [PathBuf],
    /// Conditions for the features of all files.
    pub(super) filter: FeatureFilter,
    pub(super) within: Option<Region>,
    pub(super) snap: Option<f64>,
    pub(super) memory: Memory,
}

/// Writes the result of an overlay operation on the polygons of files.
pub(super) fn run(query: &PairQuery<'_>, path: &Path, global: &Global) -> Result<()> {
    let start = Instant::now();
    let PairQuery { name, files, filter, within, snap, memory } = query;
    let operation = OverlayOperation::named(name).with_context(|| {
        format!("{name}: works only with trees; `spinney help combine` lists the operations on polygons")
    })?;
    check_output(files.iter().map(PathBuf::as_path), path)?;
    let format = VectorFormat::of(path).with_context(|| {
        let name = path.display();
        format!(
            "{name}: the inputs are polygon files, so the result is one, too: use {VECTOR_ENDINGS}; for a tree of cells, build one of an input first"
        )
    })?;
    let memory = memory.bytes;
    let work = Work::start(global, "edges")?;
    let layers = read_polygon_layers(files, filter, memory)?;
    let counts: Vec<usize> = layers.iter().map(|(_, layer)| layer.features.len()).collect();
    let mut request = OverlayRequest { snap: *snap, memory, ..OverlayRequest::new(operation) };
    match within {
        Some(Region::Box(low, high)) => request.within_box(*low, *high),
        Some(Region::Polygons(file)) => {
            let region = read_polygons(file, &FeatureOptions { memory, ..FeatureOptions::default() })?;
            request.within = Some(region.into_parts());
        }
        None => {}
    }
    let report = overlay_features(layers, &request, global.access().create(path)?, format, &work)
        .with_context(|| format!("{}: cannot write", path.display()))?;
    work.finish();
    for (file, count) in files.iter().zip(counts) {
        global.report("input", format_args!("{}: {count} features", file.display()));
    }
    let OverlayReport { summary, parts, polygons, area, shared } = report;
    let (edges, crossings) = (summary.edges, summary.crossings);
    global.report("edges", format_args!("{edges}, with {crossings} crossings"));
    if summary.repeated_corners > 0 {
        global.report(
            "repaired",
            format_args!("{} vertices that repeat the previous one", summary.repeated_corners),
        );
    }
    if shared > 0 {
        let rule = "parts are in several features of one file, and have the attributes of the last";
        global.report("shared", format_args!("{shared} {rule}"));
    }
    let (cell, bound) = (summary.cell, summary.area_bound);
    global.report("grid", format_args!("{cell:e}; the error of areas is at most {bound:.3e}"));
    global.report("result", format_args!("{parts} features of {polygons} polygons, area {area}"));
    report_output(global, path, start);
    Ok(())
}
