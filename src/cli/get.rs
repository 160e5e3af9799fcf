//! `spinney get`: any region at any level as an image or array.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use spinney::brep::SurfaceDetail;
use spinney::export::{ArrayRequest, Detail, MeshFormat, WindowRequest, export_array, export_window};
use spinney::raw::export::export_layers;
use spinney::raw::export::image::Format;
use spinney::raw::ops::WarpGrid;
use spinney::raw::space::web_mercator_depth;
use spinney::style::Style;
use spinney::{Bounds, Dataset, ExactModel, Number, SampleType};

use super::args::{
    OutputFile, PartOptions, Size, Slice, ViewedTree, check_output, level_of, numbers, parse_size,
    parse_slice, parse_style, raster_format,
};
use super::points::{self, PointSelection};
use super::report::{Work, report_output};
use super::{Global, exact, lines};

const EXAMPLES: &str = "Examples:
  spinney get world.goblin overview.png --size 1024x512
  spinney get world.goblin alps.tif --in world --window 5,44,17,48
  spinney get utm.goblin fiji.tif --in lonlat --window 176,-20,-178,-15
  spinney get relief.goblin alps.png --in world --window 5,44,17,48 --style hillshade
  spinney get world.goblin - --format png --size 256x256 > tile.png
  spinney get scene.goblin infrared.png --layer B08,B04,B03 --size 1000";

/// Write any region at any level of detail as an image or array
///
/// The output's name selects the format: .png, .webp (lossless), .tif, .exr, .npy, .nrrd, .raw.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    output: OutputFile,
    #[command(flatten)]
    part: PartOptions,
    /// Level of detail: 0 is one cell for everything, the file's depth (the default) is the
    /// original cells
    #[arg(long, conflicts_with = "size")]
    level: Option<u8>,
    /// Columns and rows, or the longer side (keeps the aspect ratio). Continuous values are
    /// averages over pixels, to half a cell of a level with at least two cells along a pixel's
    /// sides; classes are those at the centres of pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<Size>,
    /// Exact averages for --size: the deepest cells are read wherever a pixel's edge cuts a node
    #[arg(long, requires = "size")]
    exact: bool,
    /// Slice of an octree perpendicular to an axis, as in z=12, x=3 or y=5: a cell of the deepest
    /// level [default: z=0]
    #[arg(long, value_name = "AXIS=N", value_parser = parse_slice)]
    slice: Option<Slice>,
    #[command(flatten)]
    point_selection: PointSelection,
    /// Lines of a feature file: write the features of a tree of lines that they cross or touch.
    /// Lines are reprojected to the tree's coordinate system
    #[arg(long, value_name = "LINES", conflicts_with_all = ["window", "within", "ball"])]
    crossing: Option<PathBuf>,
    /// Maximum distance of the lines of --crossing [default: 0, those that cross or touch]
    #[arg(long, value_name = "DISTANCE", requires = "crossing")]
    radius: Option<f64>,
    /// Attributes of points or lines to write, as in intensity,classification [default: all]
    #[arg(long, value_name = "NAME,...")]
    attribute: Option<String>,
    /// Format [default: by the output's extension]
    #[arg(long, value_parser = ["png", "webp", "tif", "exr", "npy", "nrrd", "raw", "las", "laz", "csv", "ply", "geojson", "svg", "gpkg", "fgb", "shp", "obj"])]
    format: Option<String>,
    /// Nodata number for VOID; an error if it lies within the values [default: the layer's own if
    /// no value can be equal to it, else NaN or an end of the type's range; if none is free, .tif
    /// has a mask]
    #[arg(long, allow_hyphen_values = true)]
    nodata: Option<Number>,
    /// Colours: a style's name (viridis, terrain, hillshade, relief ...), its JSON or a file with
    /// it (docs/styles.md) [default: the values; .webp, and .png unless u8 or u16: the style
    /// "default"]
    #[arg(long, value_name = "STYLE", value_parser = parse_style, conflicts_with = "nodata")]
    style: Option<Style>,
    /// Grey between two numbers (black, white); shorthand for a style
    #[arg(long, value_name = "A,B", value_parser = parse_range, conflicts_with = "style")]
    range: Option<[f64; 2]>,
}

