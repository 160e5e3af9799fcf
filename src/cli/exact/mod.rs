//! The subcommands for exact models.

mod combine;
mod edit;
mod export;
mod find;
mod info;
mod objects;
mod point;
mod stats;
mod transform;

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use spinney::brep::Faces;
use spinney::import::feature::FeatureFilter;
use spinney::raw::brep::{BuildReport, ModelView, is_model_file};
use spinney::raw::import::feature::choose_objects;
use spinney::raw::store::Tag;
use spinney::{ExactModel, ViewOperation};

use super::Global;

pub(super) use combine::{any_model, combine};
pub(super) use edit::{EulerChange, change, operators};
pub(super) use export::{MeshContents, MeshOutput, export, window};
pub(super) use find::{LeafKind, find};
pub(super) use info::info;
pub(super) use objects::{find_contacts, find_object, parts_named};
pub(super) use point::{PointQuery, points, rays};
pub(super) use stats::{each, stats};
pub(super) use transform::{Moving, transform};

/// Opens the exact model in a file; `None` if the file has anything else.
pub(super) fn open(path: &Path, global: &Global) -> Result<Option<ExactModel>> {
    if !is_model_file(path, global.access())? {
        return Ok(None);
    }
    Ok(Some(ExactModel::open(path, &global.access().into())?))
}

/// Opens the exact model in a file, viewed through operations; `None` if the file has anything
/// else.
pub(super) fn open_viewed(
    path: &Path,
    steps: &[ViewOperation],
    global: &Global,
) -> Result<Option<ModelView>> {
    let Some(model) = open(path, global)? else { return Ok(None) };
    if steps.is_empty() {
        return Ok(Some(model.into()));
    }
    let view = ModelView::of(model, &transform::motion(steps)?)?;
    if !view.is_exact() {
        let (most, unit) = (view.rounding(), unit(view.file()));
        global.report(
            "view",
            format_args!(
                "positions are rounded when mapped to the model and back, by less than {most:.0e}{unit}"
            ),
        );
    }
    Ok(Some(view))
}

/// Returns the parts of a model for which conditions hold, including child parts.
///
/// # Errors
/// If there is none.
pub(super) fn chosen(model: &ExactModel, filter: &FeatureFilter) -> Result<BTreeSet<u32>> {
    let found = choose_objects(filter, model.parts(), &|part| model.part_attributes(part))
        .with_context(|| model.path().display().to_string())?;
    if found.is_empty() {
        bail!("{}: --where {filter}: no object satisfies the conditions", model.path().display());
    }
    Ok(found)
}

/// Name of exact models in messages.
pub(super) const KIND: &str = "an exact model";

/// Fails for options that have no meaning for exact models.
pub(super) fn refuse(path: &Path, options: &[(&str, bool)]) -> Result<()> {
    let file = path.display();
    if let Some((name, _)) = options.iter().find(|(_, is_given)| *is_given) {
        bail!(
            "{file}: is an exact model, not a tree of cells, which {name} needs; make one: `spinney build {file} -o CELLS.goblin`"
        );
    }
    Ok(())
}

/// Reports a result's face count, and where its surface intersects itself.
fn report_result(faces: u64, is_unbounded: bool, built: &BuildReport, global: &Global) {
    let count = built.defect_count;
    if count > 0 {
        global.report(
            "thin",
            format_args!("{count} positions where the surface intersects itself on the grid, such as"),
        );
        built.defects.iter().take(5).for_each(|defect| global.report("", format_args!("{defect}")));
    }
    let far = if is_unbounded { ", unbounded: infinity is inside" } else { "" };
    global.report("result", format_args!("{faces} faces{far}"));
}

/// Returns the length unit of a model's coordinates, with a leading blank; empty if unknown.
fn unit(model: &ExactModel) -> String {
    model.metadata().tag(Tag::Unit).map_or(String::new(), |unit| format!(" {unit}"))
}

/// Formats a point, with the shortest digits that denote its coordinates exactly.
fn list(point: [f64; 3]) -> String {
    let [x, y, z] = point;
    format!("{x}, {y}, {z}")
}

/// Returns the minimum and maximum corner of the grid in the world.
fn space(model: &ExactModel) -> [[f64; 3]; 2] {
    let grid = model.grid();
    [grid.to_world([0; 3]), grid.to_world([(1 << grid.bits) - 1; 3])]
}
