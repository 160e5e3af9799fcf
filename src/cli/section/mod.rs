//! `spinney section`: plane sections of an exact model, or the intersection of two models'
//! surfaces.

mod along;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::export::VectorFormat;
use spinney::raw::brep::surface_intersection::surface_intersection;
use spinney::raw::brep::{ModelView, divide_faces};
use spinney::raw::export::vector::{SectionPlanes, export_intersection, export_section};
use spinney::{ExactModel, ViewOperation};

use self::along::{Along, parse_along};
use super::args::{Memory, OutputLimit, VECTOR_FORMATS, check_output, parse_step, vector_format};
use super::report::quantity::counted;
use super::report::{Work, report_output, warn};
use super::{Global, exact};

const EXAMPLES: &str = "Examples:
  spinney section part.goblin z=12.5 -o outline.svg
  spinney section part.goblin z=0..50/0.2 -o slices.geojson
  spinney section part.goblin plane=1,1,0,7.5 -o oblique.gpkg
  spinney section layers.goblin --along 0,0,500,300,900,300 -o section.geojson
  spinney section layers.goblin --along line.csv --triangles --flat -o section.ply
  spinney section part.goblin tool.goblin -o lines.ply
  spinney section part.goblin tool.goblin --split part2.goblin --split-other tool2.goblin

A section at a plane is the limit from below: bodies that end at the plane count, bodies that begin
there do not. Vertices are computed in double precision and shared by adjacent faces, so that
outlines are closed. Attributes are plane (x, y, z, or the normal), at (its coordinate, or the dot
product of the normal with its points) and area. Coordinates are three-dimensional; --flat writes
coordinates in the plane, as SVG always does.

A section along a line consists of vertical planes, each between the ends of a segment of the line.
Each object is cut by itself. Attributes are object, segment (its number, from 1) and area; polygons
are seen from the right of the line. Along a wall of the model, bodies at the left are cut.

The intersection of two models is exact, and its points are rounded once. Features are lines where
the surfaces intersect (kind crossing: closed, with the part of the first surface that is inside of
the second model on the left) or touch (touch), areas where they coincide (overlap; side says
whether they face the same way), and isolated points (point). a_left, a_right, b_left and b_right
are the faces of both models next to each segment, by their numbers in the files that the models
were built from. --memory has an effect on intersections only.

--split and --split-other write the models themselves, with faces divided along these lines and
around these areas, which become edges of both; the bodies do not change.";

/// Write plane sections of an exact model, or the intersection of two surfaces
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Exact model (`build --brep`)
    file: PathBuf,
    /// Planes: z=12.5, many as in z=0..50/0.2, or plane=NX,NY,NZ,D (the normal, and its dot product
    /// with the plane's points); or another exact model
    #[arg(required_unless_present = "along", value_name = "PLANE|MODEL", value_parser = parse_cutter)]
    cutters: Vec<Cutter>,
    /// Line of a vertical section, which cuts each object by itself: coordinates, or a feature file
    /// with a line, or with points as its vertices
    #[arg(long, value_name = "X,Y,X,Y,...|FILE", value_parser = parse_along, allow_hyphen_values = true)]
    #[arg(conflicts_with_all = ["cutters", "split", "split_other", "each"])]
    along: Option<Along>,
    /// Each object of the model is cut by itself by planes, with its name as the attribute object
    #[arg(long)]
    each: bool,
    /// Triangles only, instead of the polygons of --along; they are faces in .ply, .obj and .off
    #[arg(long, requires = "along")]
    triangles: bool,
    /// File to write: .geojson, .csv (well-known text), .svg, .gpkg, .fgb, .shp (of planes), .obj
    /// or .ply; - is standard output
    #[arg(short, long, value_name = "FILE", required_unless_present_any = ["split", "split_other"])]
    output: Option<PathBuf>,
    /// Write the first of two models with its faces split: divided where the other one intersects
    /// them
    #[arg(long, value_name = "OUT.goblin")]
    split: Option<PathBuf>,
    /// Write the other one of two models with its faces split: divided where the first one
    /// intersects them
    #[arg(long, value_name = "OUT.goblin")]
    split_other: Option<PathBuf>,
    /// Format [default: by the output's extension]
    #[arg(long, value_parser = VECTOR_FORMATS)]
    format: Option<String>,
    /// Coordinates in the plane: y and z if x is given, z and x if y is, x and y if z is, and of
    /// --along the distance along the line and the height
    #[arg(long)]
    flat: bool,
    /// View the file through an operation of `transform`, such as rotate=30; repeatable. (With
    /// another model: only translate= and scale= with one factor)
    #[arg(long = "view", value_name = "OPERATION", value_parser = parse_step)]
    steps: Vec<ViewOperation>,
    #[command(flatten)]
    memory: Memory,
    #[command(flatten)]
    limit: OutputLimit,
}