/// Parses two different numbers.
fn parse_range(text: &str) -> Result<[f64; 2], String> {
    numbers(text)
        .filter(|[black, white]: &[f64; 2]| black != white && black.is_finite() && white.is_finite())
        .ok_or_else(|| "expected two numbers that differ, as in 0,4000".into())
}

/// Writes the faces of an exact model in a window.
fn get_faces(args: &Args, model: &ExactModel, global: &Global) -> Result<()> {
    let (file, path) = (args.tree.file.display(), args.output.path());
    let format = args.format.as_deref().map_or(MeshFormat::of(path), |format| format.parse().ok());
    let Some(format) = format else {
        bail!(
            "{file}: is an exact model, which has no cells; `spinney get {file} FACES.ply --window X,Y,Z,X,Y,Z` writes faces, \
             `spinney render {file} -o IMAGE.png` an image, `spinney section {file} z=HEIGHT -o OUTLINE.svg` a section; \
             or make cells: `spinney build {file} --cells N -o CELLS.goblin`"
        );
    };
    let fitting = ["--output", "--format", "--window", "--in", "--level", "--view"];
    global.check_options(&args.tree.file, exact::KIND, &fitting)?;
    ensure!(args.part.is_given() || args.part.coordinates().given().is_none(), IN_IS_FOR);
    let contents = exact::MeshContents {
        triangles: false,
        filter: None,
        detail: args.level.map_or(SurfaceDetail::Exact, SurfaceDetail::Level),
        within: exact::window(&args.part)?,
    };
    exact::export(model, path, exact::MeshOutput::Mesh(format), contents, global)
}

