//! `spinney point`: values of single cells, a few from the command line or many from standard
//! input.

use std::io::{self, BufRead, Write};
use std::path::Path;
use std::sync::Mutex;

use anyhow::{Context as _, Result, anyhow, ensure};
use rayon::prelude::*;
use spinney::raw::io::url_of;
use spinney::raw::report::{OUTSIDE, PointLayers};
use spinney::{Coordinates, Dataset, WorldLocator};

use super::args::{CoordinatesOption, ViewedTree, level_of};
use super::exact::PointQuery;
use super::report::warn;
use super::{Global, exact, lines, points};

const EXAMPLES: &str = "Examples:
  spinney point relief.goblin 7.66,45.98
  spinney point relief.goblin -70.0,-33.4 7.66,45.98
  spinney point utm.goblin --in lonlat 7.66,45.98
  spinney point world.goblin --in cells 21600,5000
  spinney point relief.goblin < coordinates.csv > heights.txt
  spinney point house.goblin 3.5,2.25,1.1
  spinney point --in cells --level 6 house.goblin < voxels.csv
  spinney point series.goblin 7.66,45.98 --json
  spinney point house.goblin --distance 3.5,2.25,1.1
  spinney point house.goblin --rays first 3.5,2.25,9,0,0,-1
  spinney point house.goblin --attribute material 3.5,2.25,1.1
  spinney point house.goblin --rays all < rays.csv > hits.csv
  spinney point roads.goblin --in lonlat 7.66,45.98 --nearest 3

An output line has the samples of a point, those of all layers, `void` where there is no data, or
`outside` outside of the raster.

Exact models: `inside`, `outside` or `boundary`; with --distance the distance from the surface,
negative inside; with --rays a line of CSV for each intersection of a ray, given by origin and
direction, with the surface: the number of the ray from 1, the distance in lengths of the direction,
the position, the numbers of the face and its part, and 1 if the ray enters the body there.

Lines of standard input are `X,Y` or `X Y`; octrees need X,Y,Z.";

/// Query the values of single cells
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    /// Points, X,Y or X,Y,Z; read from standard input if there are none
    #[arg(value_name = "X,Y")]
    points: Vec<String>,
    /// Level of detail: the result is the average of the block around the point
    #[arg(long)]
    level: Option<u8>,
    #[command(flatten)]
    coordinates: CoordinatesOption,
    /// Print JSON: a line for each point, with names and times of the layers
    #[arg(long)]
    json: bool,
    /// Name of the object of an exact model that a point is in or on: the one with the nearest
    /// surface, after the point's location and a tab
    #[arg(long, conflicts_with_all = ["distance", "rays"])]
    object: bool,
    /// Signed distance from the surface of an exact model: negative inside, instead of the location
    #[arg(long)]
    distance: bool,
    /// Find the nearest K points or features (trees of points or lines); an output line has the
    /// query point's number, the distance and the coordinates, for lines those of the nearest point
    /// and the feature's number, from 0; distance and coordinates are in the tree's own system,
    /// whatever --in says [default: 1]
    #[arg(long, value_name = "K")]
    nearest: Option<usize>,
    /// Maximum distance of the nearest points or lines [default: any]
    #[arg(long, value_name = "DISTANCE")]
    radius: Option<f64>,
    /// Points where rays cross the surface of an exact model: first or all; a ray is X,Y,Z,DX,DY,DZ
    #[arg(long, value_name = "WHICH", value_parser = ["first", "all"], conflicts_with = "distance")]
    rays: Option<String>,
    /// Attributes of the nearest face of an exact model, or of the face that a ray crosses, as in
    /// material,type; after the location or the distance and tabs, or as columns of --rays
    #[arg(long, value_name = "NAME,...")]
    attribute: Option<String>,
}

impl Args {
    /// Fails for options that nearest-neighbour queries do not have.
    fn check_near(&self, what: &str, global: &Global) -> Result<()> {
        global.check_options(&self.tree.file, what, &["--nearest", "--radius", "--in"])
    }

    /// Returns the nearest-neighbour request, and prints the locator's remarks as warnings.
    fn near(&self, locator: WorldLocator) -> Near {
        locator.remarks().iter().for_each(|remark| warn(remark));
        let within = self.radius.unwrap_or(f64::INFINITY);
        Near { most: self.nearest.unwrap_or(1), within, locator }
    }

    /// Returns the coordinates of positions.
    fn coordinates(&self) -> &Coordinates {
        self.coordinates.given().unwrap_or(&Coordinates::World)
    }

