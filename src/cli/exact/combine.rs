//! `spinney combine` of exact models.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail, ensure};
use spinney::raw::brep::{
    CombineReport, NodePair, OperandKind, TableEntry, boundary_classes, combine_explained,
};
use spinney::raw::io::any_file;
use spinney::raw::store::shell_word;
use spinney::{Codec, CombineOperation, ExactModel, SetOperation};

use super::super::Global;
use super::super::args::OutputLimit;
use super::super::report::{Work, print_text, report_output};
use super::{open, report_result};

/// Merges several models into one by a set operation.
pub(in crate::cli) fn combine(
    operation: CombineOperation,
    files: &[PathBuf],
    (path, limit): (&Path, &OutputLimit),
    codec: Codec,
    (memory, explain): (u64, bool),
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let CombineOperation::Set { operation, .. } = operation else {
        bail!(
            "{}: is an exact model, which has no values; use a set operation (0 to 15)",
            files[0].display()
        );
    };
    let models = models(files, global)?;
    ensure!(!explain || models.len() == 2, "--explain: got {} models, expected 2", models.len());
    ensure!(!explain || path != Path::new("-"), "--explain: prints a table; name a file with --output");
    let work = Work::start(global, "faces")?;
    let output = limit.create_tree(path, global)?;
    let models = models.iter().collect::<Vec<_>>();
    let (report, pairs) = match models[..] {
        [a, b] if explain => combine_explained(operation, [a, b], output, codec, memory, &work)?,
        _ => (spinney::brep::combine(operation, &models, output, codec, memory, &work)?, Vec::new()),
    };
    work.finish();
    report_combined(&report, files, global);
    report_output(global, path, start);
    if explain { print_text(&(face_table(operation)? + &node_table(&pairs)?)) } else { Ok(()) }
}

/// Returns the second table of `--explain`: the pairs of node kinds that the traversals of both
/// octrees met, what the operation does with each, and how often each traversal met it.
fn node_table(pairs: &[NodePair]) -> Result<String> {
    const OPERANDS: [&str; 2] = ["A", "B"];
    let mut text =
        format!("{:8} {:8} {:16} {:>12} {:>12}\n", "A's node", "B's node", "result", "for A", "for B");
    let name = |kind: OperandKind| format!("{kind:?}").to_uppercase();
    for NodePair { kinds: [a, b], entry, met, .. } in pairs.iter().filter(|pair| pair.met != [0, 0]) {
        let result = match entry {
            TableEntry::Void => "VOID".into(),
            TableEntry::Full => "FULL".into(),
            TableEntry::Copy(operand) => format!("copy of {}", OPERANDS[*operand]),
            TableEntry::Complement(operand) => format!("complement of {}", OPERANDS[*operand]),
            TableEntry::Divide => "divide".into(),
            TableEntry::Faces => "face by face".into(),
        };
        writeln!(text, "{:8} {:8} {result:16} {:12} {:12}", name(*a), name(*b), met[0], met[1])?;
    }
    Ok(text)
}

/// Returns the first table of `--explain`: the surface fragments of two models with their indices,
/// and which of them an operation keeps or reverses.
fn face_table(operation: SetOperation) -> Result<String> {
    const SETS: [&str; 4] = ["both", "A only", "B only", "neither"];
    let has = |set: usize| if operation.index() >> set & 1 == 1 { "in" } else { "out" };
    let mut text = format!("operation {}\nindex  set      result\n", operation.index());
    for (index, name) in SETS.iter().enumerate() {
        writeln!(text, "{index:5}  {name:7}  {}", has(index))?;
    }
    text.push_str("index  boundary                               back     front    bits  kept\n");
    for part in boundary_classes(operation) {
        let [back, front] = part.sets.map(|set| SETS[usize::from(set)]);
        let [a, b] = part.is_inside.map(u8::from);
        let taken = match (part.is_taken(), part.is_turned()) {
            (false, _) => "no",
            (true, false) => "yes",
            (true, true) => "reversed",
        };
        writeln!(text, "{:5}  {:37}  {back:7}  {front:7}  {a} {b}   {taken}", part.index(), part.name)?;
    }
    Ok(text)
}

/// Opens files, all of which must be exact models.
fn models(files: &[PathBuf], global: &Global) -> Result<Vec<ExactModel>> {
    let mut models = Vec::new();
    let is_model =
        |file: &&PathBuf| spinney::raw::brep::is_model_file(file, global.access()).unwrap_or(false);
    let model = files.iter().find(is_model);
    for file in files {
        match open(file, global)? {
            Some(model) => models.push(model),
            // (A missing file gets its own message.)
            None if !file.exists() => bail!("{}: no such file", file.display()),
            None if spinney::open(file).is_ok() => bail!(
                "{}: has cells, but other files are exact models: make cells of the same size of those: `spinney build {} \
                 --grid {} -o CELLS.goblin`",
                file.display(),
                shell_word(model.unwrap_or(file)),
                shell_word(file)
            ),
            None => bail!(
                "{}: is not an exact model, but other files are: build one from it with --brep",
                file.display()
            ),
        }
    }
    Ok(models)
}

fn report_combined(report: &CombineReport, files: &[PathBuf], global: &Global) {
    for (file, faces) in files.iter().zip(&report.before) {
        global.report("input", format_args!("{}: {faces} faces", file.display()));
    }
    let CombineReport { near, pairs, divided, after, displacement, .. } = report;
    global.report("near", format_args!("{near} faces near other bodies; the others are not divided"));
    global.report("contacts", format_args!("{pairs} pairs of faces; {divided} faces divided"));
    if *displacement > 0.0 {
        global.report("moved", format_args!("new vertices, by {displacement} at most, to the grid"));
    }
    report_result(*after, report.is_unbounded, &report.built, global);
}

/// Whether any of the files is an exact model.
pub(in crate::cli) fn any_model(files: &[PathBuf], global: &Global) -> spinney::Result<bool> {
    any_file(files, &|file| spinney::raw::brep::is_model_file(file, global.access()))
}
