//! `spinney render`: a shaded image of a solid, or a line drawing.

use std::path::Path;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::Dataset;
use spinney::brep::Faces as _;
use spinney::export::{RenderRequest, render, render_exact};
use spinney::import::feature::FeatureFilter;
use spinney::raw::brep::ModelView;
use spinney::raw::export::{CameraProjection, DrawingFormat, DrawingStyle, draw_cells, draw_exact};
use spinney::raw::space::Up;

use super::args::{OutputFile, Size, ViewedTree, check_output, numbers, parse_size, raster_format};
use super::report::{Work, report_output};
use super::{Global, exact};

const EXAMPLES: &str = "Examples:
  spinney render house.goblin house.png
  spinney render house.goblin front.png --from 180,0 --orthographic --size 1600x1200
  spinney render bunny.goblin bunny.png --up y --from 200,15 --background transparent
  spinney render bunny.goblin half.png --view window=0,0,0,256,512,512
  spinney render city.goblin halls.png --size 200x150 --where 'height>=20'
  spinney render part.goblin part.svg --drawing hidden-lines
  spinney render bunny.goblin blocks.svg --drawing octants --level 5

--from AZIMUTH,ELEVATION: the viewer is in the north (along y) at azimuth 0, in the east (along x)
at 90; the view is horizontal at elevation 0, straight down at 90. Without --level, the coarsest
level is read whose cells are no larger than a pixel. Of an exact model with levels of detail, the
surface is drawn that is at most a pixel off, with smooth shading; of one without, its faces.
The output is .png, .tif, .npy or .raw, and for line drawings also .svg.

--drawing: wireframe draws all edges of an exact model, hidden-lines those that no face hides,
octants the blocks of the octree, of an exact model or of cells, to --level [default: the coarsest
with 32 blocks along the longest side]. Edges between coplanar faces are left out. All edges are
held in memory: at most 131072 triangles, or 262144 blocks.";

/// Draw an image of a solid: shaded, or as a line drawing
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    output: OutputFile,
    /// Columns and rows, or the longer side (aspect ratio 4:3)
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1024x768")]
    size: Size,
    /// Direction of the viewer, in degrees: azimuth on the compass, and elevation above the horizon
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = parse_direction, default_value = "215,30")]
    from: [f64; 2],
    /// Level of detail [default: the coarsest that is fine enough]
    #[arg(long)]
    level: Option<u8>,
    /// Line drawing instead of a shaded image: all edges, visible edges, or the blocks of the
    /// octree
    #[arg(long, value_name = "STYLE", value_parser = parse_drawing)]
    drawing: Option<DrawingStyle>,
    /// Only features for which all conditions hold, as in 'type=Building,height>=10': objects of an
    /// exact model, where id and type count as attributes
    #[arg(long = "where", value_name = "CONDITION,...")]
    filter: Option<FeatureFilter>,
    /// Scale factor: 1 shows all of the solid
    #[arg(long, value_name = "F", default_value_t = 1.0)]
    scale: f64,
    /// Orthographic projection, in which parallel lines remain parallel [default: perspective]
    #[arg(long)]
    orthographic: bool,
    /// Axis that points up in the world, y or z
    #[arg(long, value_name = "AXIS", default_value_t = Up::Z)]
    up: Up,
    /// Background colour: #rrggbb, white, grey, black, or transparent
    #[arg(long, value_name = "COLOUR", value_parser = parse_colour, default_value = "white")]
    background: Background,
    /// Samples per pixel along each axis [default: 2; for line drawings 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=8))]
    samples: Option<u32>,
    /// Format [default: by the output's extension]
    #[arg(long, value_parser = ["png", "tif", "npy", "raw", "svg"])]
    format: Option<String>,
}

/// Default samples per pixel along each axis, for shaded images and for line drawings.
const SAMPLES: [u32; 2] = [2, 4];

/// Parses the style of a line drawing.
fn parse_drawing(text: &str) -> Result<DrawingStyle, String> {
    match text {
        "wireframe" => Ok(DrawingStyle::Wireframe),
        "hidden-lines" => Ok(DrawingStyle::HiddenLines),
        "octants" => Ok(DrawingStyle::Octants),
        _ => Err("expected wireframe, hidden-lines or octants".into()),
    }
}

/// The background colour; `None` is transparent.
#[derive(Clone, Copy, Debug)]
struct Background(Option<[u8; 3]>);

/// Parses the direction of the viewer.
fn parse_direction(text: &str) -> Result<[f64; 2], String> {
    numbers(text)
        .filter(|[azimuth, elevation]: &[f64; 2]| azimuth.is_finite() && (-90.0..=90.0).contains(elevation))
        .ok_or_else(|| "expected azimuth and elevation in degrees, as in 215,30; elevation -90 to 90".into())
}

