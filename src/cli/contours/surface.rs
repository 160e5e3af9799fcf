//! `spinney contours` of a mesh file or an exact model: isolines of a triangulated surface.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::brep::Faces;
use spinney::query::ContourLevels;
use spinney::raw::brep::each_triangle;
use spinney::raw::export::vector::ContourFeatures;
use spinney::raw::import::mesh::open_all_with;
use spinney::raw::tin::{Tin, export_isolines};
use spinney::{Crs, ExactModel};

use super::args::{Args, Side};
use crate::cli::Global;
use crate::cli::args::{check_output, vector_format};
use crate::cli::report::{Work, report_output, warn};

/// Bytes per triangle: its vertices, and its entries in the surface, whose triangles store their
/// neighbours, and in the triangulation that finds overlaps.
const TRIANGLE_BYTES: u64 = 600;

/// Triangles of a surface, each with three vertices.
struct Triangles<'a> {
    list: Vec<[[f64; 3]; 3]>,
    file: &'a Path,
    memory: u64,
}

impl Triangles<'_> {
    fn push(&mut self, corners: [[f64; 3]; 3]) -> spinney::Result<()> {
        self.list.push(corners);
        let needed = self.list.len() as u64 * TRIANGLE_BYTES;
        if needed <= self.memory {
            return Ok(());
        }
        Err(spinney::Error::TooLarge {
            path: self.file.to_path_buf(),
            what: "isolines of a surface, with all triangles in memory,".into(),
            needed,
            limit: self.memory,
            advice: "allow more memory (--memory)".into(),
        })
    }

    /// Adds the triangles of a mesh file, or of its objects with a name. Returns the coordinate
    /// system.
    fn read_mesh(&mut self, object: Option<&str>, global: &Global) -> Result<Option<Crs>> {
        let file = self.file;
        let mut crs = None;
        for model in &mut open_all_with(&[file.to_path_buf()], self.memory, global.access())? {
            crs.clone_from(&model.info().crs);
            let is_wanted = wanted(file, &model.info().parts, object)?;
            model.faces(&mut |face| {
                if !is_wanted[face.part as usize] {
                    return Ok(());
                }
                let [a, b, c] = face.points else {
                    let found = format!("a face of {} vertices", face.points.len());
                    let advice = "contours of a mesh need triangles";
                    return Err(spinney::Error::unsupported(file, found, advice));
                };
                self.push([*a, *b, *c])
            })?;
        }
        Ok(crs)
    }

    /// Adds the triangles of an exact model, or of its objects with a name, that face up or down.
    fn read_model(&mut self, model: &ExactModel, object: Option<&str>, side: Side) -> Result<()> {
        let is_wanted = wanted(self.file, model.parts(), object)?;
        let grid = model.grid();
        each_triangle(model, &mut |face| {
            let [a, b, c] = face.points else { return Ok(()) };
            let along = |from: &[i32; 3], to: &[i32; 3]| {
                [0, 1].map(|axis| i64::from(to[axis]) - i64::from(from[axis]))
            };
            let (u, v) = (along(a, b), along(a, c));
            let area = i128::from(u[0]) * i128::from(v[1]) - i128::from(u[1]) * i128::from(v[0]);
            let is_on_side = match side {
                Side::Top => area > 0,
                Side::Bottom => area < 0,
            };
            match is_on_side && is_wanted[face.part as usize] {
                true => self.push([a, b, c].map(|point| grid.to_world(*point))),
                false => Ok(()),
            }
        })?;
        Ok(())
    }
}

/// Returns which parts have a name; all without one.
fn wanted(file: &Path, parts: &[String], object: Option<&str>) -> Result<Vec<bool>> {
    /// Maximum number of names in the error.
    const MAX_NAMES: usize = 20;
    let Some(object) = object else { return Ok(vec![true; parts.len()]) };
    let is_wanted: Vec<bool> = parts.iter().map(|name| name == object).collect();
    if !is_wanted.contains(&true) {
        let more = if parts.len() > MAX_NAMES { " ..." } else { "" };
        let names = parts[..parts.len().min(MAX_NAMES)].join(", ");
        bail!("{}: has no object `{object}`; its objects are: {names}{more}", file.display());
    }
    Ok(is_wanted)
}

/// Writes the isolines of a mesh file, or of an exact model.
pub(super) fn run(
    args: &Args,
    model: Option<&ExactModel>,
    levels: &ContourLevels,
    global: &Global,
    start: Instant,
) -> Result<()> {
    let file = &args.tree.file;
    let fitting = ["--every", "--at", "--base", "--output", "--format", "--smooth", "--3d", "--object"];
    match model {
        Some(_) => global.check_options(file, "an exact model", &[&fitting[..], &["--side"]].concat())?,
        None => global.check_options(file, "a surface of triangles", &fitting)?,
    }
    check_output([file.as_path()], &args.output)?;
    let format = vector_format(args.format.as_deref(), &args.output)?;
    let work = Work::start(global, "faces")?;
    let mut triangles = Triangles { list: Vec::new(), file, memory: args.memory.bytes };
    let object = args.object.as_deref();
    let (crs, what) = match model {
        Some(model) => {
            let side = args.side.unwrap_or(Side::Top);
            triangles.read_model(model, object, side)?;
            (model.crs().cloned(), format!("the {} of the model", side.name()))
        }
        None => (triangles.read_mesh(object, global)?, "the mesh".into()),
    };
    let triangles = triangles.list;
    let several = match (model.map_or(1, |model| model.parts().len()), object) {
        (2.., None) => "; choose one of its objects with --object",
        _ => "",
    };
    let tin = Tin::from_triangles(&triangles).with_context(|| {
        let file = file.display();
        format!(
            "{file}: {what} is not a surface over the plane, which has one height at each position{several}"
        )
    })?;
    if let Some(model) = model
        && model.exact_faces().0 > 0
    {
        let count = model.exact_faces().0;
        global.report("rounded", format_args!("{count} faces with off-grid vertices, to the grid"));
    }
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
        if triangles.is_empty() {
            warn(&format!("{}: has no lines: {what} has no triangles", args.output.display()));
            return Ok(());
        }
        let (min, max) =
            (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
        warn(&format!("{}: has no lines: heights are {min} to {max}", args.output.display()));
    }
    Ok(())
}
