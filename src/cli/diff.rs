//! `spinney diff`: differences between two trees.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Result, bail};
use serde_json::json;
use spinney::raw::ops;
use spinney::{CombineOperation, CombineOptions, Error};

use super::args::{Memory, OutputLimit, Packing, ReconcileArgs, check_output};
use super::report::{Work, print_json, print_text, report_output};
use super::{Global, exact};

/// Show where two trees or commits differ
///
/// Prints how many cells were added, removed and changed, by their world coordinates. The second
/// file is converted to the cells, type, scale, unit and classes of the first, as by `combine`.
/// Data that commits share are not read.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The old tree
    first: PathBuf,
    /// The new tree
    second: PathBuf,
    /// File to write: a tree of the cells that differ, with the second's value, or the first's
    /// where the second is VOID
    #[arg(short, long, value_name = "OUT.goblin")]
    output: Option<PathBuf>,
    /// Print the runs of cells that differ, in FD order: the paths of the first and the last cell
    #[arg(long, conflicts_with = "json")]
    ranges: bool,
    /// Print JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    reconcile: ReconcileArgs,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    packing: Packing,
    #[command(flatten)]
    limit: OutputLimit,
}

const EXAMPLES: &str = "\
Examples:
  spinney diff map.autumn@3 map.autumn
  spinney diff map.autumn@3 map.autumn@5 --ranges > changed.txt
  spinney diff 2020.goblin 2025.goblin -o changes.goblin";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let how = args.packing.with(args.memory);
    let paths = [args.first.as_path(), &args.second];
    if exact::open(&args.first, global)?.is_some() && exact::open(&args.second, global)?.is_some() {
        let [first, second] = paths.map(Path::display);
        bail!(
            "{first}: is an exact model, like {second}: the bodies in which they differ are the result of \
             `spinney combine xor {first} {second} -o OUT.goblin`"
        );
    }
    let work = Work::start(global, "cells")?;
    let options = args.reconcile.options();
    let report = if args.ranges {
        let mut out = std::io::BufWriter::new(std::io::stdout().lock());
        let report = ops::diff_files(paths[0], paths[1], &options, global.access(), &work, &mut |range| {
            writeln!(out, "{} {}", range.first, range.last).map_err(Error::io("-", "write"))
        })?;
        out.flush()?;
        report
    } else {
        ops::differences(paths[0], paths[1], &options, global.access(), &work)?
    };
    work.finish();
    global.report_conversions(&report.conversions);
    if report.origin != [0; 3] && args.ranges {
        let [x, y, z] = report.origin;
        let text = format_args!("paths are on a grid that begins at cell {x},{y},{z} of the first file");
        global.report("grid", text);
    }
    let ops::Differences { added, removed, changed, blocks, runs } = report.differences;
    if args.json {
        print_json(&json!({
            "added": added, "removed": removed, "changed": changed, "blocks": blocks, "ranges": runs,
        }))?;
    } else if !args.ranges {
        print_text(&format!(
            "added      {added} cells\nremoved    {removed} cells\nchanged    {changed} cells\nblocks     {blocks}, \
             in {runs} runs of cells\n"
        ))?;
    }
    let Some(output) = &args.output else { return Ok(()) };
    check_output(paths, output)?;
    let files = paths.map(Path::to_path_buf);
    let work = Work::start(global, "cells")?;
    spinney::combine(
        CombineOperation::Changed,
        CombineOptions { reconcile: options, ..CombineOptions::default() },
        &files,
        args.limit.create_tree(output, global)?,
        how,
        &work,
    )?;
    work.finish();
    report_output(global, output, start);
    Ok(())
}