/// Error message for coordinates without a window or slice.
const IN_IS_FOR: &str = "--in: works only with --window or --slice";

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let path = args.output.path();
    if let Some(view) = args.tree.open_model(global)? {
        return get_faces(args, view.as_model("faces")?, global);
    }
    if let Some(tree) = lines::open(&args.tree.file, global)? {
        let fitting = ["--output", "--format", "--window", "--in", "--crossing", "--radius", "--attribute"];
        global.check_options(&args.tree.file, lines::KIND, &fitting)?;
        ensure!(args.part.is_given() || args.part.coordinates().given().is_none(), IN_IS_FOR);
        let format = args.format.as_deref();
        let selection = (&args.part, args.crossing.as_deref(), args.radius.unwrap_or(0.0));
        return lines::get(&tree, selection, (path, format), args.attribute.as_deref(), global);
    }
    ensure!(args.crossing.is_none(), "--crossing: works only with trees of lines");
    if let Some(tree) = points::open(&args.tree.file, global)? {
        let fitting = [
            "--output",
            "--format",
            "--window",
            "--in",
            "--within",
            "--ball",
            "--where",
            "--attribute",
            "--level",
        ];
        global.check_options(&args.tree.file, points::KIND, &fitting)?;
        ensure!(args.part.is_given() || args.part.coordinates().given().is_none(), IN_IS_FOR);
        let selection = args.point_selection.selection(&tree, &args.part, args.level, global)?;
        return points::get(
            &tree,
            &selection,
            (path, args.format.as_deref()),
            args.attribute.as_deref(),
            global,
        );
    }
    let of_points = args.point_selection.given().or(args.attribute.as_ref().map(|_| "--attribute"));
    if let Some(option) = of_points {
        bail!("{option}: works only with trees of points or lines");
    }
    let format = raster_format(path, args.format.as_deref(), ".png, .webp, .tif, .exr, .npy, .nrrd or .raw");
    // Images have layers as colours; arrays have them as bands.
    let is_drawn = args.style.is_some() || args.range.is_some() || args.slice.is_some();
    let is_drawn = is_drawn || matches!(format, Ok(Format::Png | Format::Webp | Format::Exr));
    let is_composite = is_drawn && args.tree.is_composite(global)?;
    let trees =
        if is_composite { vec![args.tree.open_drawn(global)?] } else { args.tree.open_all(global)? };
    let format = format?;
    check_output([args.tree.file.as_path()], path)?;
    let tree = match <[Dataset; 1]>::try_from(trees) {
        Ok([tree]) => tree,
        Err(trees) => return layers(args, trees, format, global, start),
    };
    let coordinates = args.part.coordinates();
    let has_position = args.part.is_given() || args.slice.is_some();
    ensure!(coordinates.given().is_none() || has_position, IN_IS_FOR);
    let is_octree = tree.header().form.axes() == 3;
    let is_array = matches!(format, Format::Npy | Format::Nrrd | Format::Raw);
    let style = args.style.clone().or(args.range.map(|range| Style::stretched(&tree, range)));
    let is_cut = args.slice.is_some() || args.size.is_some() || style.is_some();
    ensure!(
        !args.part.is_solid() || !is_cut,
        "--window: got 6 numbers, which select an array, expected 4 with --slice, --size, --style or --range"
    );
    if args.part.is_solid() || is_octree && is_array && !is_cut {
        return array(args, &tree, format, global, start);
    }
    let default_region = default_region(&tree, global)?;
    let slice = args.slice.unwrap_or(Slice::FLOOR);
    ensure!(
        is_octree || args.slice.is_none(),
        "{}: is a quadtree, which has no slices; --slice works only with octrees",
        args.tree.file.display()
    );
    let across = slice.axis;
    let boxes = args.part.slice_boxes(&tree, across)?;
    let (tree, mut bounds) = match boxes.as_deref() {
        None => (tree, default_region),
        Some([west, east]) => across_east_edge(tree, west, east)?,
        Some(boxes) => (tree, boxes[0]),
    };
    let is_placed = args.slice.is_some() && !coordinates.are_cells();
    let cell = slice.cell(&tree, is_placed)?;
    (bounds.min[across], bounds.max[across]) = (cell, cell + 1);
    if is_octree && args.slice.is_none() {
        let slices = tree.header().extent[across];
        global.report("slice", format_args!("z={cell} of {slices} (--slice z=N for another)"));
    }
    // Columns and rows are the other two axes, in order.
    let [columns, rows] = [[1, 2], [0, 2], [0, 1]][across].map(|axis: usize| bounds.size()[axis]);
    let level = level_of(&tree, args.level)?;
    let pixels = match args.size {
        Some(size) => size.of(columns, rows),
        None => {
            let shift = tree.depth() - level;
            // (A block is included if any of its cells is in the region.)
            let blocks = |axis: usize| (bounds.max[axis].div_ceil(1 << shift)) - (bounds.min[axis] >> shift);
            let [columns, rows] = [[1, 2], [0, 2], [0, 1]][across].map(blocks);
            (columns, rows)
        }
    };
    let detail = match args.size.map(|_| pixels) {
        Some((width, height)) if args.exact => Detail::Exact(width, height),
        Some((width, height)) => Detail::Size(width, height),
        None => Detail::Level(level),
    };
    let mut request = WindowRequest::new(bounds, detail);
    (request.across, request.nodata) = (across, args.nodata);
    let progress = Work::start(global, "pixels")?;
    let fits = matches!(tree.header().form.value.sample, SampleType::U8 | SampleType::U16);
    let is_usual = matches!(format, Format::Png | Format::Webp) && style.is_none();
    let default =
        (is_usual && (is_composite || !fits || format == Format::Webp)).then(|| Style::default_for(&tree));
    if let Some(default) = &default {
        global.report("style", format_args!("{}; see --style and --range", default.json()));
    }
    request.style = style.or(default.filter(|_| is_composite));
    global.report_approximate(&tree, request.level(&tree)?);
    let output = global.access().create(path)?;
    export_window(&tree, &request, output, format, &progress)
        .with_context(|| format!("{}: cannot write", path.display()))?;
    progress.finish();
    let detail =
        if args.size.is_some() { String::new() } else { format!(", level {level} of {}", tree.depth()) };
    global.report("pixels", format_args!("{} x {}{detail}", pixels.0, pixels.1));
    report_output(global, path, start);
    Ok(())
}

