//! `spinney section --along`: vertical sections along a line, object by object.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use spinney::brep::Faces;
use spinney::export::{MeshFormat, VectorFormat};
use spinney::raw::brep::ModelView;
use spinney::raw::export::mesh::{SurfaceMesh, export_triangles};
use spinney::raw::export::vector::{
    LineSectionOptions, LineSectionSummary, SectionLine, export_line_section, line_section,
};
use spinney::{Crs, Metadata};

use super::Args;
use crate::cli::Global;
use crate::cli::args::{check_output, vector_format};
use crate::cli::report::quantity::counted;
use crate::cli::report::{Work, warn};

/// Line of a section: coordinates, or a file.
#[derive(Clone, Debug)]
pub(super) enum Along {
    Line(SectionLine),
    File(PathBuf),
}

/// Parses coordinates, or the name of a file.
pub(super) fn parse_along(text: &str) -> Result<Along, String> {
    if Path::new(text).exists() {
        return Ok(Along::File(text.into()));
    }
    text.parse().map(Along::Line).map_err(|error: spinney::Error| error.to_string())
}

/// Format of the output.
enum Format {
    Features(VectorFormat),
    /// Triangles as faces.
    Mesh(MeshFormat),
}

impl Format {
    fn of(args: &Args, output: &Path) -> Result<Format> {
        let mesh = match &args.format {
            Some(name) => Some(name.parse().ok()),
            None => Some(MeshFormat::of(output)),
        };
        let mesh = mesh.flatten().filter(|format| *format != MeshFormat::CityJson);
        match mesh.filter(|_| args.triangles) {
            Some(format) => Ok(Format::Mesh(format)),
            None => Ok(Format::Features(vector_format(args.format.as_deref(), output)?)),
        }
    }
}

/// Writes the section.
pub(super) fn run(
    args: &Args,
    along: &Along,
    output: &Path,
    view: &ModelView,
    global: &Global,
) -> Result<()> {
    let line = match along {
        Along::Line(line) => line.clone(),
        Along::File(path) => {
            check_output([path.as_path()], output)?;
            let (line, crs) = SectionLine::read(path)?;
            agree(path, crs.as_ref(), view.file().crs())?;
            line
        }
    };
    let format = Format::of(args, output)?;
    let options = LineSectionOptions { flat: args.flat, triangles: args.triangles };
    let work = Work::start(global, "segments")?;
    let cannot_write = || format!("{}: cannot write", output.display());
    let create = || args.limit.create(output, global);
    let made = match format {
        Format::Features(format) => create()
            .and_then(|file| export_line_section(view, &line, &options, file, format, &work))
            .with_context(cannot_write)?,
        Format::Mesh(format) => {
            let mut meshes = Meshes::default();
            let made = line_section(view, &line, &options, &work, &mut |figure| {
                meshes.push(figure.object, &figure.rings);
                Ok(())
            })?;
            let mut metadata = Metadata::default();
            metadata.frame.crs = view.file().crs().filter(|_| !args.flat).cloned();
            create()
                .and_then(|file| export_triangles(&meshes.list, &metadata, file, format, &work))
                .with_context(cannot_write)?;
            made
        }
    };
    work.finish();
    report(args, output, view, &made, global);
    Ok(())
}

/// Fails if the line's coordinate system differs from that of the model.
fn agree(path: &Path, line: Option<&Crs>, model: Option<&Crs>) -> Result<()> {
    match (line, model) {
        (Some(line), Some(model)) if line != model => bail!(
            "{}: the line is in {line}, the model in {model}; transform the line: `spinney transform`",
            path.display()
        ),
        _ => Ok(()),
    }
}

/// Reports the area of each object.
fn report(args: &Args, output: &Path, view: &ModelView, made: &LineSectionSummary, global: &Global) {
    super::report_objects(&made.objects, global);
    let what = if args.triangles { "triangle" } else { "polygon" };
    let (figures, segments) = (counted(made.figures, what), counted(made.segments, "segment"));
    let area: f64 = made.objects.iter().map(|(_, area)| area).sum();
    global.report("section", format_args!("{figures} along {segments}, with an area of {area}"));
    if let Err(reason) = view.file().metadata().frame.cell_volume() {
        warn(&format!("{}: areas have no meaning: {reason}", output.display()));
    }
    if made.figures == 0 {
        let (name, file) = (output.display(), args.file.display());
        warn(&format!(
            "{name}: is empty: the line is not over the model; `spinney stats {file}` prints its bounds"
        ));
    }
}

/// Triangles of objects as meshes, in the order of first use.
#[derive(Default)]
struct Meshes {
    list: Vec<(String, SurfaceMesh)>,
    numbers: BTreeMap<String, usize>,
    /// Index of each vertex, by object and coordinates.
    vertices: BTreeMap<(usize, [u64; 3]), u32>,
}

impl Meshes {
    /// Adds a triangle, a closed ring.
    fn push(&mut self, object: &str, rings: &[Vec<[f64; 3]>]) {
        let Some([a, b, c, ..]) = rings.first().map(Vec::as_slice) else { return };
        let number = *self.numbers.entry(object.into()).or_insert_with(|| {
            self.list.push((object.into(), SurfaceMesh { vertices: Vec::new(), triangles: Vec::new() }));
            self.list.len() - 1
        });
        let mesh = &mut self.list[number].1;
        let corners = [a, b, c].map(|at| {
            // (Adding 0.0 turns -0.0 into 0.0.)
            let key = (number, at.map(|at| (at + 0.0).to_bits()));
            *self.vertices.entry(key).or_insert_with(|| {
                mesh.vertices.push(*at);
                mesh.vertices.len() as u32 - 1
            })
        });
        mesh.triangles.push(corners);
    }
}
