//! Making solids: the options of `spinney build` for models, and what it says.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use spinney::import::mesh::{self, Attribute, Boundary, Resolution, SolidOptions};
use spinney::space::Up;
use spinney::io::Output;

use super::output::{check_output, tell_output};
use super::progress::Work;
use super::{Global, Result, open};

/// Options for models only. (Not called `Args`: clap would take it for the group around it.)
#[derive(clap::Args, Debug, Default)]
#[command(next_help_heading = "Solids (PLY, OBJ, STL, OFF, CityJSON)")]
pub(crate) struct Model {
    /// Cells along the model's longest side [default: 256]
    #[arg(long, value_name = "N", conflicts_with_all = ["depth", "like"])]
    cells: Option<u64>,
    /// Width of a cell, such as 0.5 or 0.5mm; models built with the same width fit together
    #[arg(long, value_name = "WIDTH", conflicts_with_all = ["cells", "depth", "like"], value_parser = width)]
    cell: Option<Width>,
    /// The cells of another tree, so that both can be combined
    #[arg(long, value_name = "OTHER.goblin", conflicts_with = "depth")]
    like: Option<PathBuf>,
    /// What the surface encloses; this is the default
    #[arg(long, conflicts_with = "surface")]
    solid: bool,
    /// Only the cells that the surface cuts
    #[arg(long)]
    surface: bool,
    /// Cells that the surface cuts: full (all belong to it), centre (those whose centre is inside) or coverage (as far
    /// as they are inside) [default: centre]
    #[arg(long, value_name = "RULE")]
    boundary: Option<Boundary>,
    /// What cells hold: occupancy (255 is full), colour, or part (the number of an object, group or material)
    /// [default: occupancy]
    #[arg(long)]
    attribute: Option<Attribute>,
    /// The axis of the model that points up; y is turned to z [default: z]
    #[arg(long, value_name = "AXIS")]
    up: Option<Up>,
    /// Unit of the model's coordinates, where the file does not tell: mm, cm, m, km, in or ft
    #[arg(long, value_parser = ["mm", "cm", "m", "km", "in", "ft"])]
    unit: Option<String>,
    /// Tell how the surface was read and what is inside
    #[arg(long)]
    stats: bool,
}

/// A width, with its unit if one was given.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Width(f64, Option<String>);

fn width(text: &str) -> Result<Width, String> {
    let end = text.find(|c: char| c.is_ascii_alphabetic() && c != 'e').unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let number: f64 = number.trim().parse().map_err(|_| "expected a width such as 0.5 or 0.5mm")?;
    if !unit.is_empty() && metres(unit).is_none() {
        return Err("the unit should be mm, cm, m, km, in or ft".into());
    }
    Ok(Width(number, (!unit.is_empty()).then(|| unit.to_string())))
}

fn metres(unit: &str) -> Option<f64> {
    let units = [("mm", 0.001), ("cm", 0.01), ("m", 1.0), ("km", 1000.0), ("in", 0.0254), ("ft", 0.3048)];
    units.into_iter().find(|(name, _)| *name == unit).map(|(_, metres)| metres)
}

impl Model {
    /// Whether any of them was given, which makes no sense for pictures.
    pub(crate) fn is_given(&self) -> bool {
        let Model { cells, cell, like, solid, surface, boundary, attribute, up, unit, stats } = self;
        cells.is_some()
            || cell.is_some()
            || like.is_some()
            || *solid
            || *surface
            || boundary.is_some()
            || attribute.is_some()
            || up.is_some()
            || unit.is_some()
            || *stats
    }

    fn resolution(&self, depth: Option<u8>, unit: Option<&str>) -> Result<Resolution> {
        if let Some(Width(width, given)) = &self.cell {
            let Some(given) = given else { return Ok(Resolution::Cell(*width)) };
            let unit = self.unit.as_deref().or(unit);
            let unit = unit.context("--cell: the model's unit is not known; tell it with --unit")?;
            let of = |unit: &str| metres(unit).with_context(|| format!("unknown unit {unit}; use --unit"));
            return Ok(Resolution::Cell(width * of(given)? / of(unit)?));
        }
        if let Some(path) = &self.like {
            let tree = open(path)?;
            ensure!(tree.header().form.axes() == 3, "{}: is a quadtree, --like needs an octree", path.display());
            return Ok(Resolution::Like(tree.metadata().frame.clone(), tree.depth()));
        }
        Ok(depth.map_or(Resolution::Cells(self.cells.unwrap_or(256)), Resolution::Depth))
    }
}

/// Builds a solid.
pub(crate) fn build(
    inputs: &[PathBuf],
    path: &Path,
    args: &Model,
    (depth, epsg, memory, share): (Option<u8>, Option<u32>, u64, bool),
    global: &Global,
) -> Result {
    let start = Instant::now();
    check_output(inputs.iter().chain(&args.like).map(PathBuf::as_path), path)?;
    let models = mesh::open_all(inputs, memory)?;
    let unit = models.iter().find_map(|model| model.info().unit.clone());
    let options = SolidOptions {
        resolution: args.resolution(depth, unit.as_deref())?,
        boundary: args.boundary.unwrap_or_default(),
        attribute: args.attribute.unwrap_or_default(),
        surface: args.surface,
        up: args.up.unwrap_or_default(),
        unit: args.unit.clone().or(unit),
        epsg,
        memory,
        share,
    };
    if options.surface && args.boundary.is_some() {
        bail!("--boundary: says which cells belong to a solid; with --surface all that the surface cuts do");
    }
    let import = mesh::plan_models(models, &options)?;
    for (heading, text) in import.description() {
        global.say(format_args!("{heading:<10} {text}"));
    }
    let work = Work::start(global, "cells")?;
    let output = Output::create(path)?;
    let report = import.build(output, &work)?;
    work.finish();
    global.say(format_args!("{:<10} {}", "surface", report.inside.text()));
    if report.undecided > 0 {
        global.say(format_args!("{:<10} {} cells in its holes, by a guess", "undecided", report.undecided));
    }
    if report.doubled > 0 {
        global.say(format_args!("{:<10} {} triangles, which count once", "doubled", report.doubled));
    }
    if args.stats {
        let (faces, degenerate, triangles) = (report.faces, report.degenerate, report.triangles);
        global.say(format_args!(
            "{:<10} {faces} read, {triangles} triangles; {degenerate} left out that cover nothing",
            "faces"
        ));
        global.say(format_args!("{:<10} vertices by at most {:e}", "moved", report.displacement));
        for (name, apart, cutting) in report.stages.named() {
            global.say(format_args!(
                "{name:<10} decided {apart} times that an octant is not cut, {cutting} times that it is"
            ));
        }
    }
    tell_output(global, path, start);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_read() {
        assert_eq!(width("0.5"), Ok(Width(0.5, None)));
        assert_eq!(width("0.5mm"), Ok(Width(0.5, Some("mm".into()))));
        assert_eq!(width("1e-3m"), Ok(Width(0.001, Some("m".into()))));
        for text in ["", "mm", "5 yards", "1,5"] {
            assert!(width(text).is_err(), "{text}");
        }
    }
}
