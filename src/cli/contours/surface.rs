//! `spinney contours` of a mesh file: isolines of a triangulated surface.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::query::ContourLevels;
use spinney::raw::export::vector::ContourFeatures;
use spinney::raw::import::mesh::open_all_with;
use spinney::raw::tin::{Tin, export_isolines};

use super::args::Args;
use crate::cli::Global;
use crate::cli::args::{check_output, vector_format};
use crate::cli::report::{Work, report_output, warn};

/// Bytes per triangle: its vertices, and its entry in the surface, whose triangles store their
/// neighbours.
const TRIANGLE_BYTES: u64 = 200;

fn check_memory(file: &Path, triangles: u64, memory: u64) -> spinney::Result<()> {
    let needed = triangles * TRIANGLE_BYTES;
    if needed <= memory {
        return Ok(());
    }
    Err(spinney::Error::TooLarge {
        path: file.to_path_buf(),
        what: "isolines of a surface, with all triangles in memory,".into(),
        needed,
        limit: memory,
        advice: "allow more memory (--memory)".into(),
    })
}

pub(super) fn run(args: &Args, levels: &ContourLevels, global: &Global, start: Instant) -> Result<()> {
    let file = &args.tree.file;
    let fitting = ["--every", "--at", "--base", "--output", "--format", "--smooth", "--3d"];
    global.check_options(file, "a surface of triangles", &fitting)?;
    check_output([file.as_path()], &args.output)?;
    let format = vector_format(args.format.as_deref(), &args.output)?;
    let work = Work::start(global, "faces")?;
    let (mut triangles, mut crs) = (Vec::new(), None);
    let memory = args.memory.bytes;
    for model in &mut open_all_with(std::slice::from_ref(file), memory, global.access())? {
        crs.clone_from(&model.info().crs);
        model.faces(&mut |face| {
            let [a, b, c] = face.points else {
                let found = format!("a face of {} vertices", face.points.len());
                return Err(spinney::Error::unsupported(file, found, "contours of a mesh need triangles"));
            };
            triangles.push([*a, *b, *c]);
            check_memory(file, triangles.len() as u64, memory)
        })?;
    }
    let tin = Tin::from_triangles(&triangles).with_context(|| {
        format!("{}: is not a surface over the plane, which has one height at each position", file.display())
    })?;
    let mut features = ContourFeatures::new();
    (features.smooth, features.has_z) = (args.smooth, args.has_z);
    let (lines, points) = args
        .limit
        .create(&args.output, global)
        .and_then(|output| export_isolines(&tin, crs, levels, &features, output, format, &work))
        .with_context(|| format!("{}: cannot write", args.output.display()))?;
    work.finish();
    global.report(
        "contours",
        format_args!("{lines} lines of {points} points, {} triangles", tin.triangles().len()),
    );
    report_output(global, &args.output, start);
    if lines == 0 {
        let heights = || triangles.iter().flatten().map(|[_, _, z]| *z);
        let (min, max) =
            (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        warn(&format!("{}: has no lines: heights are {min} to {max}", args.output.display()));
    }
    Ok(())
}
