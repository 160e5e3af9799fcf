//! `spinney export` of an exact model.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use spinney::brep::{DetailLevel, Faces, SurfaceDetail};
use spinney::export::{GltfOptions, MeshFormat, export_exact, export_model_glb};
use spinney::import::feature::FeatureFilter;
use spinney::raw::brep::{ChosenParts, Triangulated};
use spinney::raw::export::mesh::ExactSummary;
use spinney::raw::store::Tag;
use spinney::{Coordinates, ExactModel};

use super::super::Global;
use super::super::args::{PartOptions, check_output};
use super::super::report::{Work, report_output, warn};
use super::{chosen, unit};

/// Format of the output.
pub(crate) enum MeshOutput {
    Mesh(MeshFormat),
    Glb(GltfOptions),
}

/// What is written of an exact model.
pub(crate) struct MeshContents<'a> {
    /// Whether faces are divided into triangles.
    pub(crate) triangles: bool,
    /// Conditions for objects.
    pub(crate) filter: Option<&'a FeatureFilter>,
    /// How much detail there is.
    pub(crate) detail: SurfaceDetail,
    /// Box of the world in which faces are written.
    pub(crate) within: Option<[[f64; 3]; 2]>,
}

/// Returns the box of a window, if one was given.
pub(crate) fn window(part: &PartOptions) -> Result<Option<[[f64; 3]; 2]>> {
    if !matches!(part.coordinates().given(), None | Some(Coordinates::World)) {
        bail!("--in: expected world: windows of exact models are in their own coordinates");
    }
    Ok(part.corners())
}

/// Describes the bodies that a surface with an error does not have, if there are any.
fn left_out(model: &ExactModel, detail: SurfaceDetail, error: f64) -> Option<String> {
    let (levels, width, unit) = (model.levels(), model.grid().width(), unit(model));
    if let SurfaceDetail::Level(level) = detail {
        let level = levels.get(usize::from(level)).filter(|level| level.vanished > 0)?;
        let diameter = level.vanished_diameter * width;
        return Some(format!("{} bodies of a diameter of at most {diameter:.3e}{unit}", level.vanished));
    }
    let may_vanish = |level: &DetailLevel| level.vanished > 0 && level.error * width <= error;
    levels.iter().any(may_vanish).then(|| format!("bodies of a diameter of at most {error:.3e}{unit}"))
}

/// Writes faces of an exact model unchanged.
pub(crate) fn export(
    model: &ExactModel,
    path: &Path,
    format: MeshOutput,
    contents: MeshContents<'_>,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    let MeshContents { triangles, filter, detail, within } = contents;
    check_output([model.path()], path)?;
    let work = Work::start(global, "faces")?;
    let output = global.access().create(path)?;
    let refined = model.refined(detail, &output, &work)?;
    let model = refined.as_deref().unwrap_or(model);
    let surface = model.surface(detail, within, &work)?;
    let some = match filter {
        Some(filter) => Some(ChosenParts::of(&surface, &chosen(model, filter)?)?),
        None => None,
    };
    let whole: &dyn Faces = some.as_ref().map_or(&surface, |some| some);
    let cut = if triangles { Some(Triangulated::of(whole)?) } else { None };
    let faces: &dyn Faces = cut.as_ref().map_or(whole, |cut| cut);
    let cannot_write = || format!("{}: cannot write", path.display());
    let summary = match format {
        MeshOutput::Mesh(format) => export_exact(faces, format, output, &work).with_context(cannot_write)?,
        MeshOutput::Glb(options) => {
            let triangles = export_model_glb(faces, &options, output, &work).with_context(cannot_write)?;
            let mut summary = ExactSummary::default();
            summary.faces = triangles;
            summary
        }
    };
    work.finish();
    match summary.vertices {
        0 => global.report("mesh", format_args!("{} triangles", summary.faces)),
        vertices => global.report("mesh", format_args!("{} faces, {vertices} vertices", summary.faces)),
    }
    if detail != SurfaceDetail::Exact {
        let text = format!("at most {:.3e}{} from the surface", surface.error(), unit(model));
        global.report("error", format_args!("{text}"));
        if let Some(text) = left_out(model, detail, surface.error()) {
            global.report("left out", format_args!("{text}"));
        }
        if !model.value_columns()?.is_empty() {
            global.report("left out", format_args!("values of faces: those of coarse levels have none"));
        }
    }
    if faces.is_empty() && !model.is_empty() {
        let why = match within {
            Some(_) => "the surface is not in the window",
            None => "all bodies are smaller than the error",
        };
        warn(&format!("{}: has no faces: {why}", path.display()));
    }
    let (exact, _) = model.exact_faces();
    if exact > 0 {
        let thin = model.metadata().tag(Tag::ModelIntersections);
        let thin = thin.map_or(String::new(), |count| {
            format!(", where the surface intersects itself in {count} positions")
        });
        let width = model.grid().width();
        let text =
            format!("{exact} faces with off-grid vertices, to multiples of {width}{}{thin}", unit(model));
        global.report("rounded", format_args!("{text}"));
    }
    if model.is_unbounded() {
        global.report("unbounded", format_args!("infinity is inside: faces point inwards"));
    }
    if summary.has_library {
        let library = path.with_extension("mtl");
        global.report("materials", format_args!("{}: their colours", library.display()));
    }
    if summary.moved > 0 {
        let (moved, by) = (summary.moved, summary.farthest);
        let by = format!("by at most {by:.3e}{}", unit(model));
        global.report("moved", format_args!("{moved} vertices, {by}, since the format has single precision"));
    }
    if summary.reversed > 0 {
        let reversed = summary.reversed;
        let text = format!(
            "{reversed} triangles are thinner than single precision, which reverses them; `spinney build` may need --repair \
             to build a model from the file"
        );
        warn(&format!("{}: {text}", path.display()));
    }
    if summary.collapsed > 0 {
        let collapsed = summary.collapsed;
        global
            .report("left out", format_args!("{collapsed} triangles that have no area in single precision"));
    }
    report_output(global, path, start);
    Ok(())
}
