//! Changes of exact models by operators: Euler operators in `spinney edit`, and local operators in
//! `spinney transform`.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::brep::Faces as _;
use spinney::raw::brep::euler::{
    EditReport, EulerBody, LocalChange, ModelBody, apply_local, edit_model, euler_text,
};
use spinney::raw::brep::topology::Counts;
use spinney::raw::io::ReplaceLock;
use spinney::{Codec, ExactModel, Progress};

use super::super::Global;
use super::super::args::{Memory, OutputLimit, Packing, check_output};
use super::super::report::{Work, report_output};
use super::{open, report_result, unit};

/// Change an exact model by Euler operators
///
/// The model must fit in --memory. Its vertices, edges, faces and rings have the names that
/// `spinney dump MODEL --as euler` prints. The result must be a solid with planar faces; otherwise,
/// the file stays as it is.
#[derive(clap::Args)]
pub(in crate::cli) struct EulerChange {
    /// Operators, separated by semicolons or line breaks, or a file of them, named .euler
    operators: String,
    /// File to write [default: the model's own, which is replaced]
    #[arg(short, long, value_name = "OUT.goblin")]
    output: Option<PathBuf>,
    #[command(flatten)]
    memory: Memory,
    /// Packing of the output's segments: plain or packed [default: the model's]
    #[arg(long, value_name = "plain|packed")]
    codec: Option<Codec>,
}

impl EulerChange {
    /// Applies the operators to the model in a file.
    pub(in crate::cli) fn run(&self, file: &Path, global: &Global) -> Result<()> {
        /// Maximum bytes of a text of operators.
        const MAX_TEXT: u64 = 1 << 30;
        let start = Instant::now();
        let is_file = self.operators.ends_with(".euler");
        let (text, name) = match is_file {
            true => {
                let path = PathBuf::from(&self.operators);
                let bytes = fs::metadata(&path).with_context(|| path.display().to_string())?.len();
                if bytes > MAX_TEXT.min(self.memory.bytes) {
                    bail!("{}: has {bytes} bytes, expected at most those of --memory", path.display());
                }
                (fs::read(&path).with_context(|| path.display().to_string())?, path)
            }
            false => (self.operators.clone().into_bytes(), PathBuf::from("operators")),
        };
        let output = self.output.as_deref().unwrap_or(file);
        if let Some(output) = &self.output {
            check_output([file, &name].into_iter().take(if is_file { 2 } else { 1 }), output)?;
        }
        // (Another process could replace the file between reading and replacing it.)
        let _lock = if self.output.is_none() { Some(ReplaceLock::take(file)?) } else { None };
        let Some(model) = open(file, global)? else {
            bail!(
                "{}: is not an exact model, which euler needs; build one: `spinney build MODEL --brep`",
                file.display()
            );
        };
        let codec = self.codec.unwrap_or_else(|| model.codec());
        let work = Work::start(global, "faces")?;
        let source = ModelBody::of(&model, self.memory.bytes, &work)?;
        let mut count = 0u64;
        let edited = edit_model(&source, &text, &name, &mut |_, line, body| {
            count += 1;
            global.report("operator", format_args!("{line}: {}", law(body)));
        })?;
        if count == 0 {
            bail!("{}: got no operators, expected one or more, such as mef", name.display());
        }
        let note = match is_file {
            true => format!("{count} Euler operators of {}", name.display()),
            false => format!("{count} Euler operators"),
        };
        let report = edited.write((global.access().create(output)?, codec), &note, &work)?;
        work.finish();
        self::report(&report, &model, global);
        report_output(global, output, start);
        Ok(())
    }
}

/// Returns the Euler-Poincaré formula with a body's counts.
fn law(body: &EulerBody) -> String {
    let Counts { vertices, edges, faces, rings, .. } = body.counts();
    let (shells, handles) = (body.shells(), body.handles());
    format!("V {vertices} - E {edges} + F {faces} - R {rings} = 2 (S {shells} - G {handles})")
}

fn report(report: &EditReport, model: &ExactModel, global: &Global) {
    let EditReport { before, after, changed, removed, displacement, built, .. } = report;
    let values = if *removed > 0 { ", with their values" } else { "" };
    global.report(
        "faces",
        format_args!("{before} before, {changed} made or changed, {removed} removed{values}"),
    );
    if *displacement > 0.0 {
        let unit = unit(model);
        global.report(
            "ROUNDED",
            format_args!("coordinates, by at most {displacement:e}{unit}, to the model's grid"),
        );
    }
    report_result(*after, model.is_unbounded(), built, global);
}

/// Writes a model that local operators changed.
pub(in crate::cli) fn change(
    (model, changes): (&ExactModel, &[LocalChange]),
    (memory, packing): (u64, &Packing),
    (path, limit): (&Path, &OutputLimit),
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let codec = packing.of_model(model.path())?;
    let work = Work::start(global, "faces")?;
    let source = ModelBody::of(model, memory, &work)?;
    let edited = apply_local(&source, changes).with_context(|| model.path().display().to_string())?;
    let note = changes.iter().map(LocalChange::to_string).collect::<Vec<_>>().join(", ");
    let report = edited.write((limit.create_tree(path, global)?, codec), &note, &work)?;
    work.finish();
    self::report(&report, model, global);
    report_output(global, path, start);
    Ok(())
}

/// Returns the operators that build a model, one a line.
pub(in crate::cli) fn operators(
    model: &ExactModel,
    memory: u64,
    limit: u64,
    progress: &dyn Progress,
) -> Result<String> {
    Ok(euler_text(&ModelBody::of(model, memory, progress)?, limit, progress)?)
}
