//! Class regions as polygons.

use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::export::export_polygons;
use spinney::query::PolygonRequest;
use spinney::raw::ops::Connectivity;
use spinney::{Dataset, Number};

use super::super::args::{check_output, class_value, level_of, vector_format};
use super::super::report::{Work, report_output, warn};
use super::super::{Global, exact};
use super::Args;

/// Options of polygons.
#[derive(clap::Args)]
pub(super) struct PolygonOptions {
    /// Connected regions of one class, whose cells share edges, as polygons with class, name,
    /// colour, number of cells and area
    #[arg(long)]
    pub(super) polygons: bool,
    /// Values equal to these only, as in 3,4; also names of classes
    #[arg(long = "class", value_name = "VALUE,...", value_delimiter = ',')]
    pub(super) classes: Option<Vec<String>>,
    /// Neighbours of a cell in its region: 4 (across edges) or 8 (also across corners, where a
    /// region becomes several polygons that touch) [default: 4]
    #[arg(long, value_name = "N")]
    connect: Option<Connectivity>,
    /// Maximum distance for simplifying borders, in units of the tree's coordinates; neighbours
    /// keep the same border
    #[arg(long, value_name = "DISTANCE", requires = "polygons")]
    simplify: Option<f64>,
}

impl PolygonOptions {
    /// Returns the first given option for regions in any format.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [("--class", self.classes.is_some()), ("--connect", self.connect.is_some())];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns the request for regions of a tree at a level.
    pub(super) fn request(&self, tree: &Dataset, level: u8) -> Result<PolygonRequest> {
        let mut request = PolygonRequest::new();
        let connect = self.connect.map_or(4, Connectivity::neighbours);
        ensure!(
            [4, 8].contains(&connect),
            "--connect: got {connect}, expected 4 or 8, the neighbours of a quadtree's cell"
        );
        request.across_corners = connect == 8;
        let values = |classes: &Vec<String>| -> Result<Vec<Number>> {
            classes.iter().map(|class| class_value(tree, "--class", class)).collect()
        };
        request.classes = self.classes.as_ref().map(values).transpose()?;
        request.simplify = self.simplify;
        request.level = Some(level);
        Ok(request)
    }
}

/// Writes the polygons.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file, global)?.is_some() {
        exact::refuse(&args.tree.file, &[("--polygons", true)])?;
    }
    let tree = args.tree.open(global)?;
    check_output([args.tree.file.as_path()], args.output.path())?;
    let format = match args.format {
        Some(format) => format.of_polygons()?,
        None => vector_format(None, args.output.path())?,
    };
    let request = args.polygons.request(&tree, level_of(&tree, args.mesh.level)?)?;
    let work = Work::start(global, "cells")?;
    let output = global.access().create(args.output.path())?;
    let summary = export_polygons(&tree, &request, output, format, &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    let (count, rings, points) = (summary.count, summary.rings, summary.points);
    global.report("polygons", format_args!("{count} of {rings} rings and {points} points"));
    report_output(global, args.output.path(), start);
    if count == 0 {
        let name = args.output.path().display();
        warn(&format!("{name}: has no polygons: no cell has a value, or one of those of --class"));
    }
    Ok(())
}