    /// Returns the query for points of exact models.
    fn query(&self) -> PointQuery {
        match (self.object, self.distance) {
            (true, _) => PointQuery::Object,
            (false, true) => PointQuery::Distance,
            (false, false) => PointQuery::Position,
        }
    }
}

/// A nearest-neighbour request.
pub(crate) struct Near {
    /// Maximum number of points or features per position.
    pub(crate) most: usize,
    /// Maximum distance, in the tree's unit.
    pub(crate) within: f64,
    /// Converts positions to the tree's coordinates.
    pub(crate) locator: WorldLocator,
}

fn in_file(path: &Path) -> String {
    path.display().to_string()
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    if let Some(view) = args.tree.open_model(global)? {
        global.check_options(
            &args.tree.file,
            exact::KIND,
            &["--object", "--distance", "--rays", "--attribute", "--view"],
        )?;
        let attribute = args.attribute.as_deref();
        return match &args.rays {
            Some(which) => exact::rays(&view, &args.points, which == "all", attribute),
            None => exact::points(&view, &args.points, args.query(), attribute),
        };
    }
    if let Some(tree) = lines::open(&args.tree.file, global)? {
        args.check_near(lines::KIND, global)?;
        let near = args.near(tree.locator(args.coordinates()).with_context(|| in_file(&args.tree.file))?);
        return lines::nearest(&tree, &args.points, &near, global);
    }
    if let Some(tree) = points::open(&args.tree.file, global)? {
        args.check_near(points::KIND, global)?;
        let near = args.near(tree.locator(args.coordinates()).with_context(|| in_file(&args.tree.file))?);
        return points::nearest(&tree, &args.points, &near, global);
    }
    ensure!(
        args.nearest.is_none() && args.radius.is_none(),
        "--nearest and --radius: work only with trees of points or lines"
    );
    let is_of_models = args.distance || args.object || args.rays.is_some() || args.attribute.is_some();
    ensure!(!is_of_models, "--object, --distance, --rays and --attribute: work only with exact models");
    let trees = args.tree.open_all(global)?;
    // Positions are cells of the layer with the smallest cells.
    let finest = trees.iter().max_by_key(|tree| tree.depth()).expect("a file has a layer");
    let level = level_of(finest, args.level)?;
    global.report_approximate(finest, level);
    let from = if args.points.is_empty() { "standard input, line" } else { "point" };
    let coordinates = args.coordinates();
    let layers: Vec<&Dataset> = trees.iter().collect();
    let layers = PointLayers::new(&layers, coordinates, Some(level))?;
    layers.locator().remarks().iter().for_each(|remark| warn(remark));
    let points = Points {
        headings: args.json.then(|| layers.headings()),
        layers,
        from,
        is_remote: trees.iter().any(|tree| url_of(tree.name()).is_some()),
        outside: Mutex::default(),
    };
    let mut out = io::BufWriter::with_capacity(1 << 20, io::stdout().lock());
    if !args.points.is_empty() {
        let lines = args.points.join("\n");
        out.write_all(&points.result(lines.as_bytes(), 1)?)?;
    } else {
        points.stream(io::stdin().lock(), &mut out)?;
    }
    out.flush()?;
    points.warn_of_outside();
    trees.iter().try_for_each(Dataset::check_unchanged)?;
    Ok(())
}

/// Queries of points.
struct Points<'a> {
    layers: PointLayers<'a>,
    /// Whether the file is remote.
    is_remote: bool,
    /// Points outside of the extent so far.
    outside: Mutex<OutsidePoints>,
    /// Prefix of point numbers in messages.
    from: &'static str,
    /// With --json, the beginning of each layer's result.
    headings: Option<Vec<String>>,
}

/// Points that lie outside of the extent.
#[derive(Default)]
struct OutsidePoints {
    count: u64,
    /// Those that would be inside if x and y were swapped.
    swapped: u64,
}

/// Bytes of input per batch, for all threads.
const BATCH: usize = 4 << 20;

