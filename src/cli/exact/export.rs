//! `spinney export` of an exact model.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result};
use spinney::ExactModel;
use spinney::brep::Faces;
use spinney::export::{MeshFormat, export_exact};
use spinney::import::feature::FeatureFilter;
use spinney::raw::brep::{ChosenParts, Triangulated};
use spinney::raw::store::Tag;

use super::super::Global;
use super::super::args::check_output;
use super::super::report::{Work, report_output};
use super::chosen;

/// Writes the faces of an exact model unchanged.
pub(crate) fn export(
    model: &ExactModel,
    path: &Path,
    format: MeshFormat,
    triangles: bool,
    filter: Option<&FeatureFilter>,
    global: &Global,
) -> Result<()> {
    let start = Instant::now();
    check_output([model.path()], path)?;
    let some = match filter {
        Some(filter) => Some(ChosenParts::of(model, &chosen(model, filter)?)?),
        None => None,
    };
    let whole: &dyn Faces = some.as_ref().map_or(model, |some| some);
    let cut = if triangles { Some(Triangulated::of(whole)?) } else { None };
    let faces: &dyn Faces = cut.as_ref().map_or(whole, |cut| cut);
    let work = Work::start(global, "faces")?;
    let output = global.access().create(path)?;
    let summary = export_exact(faces, format, output, &work)
        .with_context(|| format!("{}: cannot write", path.display()))?;
    work.finish();
    global.report("mesh", format_args!("{} faces, {} vertices", summary.faces, summary.vertices));
    let (exact, _) = model.exact_faces();
    if exact > 0 {
        let thin = model.metadata().tag(Tag::ModelIntersections);
        let thin = thin.map_or(String::new(), |count| {
            format!(", where the surface intersects itself in {count} positions")
        });
        global.report("rounded", format_args!("{exact} faces with off-grid vertices, to the grid{thin}"));
    }
    if model.is_unbounded() {
        global.report("unbounded", format_args!("infinity is inside: faces point inwards"));
    }
    if summary.moved > 0 {
        let moved = summary.moved;
        global.report("moved", format_args!("{moved} vertices, since the format has single precision"));
    }
    if summary.collapsed > 0 {
        let collapsed = summary.collapsed;
        global
            .report("left out", format_args!("{collapsed} triangles that have no area in single precision"));
    }
    report_output(global, path, start);
    Ok(())
}
