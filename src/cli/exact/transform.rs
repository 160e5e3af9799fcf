//! `spinney transform` of exact models.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use spinney::Output;
use spinney::brep::{DetailLevel, Faces, Motion, TransformOptions};
use spinney::raw::brep::TransformReport;
use spinney::raw::ops::AffineMap;
use spinney::{ExactModel, ViewOperation};

use super::super::Global;
use super::super::args::OutputLimit;
use super::super::report::{Work, report_output};
use super::{report_result, unit};

/// A model, and the operations that transform it.
pub(in crate::cli) struct Moving<'a> {
    pub(in crate::cli) model: &'a ExactModel,
    pub(in crate::cli) steps: &'a [ViewOperation],
    pub(in crate::cli) options: TransformOptions,
}

/// Writes a transformed model.
pub(in crate::cli) fn transform(
    moving: Moving<'_>,
    path: &Path,
    limit: &OutputLimit,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let Moving { model, steps, mut options } = moving;
    let levels = options.levels;
    if levels && steps.is_empty() && options.snap.is_none() && options.unit.is_none() {
        let work = Work::start(global, "faces")?;
        let output = (limit.create_tree(path, global)?, options.codec);
        let found = spinney::brep::add_levels(model, output, options.memory, &work)?;
        work.finish();
        global.report("input", format_args!("{}: {} faces", model.path().display(), model.len()));
        report_levels(&found, model, global);
        report_output(global, path, start);
        return Ok(());
    }
    let mut maps = Vec::new();
    for step in steps {
        match step {
            ViewOperation::Crs(crs) => options.crs = Some(crs.clone()),
            step => maps.push(step.clone()),
        }
    }
    let motion = motion(&maps)?;
    let operations: Vec<String> = steps.iter().map(ViewOperation::to_string).collect();
    options.note = (!operations.is_empty()).then(|| operations.join(", "));
    let work = Work::start(global, "faces")?;
    let output = limit.create_tree(path, global)?;
    let transformed = |output: Output| spinney::brep::transform(model, &motion, &options, output, &work);
    let report = match levels {
        true => spinney::brep::with_levels(output, options.memory, &work, transformed)?,
        false => transformed(output)?,
    };
    work.finish();
    global.report("input", format_args!("{}: {} faces", model.path().display(), report.before));
    let unit = options.unit.map_or_else(|| unit(model), |unit| format!(" {unit}"));
    report_transformed(&report, &unit, model.is_unbounded(), global);
    report_output(global, path, start);
    Ok(())
}

/// Returns the composition of the operations as a map of the world.
pub(super) fn motion(steps: &[ViewOperation]) -> Result<Motion> {
    let map =
        steps.iter().try_fold(AffineMap::IDENTITY, |map, step| step.as_map().map(|next| map.then(&next)))?;
    Ok(Motion::from_rows(map.to_rows())?)
}

/// Reports levels of detail, from the finest that is not exact.
pub(super) fn report_levels(levels: &[DetailLevel], model: &ExactModel, global: &Global) {
    let (unit, width) = (unit(model), model.grid().width());
    for (number, level) in levels.iter().enumerate().rev().skip(1) {
        let DetailLevel { faces, error, .. } = level;
        global.report(
            &format!("level {number}"),
            format_args!("{faces} faces, at most {:.3e}{unit} from the surface", error * width),
        );
    }
}

fn report_transformed(report: &TransformReport, unit: &str, is_unbounded: bool, global: &Global) {
    let TransformReport { is_exact, displacement, grid, cut, collapsed, rounded, after, .. } = report;
    let moved = match (is_exact, displacement) {
        (true, 0.0) => "exactly".into(),
        (true, _) => {
            format!("exactly, but {displacement}{unit} off: translations are rounded to grid units")
        }
        (false, 0.0) => "to a new grid, exactly".into(),
        (false, _) => format!("to a new grid, which rounds by at most {displacement}{unit}"),
    };
    global.report("vertices", format_args!("moved {moved}"));
    global.report("grid", format_args!("units of {}{unit}, {} bits", grid.width(), grid.bits));
    if *cut > 0 {
        global.report(
            "cut",
            format_args!("{cut} faces into triangles: their vertices are not coplanar on the grid"),
        );
    }
    if *collapsed > 0 {
        global.report("left out", format_args!("{collapsed} faces that are points or lines on the grid"));
    }
    if *rounded > 0 {
        global.report("ROUNDED", format_args!("{rounded} faces with off-grid vertices, to the grid"));
    }
    report_result(*after, is_unbounded, &report.built, global);
}