impl Points<'_> {
    /// Processes all lines of an input, of any length, in batches.
    fn stream(&self, mut input: impl BufRead, out: &mut impl Write) -> Result<()> {
        let mut rest: Vec<u8> = Vec::new();
        let mut line = 1;
        loop {
            let before = rest.len();
            let read = io::Read::take(&mut input, BATCH as u64);
            let count = io::Read::read_to_end(&mut { read }, &mut rest).context("standard input")?;
            let whole = match rest[before..].iter().rposition(|byte| *byte == b'\n') {
                _ if count == 0 => rest.len(),
                Some(end) => before + end + 1,
                None => {
                    ensure!(
                        rest.len() < 2 * BATCH,
                        "standard input, line {line}: is longer than {BATCH} bytes"
                    );
                    continue;
                }
            };
            // The threads process sections of the batch, cut at line ends. (For a remote file there
            // is one section, so that the ranges of all points are fetched in one batch.)
            let parts = if self.is_remote { 1 } else { rayon::current_num_threads() * 4 };
            let parts = split_lines(&rest[..whole], parts);
            let starts = parts.iter().scan(line, |next, part| {
                let start = *next;
                *next += part.iter().filter(|byte| **byte == b'\n').count() as u64;
                Some(start)
            });
            let parts: Vec<_> = parts.iter().copied().zip(starts).collect();
            let results: Result<Vec<_>> =
                parts.par_iter().map(|(part, line)| self.result(part, *line)).collect();
            for result in results? {
                out.write_all(&result)?;
            }
            line += rest[..whole].iter().filter(|byte| **byte == b'\n').count() as u64;
            rest.drain(..whole);
            if count == 0 {
                return Ok(());
            }
        }
    }

    /// Returns a result line for each nonempty input line. The first input line has number `first`.
    fn result(&self, lines: &[u8], first: u64) -> Result<Vec<u8>> {
        let text = std::str::from_utf8(lines).context("standard input: is not UTF-8 text")?;
        let mut cells = Vec::new();
        for (line, number) in text.lines().zip(first..) {
            let line = line.trim();
            if !line.is_empty() {
                cells.push(self.cell(line, number)?);
            }
        }
        let report = self.layers.query(&cells)?;
        let mut results = Vec::with_capacity(lines.len());
        for index in 0..cells.len() {
            match &self.headings {
                Some(headings) => report.write_json(headings, index, &mut results),
                None => report.write_text(index, &mut results),
            }
        }
        Ok(results)
    }

    /// Returns the cell of the level that contains the point of a line.
    fn cell(&self, line: &str, number: u64) -> Result<[u64; 3]> {
        let axes = self.layers.axes();
        let wrong = || {
            let wanted = if axes == 3 { "X,Y,Z" } else { "X,Y" };
            anyhow!("{} {number}: got `{line}`, expected {wanted}", self.from)
        };
        let mut point = [0.0; 3];
        let mut given = 0;
        for word in line.split([',', ' ', '\t', ';']).filter(|word| !word.is_empty()) {
            let coordinate = word.parse().ok().filter(|coordinate: &f64| coordinate.is_finite());
            *point.get_mut(given).ok_or_else(wrong)? = coordinate.ok_or_else(wrong)?;
            given += 1;
        }
        ensure!(given >= axes, wrong());
        let cell = self.layers.cell(point);
        if cell == OUTSIDE {
            let swapped = self.layers.cell([point[1], point[0], point[2]]);
            let mut outside = self.outside.lock().expect("no thread has panicked");
            outside.count += 1;
            outside.swapped += u64::from(swapped != OUTSIDE);
        }
        Ok(cell)
    }

    /// Reports the number of points outside of the extent, if there are any.
    fn warn_of_outside(&self) {
        let outside = self.outside.lock().expect("no thread has panicked");
        let OutsidePoints { count, swapped } = *outside;
        if count == 0 {
            return;
        }
        let advice = match swapped {
            0 => "",
            _ => "; with x and y swapped they would be inside: longitude comes before latitude",
        };
        let what = if self.layers.axes() == 3 { "octree" } else { "raster" };
        let points = if count == 1 { "1 point is".into() } else { format!("{count} points are") };
        warn(&format!(
            "{points} outside of the {what}, which is {}{advice}",
            self.layers.locator().bounds_text()
        ));
    }
}

/// Splits text at line ends into about `parts` sections.
fn split_lines(bytes: &[u8], parts: usize) -> Vec<&[u8]> {
    let mut rest = bytes;
    let mut list = Vec::new();
    while !rest.is_empty() {
        let aim = (bytes.len() / parts).max(1).min(rest.len());
        let end =
            rest[aim - 1..].iter().position(|byte| *byte == b'\n').map_or(rest.len(), |more| aim + more);
        let (part, after) = rest.split_at(end);
        list.push(part);
        rest = after;
    }
    list
}
