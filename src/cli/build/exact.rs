//! `spinney build --brep`: exact models.

use std::path::PathBuf;

use anyhow::Result;
use spinney::Progress;
use spinney::import::mesh::{self, ExactOptions, ExactReport, Model, Repair};
use spinney::io::Output;

use super::solids::SolidArgs;
use super::{Common, Lines};

/// Models that are open, and what is to be made of them.
pub(super) struct ExactImport {
    models: Vec<Box<dyn Model>>,
    options: ExactOptions,
    description: Vec<(&'static str, String)>,
}

impl ExactImport {
    /// Opens models.
    pub(super) fn plan(inputs: &[PathBuf], solids: &SolidArgs, common: &Common) -> Result<ExactImport> {
        let models = mesh::open_all(inputs, common.memory.bytes)?;
        let mut options = ExactOptions::new();
        options.snap = solids.snap;
        options.close = solids.close;
        options.repair = solids.repair;
        options.leaf_size = solids.leaf_size.unwrap_or(options.leaf_size);
        options.up = solids.up.unwrap_or_default();
        options.unit = solids.unit.clone();
        options.crs = common.crs.clone();
        options.codec = common.packing.choice()?.codec;
        options.memory = common.memory.bytes;
        let of = |model: &dyn Model| {
            let info = model.info();
            let faces = info.faces.map_or(String::new(), |faces| format!(", {faces} faces"));
            ("input", format!("{}: {}{faces}", info.path.display(), info.format))
        };
        let description = models.iter().map(|model| of(&**model)).collect();
        Ok(ExactImport { models, options, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the file; returns lines about it.
    pub(super) fn build(self, output: Output, stats: bool, progress: &dyn Progress) -> Result<Lines> {
        Ok(lines(&mesh::import_exact(self.models, &self.options, output, progress)?, stats))
    }
}

fn repaired(done: &Repair, unit: &str) -> String {
    if done.rounds == 0 {
        return "nothing: the surface is in order".into();
    }
    let Repair { pairs, divided, removed, outside, outside_share, rounds, displacement, .. } = done;
    let lost = match outside {
        0 => String::new(),
        _ => format!(
            "; {outside} of those removed, {:.2} percent of the area, go around no place once or more and are LOST",
            outside_share * 100.0
        ),
    };
    format!(
        "{pairs} pairs of faces that met; {divided} faces divided and {removed} removed, in {rounds} rounds; new corners \
         moved by at most {displacement:e}{unit}{lost}"
    )
}

fn lines(report: &ExactReport, stats: bool) -> Lines {
    let unit = report.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    let grid = &report.grid;
    let moved = match report.displacement {
        0.0 => "no corner was moved".into(),
        most => format!("corners moved by at most {most:e}{unit}"),
    };
    let mut lines = vec![
        ("grid", format!("steps of {}{unit}, {} bits; {moved}", grid.width(), grid.bits)),
        ("faces", format!("{} of {} read", report.faces, report.read)),
    ];
    let counts = [
        ("cut", report.cut, "faces that the grid has bent, into triangles"),
        ("fanned", report.fanned, "faces that cross themselves, into triangles"),
        ("slivers", report.slivers, "faces have no area on the grid; they stay, and bound nothing"),
        ("collapsed", report.collapsed, "faces are points or lines on the grid, and are left out"),
    ];
    lines.extend(
        counts
            .into_iter()
            .filter(|(_, count, _)| *count > 0)
            .map(|(name, count, text)| (name, format!("{count} {text}"))),
    );
    if report.attributes > 0 {
        lines.push(("attributes", format!("of {} parts", report.attributes)));
    }
    if report.lost_columns > 0 {
        lines.push(("LOST", format!("{} columns of values of faces", report.lost_columns)));
    }
    let (boundaries, triangles) = report.closed;
    if boundaries > 0 {
        lines.push(("closed", format!("{boundaries} boundaries, with {triangles} triangles")));
    }
    if let Some(done) = &report.repair {
        lines.push(("repaired", repaired(done, &unit)));
    }
    let nodes = report.built.nodes.named();
    let nodes: Vec<String> =
        nodes.iter().filter(|(_, count)| *count > 0).map(|(name, count)| format!("{count} {name}")).collect();
    lines.push(("nodes", format!("{}: {}", report.built.nodes.total(), nodes.join(", "))));
    if stats {
        lines.extend(super::solids::stage_lines(&report.built.stages));
    }
    lines
}
