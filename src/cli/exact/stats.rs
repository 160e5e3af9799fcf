//! `spinney stats` of an exact model.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use serde_json::json;
use spinney::ExactModel;
use spinney::brep::{Faces, MassProperties};
use spinney::export::VectorFormat;
use spinney::import::feature::FeatureFilter;
use spinney::raw::brep::ModelView;
use spinney::raw::brep::topology::{Euler, Topology, TopologyOptions};
use spinney::raw::export::vector::export_objects;
use spinney::raw::io::shown;
use spinney::raw::store::Tag;

use super::super::Global;
use super::super::args::{check_output, vector_format_of};
use super::super::report::{Work, print_json, print_text, printed_output, report_output};
use super::{chosen, list, unit};

/// Prints the measures of an exact model: volume, centre, moments and surface; and its topology, if
/// there is `memory` for it.
pub(crate) fn stats(view: &ModelView, memory: Option<u64>, is_json: bool, global: &Global) -> Result<()> {
    let work = Work::start(global, "faces")?;
    let (mass, model) = (view.mass(&work)?, view.file());
    let euler_of = |memory| -> spinney::Result<Euler> {
        let options = TopologyOptions { memory, path: model.path().to_path_buf() };
        Ok(Topology::of(model, &options, &work)?.euler())
    };
    let euler = memory.map(euler_of).transpose()?;
    work.finish();
    if is_json {
        print_json(&as_json(model, &mass, euler.as_ref()))
    } else {
        print_text(&as_text(model, &mass, euler.as_ref())?)
    }
}

/// Writes a table of the objects of an exact model for which conditions hold: to standard output as
/// CSV, if no file is given.
pub(crate) fn each(
    view: &ModelView,
    filter: FeatureFilter,
    path: Option<&Path>,
    memory: u64,
    global: &Global,
) -> Result<()> {
    let (start, model) = (Instant::now(), view.file());
    let objects = match filter.conditions.is_empty() {
        true => None,
        false => Some(chosen(model, &filter)?),
    };
    let (format, output) = match path {
        Some(path) => {
            let format = vector_format_of(path)?;
            check_output([model.path()], path)?;
            (format, global.access().create(path)?)
        }
        None => (VectorFormat::Csv, printed_output()),
    };
    let work = Work::start(global, "faces")?;
    let count = export_objects(view, objects.as_ref(), output, format, memory, &work)?;
    work.finish();
    global.report("objects", format_args!("{count} of {}", model.parts().len()));
    if let Some(path) = path.filter(|path| *path != Path::new("-")) {
        report_output(global, path, start);
    }
    Ok(())
}

fn as_json(model: &ExactModel, mass: &MassProperties, euler: Option<&Euler>) -> serde_json::Value {
    let euler = euler.map(|euler| {
        json!({
            "vertices": euler.vertices,
            "edges": euler.edges,
            "faces": euler.faces,
            "rings": euler.rings,
            "shells": euler.shells,
            "genus": euler.genus,
        })
    });
    let is_known = model.metadata().frame.cell_volume().is_ok();
    json!({
        "file": shown(model.path()),
        "unit": model.metadata().tag(Tag::Unit),
        "volume": is_known.then_some(mass.volume),
        "surface": is_known.then_some(mass.area),
        "centre": mass.centre,
        "second_moments": mass.second_moments,
        "inertia": mass.inertia,
        "bounds": mass.bounds,
        "topology": euler,
    })
}

fn as_text(model: &ExactModel, mass: &MassProperties, euler: Option<&Euler>) -> Result<String> {
    let mut text = String::new();
    let unit = unit(model);
    let power = |power: u8| if unit.is_empty() { String::new() } else { format!("{unit}{power}") };
    writeln!(text, "body       exact: {} faces", mass.faces)?;
    match model.metadata().frame.cell_volume() {
        Ok(_) => {
            writeln!(text, "  volume   {}{}", mass.volume, power(3))?;
            writeln!(text, "  surface  {}{}", mass.area, power(2))?;
        }
        Err(reason) => writeln!(text, "  volume   unknown: {reason}\n  surface  unknown: {reason}")?,
    }
    if let Some(centre) = mass.centre {
        writeln!(text, "  centre   {}", list(centre))?;
    }
    if let Some([low, high]) = mass.bounds {
        writeln!(text, "  bounds   {} to {}", list(low), list(high))?;
    }
    let [x, y, z] = mass.inertia;
    writeln!(text, "  inertia  {}; {}; {} (about the centre, density 1)", list(x), list(y), list(z))?;
    if let Some(Euler { vertices, edges, faces, rings, shells, genus, .. }) = euler {
        let genus = genus.map_or("unknown".into(), |genus| genus.to_string());
        writeln!(
            text,
            "  topology {vertices} vertices, {edges} edges, {faces} faces, {rings} rings in faces; {shells} shells, \
             genus {genus}"
        )?;
    }
    Ok(text)
}