/// Writes several layers as bands of one image or array.
fn layers(args: &Args, trees: Vec<Dataset>, format: Format, global: &Global, start: Instant) -> Result<()> {
    let path = args.output.path();
    ensure!(
        args.style.is_none() && args.range.is_none() && !matches!(format, Format::Png | Format::Webp),
        "--style, --range, .png and .webp: work only with one layer (--layer NAME), or two to four as colours (--layer A,B,C); for all layers, use .tif, .npy or .raw"
    );
    ensure!(args.slice.is_none(), "--slice: works only with one layer; add --layer NAME");
    // All layers use the grid of the one with the smallest cells.
    let depth = trees.iter().map(Dataset::depth).max().unwrap_or(0);
    let finest = trees.iter().position(|tree| tree.depth() == depth).unwrap_or(0);
    let names: Vec<String> = trees.iter().map(|tree| tree.metadata().name.clone()).collect();
    ensure!(
        trees.iter().all(|tree| tree.depth() == depth) || !args.tree.is_viewed(),
        "--view: works only with one layer if their cells differ; add --layer NAME"
    );
    let trees = match trees.iter().all(|tree| tree.depth() == depth) {
        true => trees,
        false => {
            names.iter().map(|name| trees[finest].aligned_layer(name)).collect::<spinney::Result<_>>()?
        }
    };
    let tree = &trees[finest];
    ensure!(
        tree.header().form.axes() == 2,
        "{}: has layers that are octrees, expected one; add --layer NAME",
        args.tree.file.display()
    );
    let boxes = args.part.slice_boxes(tree, 2)?;
    let bounds = match boxes.as_deref() {
        None => default_region(tree, global)?,
        Some([one]) => *one,
        Some(_) => {
            bail!("--window: crosses the tree's east edge, which works only with one layer; add --layer NAME")
        }
    };
    let level = level_of(tree, args.level)?;
    let [columns, rows] = [0, 1].map(|axis| bounds.size()[axis]);
    let detail = match args.size.map(|size| size.of(columns, rows)) {
        Some((width, height)) if args.exact => Detail::Exact(width, height),
        Some((width, height)) => Detail::Size(width, height),
        None => Detail::Level(level),
    };
    let mut request = WindowRequest::new(bounds, detail);
    request.nodata = args.nodata;
    let progress = Work::start(global, "pixels")?;
    export_layers(&trees, &request, global.access().create(path)?, format, &progress)
        .with_context(|| format!("{}: cannot write", path.display()))?;
    progress.finish();
    global.report("layers", format_args!("{}", names.join(", ")));
    report_output(global, path, start);
    Ok(())
}

/// Returns the default region: the raster's extent, or, for the web map grid of the whole world,
/// the box of all data.
pub(crate) fn default_region(tree: &Dataset, global: &Global) -> Result<Bounds> {
    let header = tree.header();
    if web_mercator_depth(&tree.metadata().frame, header.extent).is_none() {
        return Ok(header.extent_bounds());
    }
    let bounds = tree.data_box()?.unwrap_or(header.extent_bounds());
    if bounds != header.extent_bounds() {
        let [column, row, _] = bounds.min;
        let [width, height, _] = bounds.size();
        global.report(
            "window",
            format_args!(
                "{column},{row},{width},{height}: the box of all data; the world has {} cells a side",
                header.extent[0]
            ),
        );
    }
    Ok(bounds)
}

/// Returns a view of the tree whose columns start at the western box, so that the boxes on both
/// sides of the tree's east edge are adjacent, and the box of both.
fn across_east_edge(tree: Dataset, west: &Bounds, east: &Bounds) -> Result<(Dataset, Bounds)> {
    let extent = [west.size()[0] + east.size()[0], west.size()[1], 1];
    let origin = west.min.map(|cell| cell as f64);
    let frame = tree.metadata().frame.shifted(origin);
    let tree = tree.warped(&WarpGrid { frame, extent })?;
    Ok((tree, Bounds::of_extent(extent)))
}

/// Writes a box of an octree, or all of it.
fn array(args: &Args, tree: &Dataset, format: Format, global: &Global, start: Instant) -> Result<()> {
    let path = args.output.path();
    let level = level_of(tree, args.level)?;
    let advice = "write each box on its own";
    let bounds = match args.part.bounds(tree, advice)? {
        None => tree.extent_at(level),
        Some(part) => {
            let shift = tree.depth() - level;
            let max = part.max.map(|cell| cell.div_ceil(1 << shift));
            Bounds { min: part.min.map(|cell| cell >> shift), max }
        }
    };
    let mut request = ArrayRequest::new(bounds, level);
    request.nodata = args.nodata;
    global.report_approximate(tree, level);
    let progress = Work::start(global, "cells")?;
    let output = global.access().create(path)?;
    export_array(tree, &request, output, format, &progress)
        .with_context(|| format!("{}: cannot write", path.display()))?;
    progress.finish();
    let [width, height, depth] = bounds.size();
    global.report("cells", format_args!("{width} x {height} x {depth}, level {level} of {}", tree.depth()));
    report_output(global, path, start);
    Ok(())
}
