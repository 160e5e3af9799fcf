//! `spinney build --brep`: exact models.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};
use spinney::import::feature::FeatureFilter;
use spinney::import::mesh::ExactOptions;
use spinney::raw::brep::Repair;
use spinney::raw::import::feature::choose_objects;
use spinney::raw::import::mesh::{self, ExactReport, Model};
use spinney::{Output, Progress};

use super::solids::SolidArgs;
use super::{Common, Lines};

/// Open models, and the options for an exact model of them.
pub(super) struct ExactImport {
    models: Vec<Box<dyn Model>>,
    options: ExactOptions,
    levels: bool,
    description: Vec<(&'static str, String)>,
}

impl ExactImport {
    /// Opens models.
    pub(super) fn plan(
        inputs: &[PathBuf],
        solids: &SolidArgs,
        filter: Option<&FeatureFilter>,
        common: &Common,
    ) -> Result<ExactImport> {
        if solids.deviation.is_some() {
            bail!("--deviation: works only with primitives (.csg, .bpt); models have planar faces");
        }
        let fitting = [
            "--brep",
            "--snap",
            "--close",
            "--repair",
            "--inside",
            "--skip-bad",
            "--leaf-size",
            "--levels",
            "--up",
            "--unit",
            "--crs",
            "--codec",
            "--where",
        ];
        common.given.check("exact models", &fitting)?;
        let models = spinney::raw::import::mesh::open_all_with(inputs, common.memory.bytes, &common.access)?;
        let mut options = ExactOptions::new();
        options.snap = solids.snap;
        options.close = solids.close;
        options.repair = solids.repair;
        options.parts = filter.map(|filter| chosen_parts(&models, filter)).transpose()?;
        options.skip_bad = solids.skip_bad;
        options.inside = solids.inside.unwrap_or_default();
        options.leaf_size = solids.leaf_size.unwrap_or(options.leaf_size);
        options.up = solids.up.unwrap_or_default();
        options.unit = solids.unit.clone();
        options.crs = common.crs.clone();
        options.codec = common.packing.choice().codec;
        options.memory = common.memory.bytes;
        let of = |model: &dyn Model| {
            let info = model.info();
            let faces = info.faces.map_or(String::new(), |faces| format!(", {faces} faces"));
            ("input", format!("{}: {}{faces}", info.path.display(), info.format))
        };
        let description = models.iter().map(|model| of(&**model)).collect();
        Ok(ExactImport { models, options, levels: solids.levels, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the file. Returns lines about it.
    pub(super) fn build(self, output: Output, stats: bool, progress: &dyn Progress) -> Result<Lines> {
        let ExactImport { models, options, levels, .. } = self;
        let import = |output: Output| spinney::import::mesh::import_exact(models, &options, output, progress);
        let report = match levels {
            true => spinney::brep::with_levels(output, options.memory, progress, import)?,
            false => import(output)?,
        };
        Ok(lines(&report, stats))
    }
}

/// Returns the indices of the model parts that satisfy the conditions.
fn chosen_parts(models: &[Box<dyn Model>], filter: &FeatureFilter) -> Result<BTreeSet<u32>> {
    let (names, about) = mesh::parts_of(models);
    let files = || models.iter().map(|model| model.info().path.display().to_string()).collect::<Vec<_>>();
    let found = choose_objects(filter, &names, &|part| Ok(about[part as usize].clone()))
        .with_context(|| files().join(", "))?;
    if found.is_empty() {
        bail!("{}: --where {filter}: no object satisfies the conditions", files().join(", "));
    }
    Ok(found)
}

/// Returns lines about a repair.
fn repaired(done: &Repair, unit: &str) -> Lines {
    if done.is_nothing() {
        return vec![("repaired", "nothing: the surface is valid".into())];
    }
    let Repair { faces, turned, pairs, divided, removed, outside, outside_share, .. } = done;
    let mut lines = vec![];
    if turned.0 > 0 {
        let bodies = if turned.0 == 1 { "body that was" } else { "bodies that were" };
        let text = format!("{} {bodies} inside out, {} of {faces} faces", turned.0, turned.1);
        lines.push(("turned", text));
    }
    lines.push((
        "repaired",
        format!(
            "{pairs} pairs of faces that met; {divided} faces divided and {removed} removed; new vertices are exact, at most \
             {:e}{unit} from the grid",
            done.displacement
        ),
    ));
    let Repair { volume, volume_before, .. } = done;
    let cubic = if unit.is_empty() { String::new() } else { format!("{unit}^3") };
    lines.push(("volume", format!("{volume:.9}{cubic}; before the repair {volume_before:.9}{cubic}, counting space enclosed twice as double")));
    if *outside > 0 {
        let share = outside_share * 100.0;
        let text = format!("{outside} of the removed faces, {share:.2} percent of the area, bounded nothing");
        lines.push(("left out", text));
    }
    lines
}

/// Returns lines about a model.
pub(super) fn lines(report: &ExactReport, stats: bool) -> Lines {
    let unit = report.unit.as_ref().map_or(String::new(), |unit| format!(" {unit}"));
    let grid = &report.grid;
    let moved = match report.displacement {
        0.0 => "no vertex was moved".into(),
        most => format!("vertices moved by at most {most:e}{unit}"),
    };
    let mut lines = vec![
        ("grid", format!("units of {}{unit}, {} bits; {moved}", grid.width(), grid.bits)),
        ("faces", format!("{} of the result, {} read", report.faces, report.read)),
    ];
    let counts = [
        ("cut", report.cut, "faces that are not planar on the grid, into triangles"),
        ("fanned", report.fanned, "faces that intersect themselves, into triangles"),
        ("slivers", report.slivers, "faces have no area on the grid; they are kept, and bound nothing"),
        ("collapsed", report.collapsed, "faces are points or lines on the grid, and are left out"),
    ];
    lines.extend(
        counts
            .into_iter()
            .filter(|(_, count, _)| *count > 0)
            .map(|(name, count, text)| (name, format!("{count} {text}"))),
    );
    if report.objects + report.skipped.len() as u64 > 1 {
        let left_out = match report.skipped.len() {
            0 => String::new(),
            count => format!("; {count} LEFT OUT, which are not valid bodies:"),
        };
        lines.push(("objects", format!("{}{left_out}", report.objects)));
        lines.extend(
            report.skipped.iter().map(|object| ("skipped", format!("{}: {}", object.name, object.why))),
        );
    }
    if report.attributes > 0 {
        lines.push(("attributes", format!("of {} parts", report.attributes)));
    }
    let (boundaries, triangles) = report.closed;
    if boundaries > 0 {
        lines.push(("closed", format!("{boundaries} boundaries, with {triangles} triangles")));
    }
    if let Some(done) = &report.repair {
        lines.extend(repaired(done, &unit));
    }
    if let Some([volume, error]) = report.cells {
        let cubic = if unit.is_empty() { String::new() } else { format!("{unit}^3") };
        let text = format!(
            "volume of the models by 128 cells along the longest side: {volume:.9}{cubic} +- {error:.1e}"
        );
        lines.push(("cells", text));
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