/// The planes or the model that cut a model.
#[derive(Clone, Debug)]
enum Cutter {
    Planes(SectionPlanes),
    Model(PathBuf),
}

/// Parses planes, or the name of a model file.
fn parse_cutter(text: &str) -> Result<Cutter, String> {
    let planes = || text.parse().map(Cutter::Planes).map_err(|error: spinney::Error| error.to_string());
    let name = text.split_once('=').map(|(name, _)| name);
    match name {
        Some("x" | "y" | "z" | "plane") => planes(),
        _ if Path::new(text).exists() => Ok(Cutter::Model(text.into())),
        Some(_) => planes(),
        None => Err("no such file; planes are z=12.5, z=0..50/0.2 or plane=NX,NY,NZ,D".into()),
    }
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let mut planes = Vec::new();
    let mut others = Vec::new();
    for cutter in &args.cutters {
        match cutter {
            Cutter::Planes(cutter) => planes.push(cutter.clone()),
            Cutter::Model(path) => others.push(path.as_path()),
        }
    }
    if others.len() > usize::from(planes.is_empty()) {
        bail!("expected planes, or one other model; run `spinney section` once for each");
    }
    let view = open(&args.file, &args.steps, global)?;
    if let Some(line) = &args.along {
        if let Some(output) = &args.output {
            check_output([args.file.as_path()], output)?;
            along::run(args, line, output, &view, global)?;
            report_output(global, output, start);
        }
        return Ok(());
    }
    // (Since --along conflicts with planes, clap does not enforce that --triangles requires it.)
    if args.triangles {
        bail!("--triangles: works only with --along");
    }
    if args.each && !others.is_empty() {
        bail!("--each: works only with planes, not with another model");
    }
    let format =
        args.output.as_deref().map(|output| vector_format(args.format.as_deref(), output)).transpose()?;
    let splits = [&args.split, &args.split_other].map(Option::as_deref);
    let inputs = || others.iter().copied().chain([args.file.as_path()]);
    let outputs: Vec<&Path> =
        args.output.as_deref().into_iter().chain(splits.into_iter().flatten()).collect();
    for (number, output) in outputs.iter().enumerate() {
        check_output(inputs(), output)?;
        if outputs[..number].contains(output) {
            bail!("{}: is named for two outputs; choose another name for one", output.display());
        }
    }
    let Some(other) = others.first() else {
        if splits.iter().any(Option::is_some) {
            bail!("--split and --split-other: work only with another model, not with planes");
        }
        if let (Some(output), Some(format)) = (&args.output, format) {
            let found = cut(args, output, &view, &planes, format, global)?;
            global.report("section", format_args!("{found}"));
            report_output(global, output, start);
        }
        return Ok(());
    };
    let (other, what) = (open(other, &[], global)?, "the intersection of two models");
    let models = [view.as_model(what)?, other.as_model(what)?];
    if let (Some(output), Some(format)) = (&args.output, format) {
        let found = intersect(args, output, models, format, global)?;
        global.report("section", format_args!("{found}"));
        report_output(global, output, start);
    }
    let [a, b] = models;
    for (output, [model, by]) in splits.into_iter().zip([[a, b], [b, a]]) {
        if let Some(output) = output {
            split(args, output, model, by, global)?;
            report_output(global, output, start);
        }
    }
    Ok(())
}

