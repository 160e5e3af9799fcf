//! `spinney combine` of polygons.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::import::feature::{FeatureFilter, FeatureOptions};
use spinney::raw::import::feature::read_polygons;
use spinney::raw::overlay::{
    OverlayOperation, OverlayReport, OverlayRequest, overlay_features, read_polygon_layers,
};

use super::Global;
use super::args::{Memory, check_output, vector_format};
use super::report::{Work, report_output};

/// A region that limits a result.
pub(super) enum Region {
    /// Minimum and maximum x and y, in coordinates of the first file.
    Box([f64; 2], [f64; 2]),
    /// A polygon file in the coordinates of the first one.
    Polygons(PathBuf),
}

/// A request for an overlay of polygon files.
pub(super) struct Question<'a> {
    pub(super) name: &'a str,
    pub(super) files: &'a [PathBuf],
    /// Conditions for the features of all files.
    pub(super) filter: FeatureFilter,
    pub(super) within: Option<Region>,
    pub(super) snap: Option<f64>,
    pub(super) memory: Memory,
}

/// Writes the result of an overlay operation on the polygons of files.
pub(super) fn run(question: &Question<'_>, path: &Path, global: &Global) -> Result<()> {
    let start = Instant::now();
    let Question { name, files, filter, within, snap, memory } = question;
    let operation = OverlayOperation::named(name)
        .with_context(|| format!("{name} is for trees; polygons have no values (see --help)"))?;
    check_output(files.iter().map(PathBuf::as_path), path)?;
    let format = vector_format(None, path)?;
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