/// Parses a colour, by name or by its digits.
fn parse_colour(text: &str) -> Result<Background, String> {
    let name = text.to_lowercase();
    let colour = match name.as_str() {
        "transparent" | "none" => return Ok(Background(None)),
        "white" => Some([255; 3]),
        "grey" | "gray" => Some([128; 3]),
        "black" => Some([0; 3]),
        _ => name
            .strip_prefix('#')
            .filter(|digits| digits.len() == 6)
            .and_then(|digits| u32::from_str_radix(digits, 16).ok())
            .map(|number| [(number >> 16) as u8, (number >> 8) as u8, number as u8]),
    };
    colour
        .map(|colour| Background(Some(colour)))
        .ok_or_else(|| "expected #rrggbb, white, grey, black or transparent".into())
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    let file = args.tree.file.as_path();
    let scene = match args.tree.open_model(global)? {
        Some(view) => {
            let has_level = matches!(args.drawing, None | Some(DrawingStyle::Octants));
            let level = if has_level { "--level" } else { "--drawing" };
            let fitting = [
                "--output",
                "--background",
                "--drawing",
                "--format",
                "--from",
                "--orthographic",
                "--samples",
                "--scale",
                "--size",
                "--up",
                "--view",
                "--where",
                level,
            ];
            global.check_options(file, exact::KIND, &fitting)?;
            view.as_model("images")?;
            Scene::Model(Box::new(view))
        }
        None => Scene::Cells(args.tree.open_drawn(global)?),
    };
    if let Scene::Cells(tree) = &scene {
        ensure!(args.filter.is_none(), "--where: works only with exact models, which have objects");
        ensure!(tree.header().form.axes() == 3, "{}: is a quadtree; use `spinney get`", file.display());
        ensure!(
            matches!(args.drawing, None | Some(DrawingStyle::Octants)),
            "{}: is an octree of cells, which have no edges; use --drawing octants",
            file.display()
        );
    }
    let path = args.output.path();
    let format = args.format(path)?;
    check_output([file], path)?;
    let mut request = args.request();
    if let (Scene::Model(view), Some(filter)) = (&scene, &args.filter) {
        request.parts = Some(exact::chosen(view.as_model("images")?, filter)?);
    }
    let work = Work::start(global, if args.drawing.is_some() { "parts" } else { "pixels" })?;
    match &scene {
        Scene::Model(view) => args.tree.warn_of_no_faces(view.as_model("images")?, &work),
        Scene::Cells(tree) => args.tree.warn_of_no_cells(tree, &work)?,
    }
    let output = global.access().create(path)?;
    let drawn = match (&scene, args.drawing, format) {
        (Scene::Model(view), None, DrawingFormat::Image(format)) => view
            .as_model("images")
            .and_then(|model| render_exact(model, &request, output, format, &work))
            .map(|error| Drawn { level: None, error }),
        (Scene::Cells(tree), None, DrawingFormat::Image(format)) => {
            render(tree, &request, output, format, &work).map(|level| Drawn::cells(level, tree))
        }
        (Scene::Model(view), style, format) => view.as_model("images").and_then(|model| {
            let style = style.unwrap_or(DrawingStyle::HiddenLines);
            let level = draw_exact(model, style, &request, output, format, &work)?;
            Ok(Drawn { level: level.map(|level| (level, model.grid().depth())), error: 0.0 })
        }),
        (Scene::Cells(tree), _, format) => {
            draw_cells(tree, &request, output, format, &work).map(|level| Drawn::cells(level, tree))
        }
    };
    let Drawn { level, error } = drawn.with_context(|| format!("{}: cannot write", path.display()))?;
    work.finish();
    if let Some((level, depth)) = level {
        global.report("level", format_args!("{level} of {depth}"));
    }
    if error > 0.0 {
        global.report("detail", format_args!("at most {error:.3e} off the exact surface"));
    }
    report_output(global, path, start);
    Ok(())
}

/// The level of an octree that was drawn, with its depth, and the distance from an exact surface.
struct Drawn {
    level: Option<(u8, u8)>,
    error: f64,
}

impl Drawn {
    fn cells(level: u8, tree: &Dataset) -> Drawn {
        Drawn { level: Some((level, tree.depth())), error: 0.0 }
    }
}

/// The scene to draw.
enum Scene {
    Cells(Dataset),
    Model(Box<ModelView>),
}

impl Args {
    /// Returns the output's format.
    fn format(&self, path: &Path) -> Result<DrawingFormat> {
        let is_svg = match &self.format {
            Some(format) => format == "svg",
            None => path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")),
        };
        if !is_svg {
            let known = if self.drawing.is_some() {
                ".svg, .png, .tif, .npy or .raw"
            } else {
                ".png, .tif, .npy or .raw"
            };
            return raster_format(path, self.format.as_deref(), known).map(DrawingFormat::Image);
        }
        ensure!(
            self.drawing.is_some(),
            "{}: SVG needs a line drawing; add --drawing, or write .png",
            path.display()
        );
        Ok(DrawingFormat::Svg)
    }

    fn request(&self) -> RenderRequest {
        let (columns, rows) = self.size.of(4, 3);
        let mut request = RenderRequest::new(columns, rows);
        [request.azimuth, request.elevation] = self.from;
        request.scale = self.scale;
        if self.orthographic {
            request.projection = CameraProjection::Orthographic;
        }
        request.up = self.up;
        request.level = self.level;
        request.background = self.background.0;
        let [shaded, drawn] = SAMPLES;
        request.samples = self.samples.unwrap_or(if self.drawing.is_some() { drawn } else { shaded });
        request
    }
}