/// Writes a model whose faces are split by another one.
fn split(args: &Args, output: &Path, model: &ExactModel, by: &ExactModel, global: &Global) -> Result<()> {
    let work = Work::start(global, "faces")?;
    let report = args
        .limit
        .create_tree(output, global)
        .and_then(|file| divide_faces(model, by, file, model.codec(), args.memory.bytes, &work))
        .with_context(|| format!("{}: cannot write", output.display()))?;
    work.finish();
    let before = report.before.first().copied().unwrap_or(0);
    global.report(
        "split",
        format_args!(
            "{}: {} of {before} faces divided, {} faces after",
            model.path().display(),
            report.divided,
            report.after
        ),
    );
    Ok(())
}

/// Writes plane sections. Returns a summary.
fn cut(
    args: &Args,
    output: &Path,
    view: &ModelView,
    planes: &[SectionPlanes],
    format: VectorFormat,
    global: &Global,
) -> Result<String> {
    let work = Work::start(global, "planes")?;
    let made = args
        .limit
        .create(output, global)
        .and_then(|file| export_section(view, planes, (args.flat, args.each), file, format, &work))
        .with_context(|| format!("{}: cannot write", output.display()))?;
    work.finish();
    if made.polygons == 0 {
        let (name, file) = (output.display(), args.file.display());
        warn(&format!("{name}: is empty: no plane cuts the model; `spinney stats {file}` prints its bounds"));
    }
    if made.polygons > 0 {
        let bounds = view.bounds()?;
        for [foot, above] in planes.iter().filter_map(|planes| planes.at_foot(bounds)) {
            warn(&format!(
                "{foot}: is the lower end of the model, where its section is empty: what is above a plane does not count; \
                 for a section there, add `{above}`"
            ));
        }
    }
    report_objects(&made.objects, global);
    let (polygons, planes) = (counted(made.polygons, "polygon"), counted(made.planes, "plane"));
    Ok(format!("{polygons} in {planes}, with an area of {}", made.area))
}

/// Reports the areas of objects.
fn report_objects(objects: &[(String, f64)], global: &Global) {
    /// Maximum number of objects.
    const MAX_OBJECTS: usize = 50;
    for (name, area) in objects.iter().take(MAX_OBJECTS) {
        global.report("object", format_args!("{name}: area {area}"));
    }
    if let Some(more) = objects.len().checked_sub(MAX_OBJECTS).filter(|more| *more > 0) {
        global.report("", format_args!("and {}", counted(more as u64, "other object")));
    }
}

/// Writes the intersection of two models' surfaces. Returns a summary.
fn intersect(
    args: &Args,
    output: &Path,
    models: [&ExactModel; 2],
    format: VectorFormat,
    global: &Global,
) -> Result<String> {
    if args.flat {
        bail!("--flat: works only with planes, not with another model");
    }
    let work = Work::start(global, "faces")?;
    let found = surface_intersection(models[0], models[1], args.memory.bytes, &work)?;
    let made = args
        .limit
        .create(output, global)
        .and_then(|file| export_intersection(&found, models, file, format, &work))
        .with_context(|| format!("{}: cannot write", output.display()))?;
    work.finish();
    Ok(format!(
        "{} where surfaces intersect (length {}), {} where they touch ({}), {} ({}), {}",
        counted(made.crossings, "line"),
        made.crossing_length,
        made.touches,
        made.touch_length,
        counted(made.overlaps, "area"),
        made.overlap_area,
        counted(made.points, "point")
    ))
}

fn open(path: &Path, steps: &[ViewOperation], global: &Global) -> Result<ModelView> {
    match exact::open_viewed(path, steps, global)? {
        Some(view) => Ok(view),
        None => {
            // (A file that is not a Spinney file gets its own error.)
            super::open(path, global.access())?;
            bail!(
                "{}: is not an exact model; build one: `spinney build MODEL --brep -o OUT.goblin`",
                path.display()
            )
        }
    }
}
