//! `spinney get`: any part at any level as a picture or array.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use spinney::export::image::{Format, format_of};
use spinney::export::{Detail, WindowRequest, export_window};
use spinney::space::Bounds;
use spinney::store::Output;

use super::place::Part;
use super::progress::Work;
use super::viewed::Viewed;
use super::{Global, check_output};

const EXAMPLES: &str = "Examples:
  spinney get world.goblin overview.png --size 1024x512
  spinney get world.goblin alps.tif --bbox 5,44,17,48
  spinney get world.goblin part.npy --window 20000,5000,4096,4096 --level 12
  spinney get world.goblin - --format png --size 256x256 > tile.png";

/// Write any part at any level of detail as a picture or array
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: Viewed,
    /// Output: .png, .tif, .exr, .npy or .raw; `-` is standard output
    output: PathBuf,
    #[command(flatten)]
    part: Part,
    /// Level of detail: 0 is one cell for everything, the file's depth (the default) is the cells as they were
    #[arg(long, conflicts_with = "size")]
    level: Option<u8>,
    /// Columns and rows of the output, from the coarsest level that is fine enough
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<(u64, u64)>,
    /// Slice of an octree: z of the deepest level
    #[arg(long, value_name = "Z", default_value_t = 0)]
    slice: u64,
    /// Format where the output's name does not tell
    #[arg(long, value_parser = ["png", "tif", "exr", "npy", "raw"])]
    format: Option<String>,
    /// Number for VOID cells
    #[arg(long, allow_hyphen_values = true)]
    nodata: Option<f64>,
}

fn size(text: &str) -> Result<(u64, u64), String> {
    let parts = text.split_once(['x', 'X', ',']);
    let parts = parts.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    parts
        .filter(|(width, height)| *width > 0 && *height > 0)
        .ok_or_else(|| "expected WxH, as in 1024x512".into())
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let tree = args.tree.open()?;
    let name = args.format.as_ref().map(|format| Path::new("x").with_extension(format));
    let format: Option<Format> = format_of(name.as_deref().unwrap_or(&args.output));
    let Some(format) = format else {
        bail!("{}: unknown format; use .png, .tif, .exr, .npy or .raw, or --format", args.output.display());
    };
    check_output([args.tree.file.as_path()], &args.output)?;
    let picture = Bounds { min: [0; 3], max: tree.header().extent };
    let mut bounds = args.part.bounds(&*tree)?.unwrap_or(picture);
    if args.slice >= picture.max[2] {
        bail!("--slice: {} is outside the tree, which has slices 0 to {}", args.slice, picture.max[2] - 1);
    }
    (bounds.min[2], bounds.max[2]) = (args.slice, args.slice + 1);
    let detail = match args.size {
        Some((width, height)) => Detail::Size(width, height),
        None => Detail::Level(args.level.unwrap_or(tree.depth())),
    };
    let request = WindowRequest { bounds, detail, nodata: args.nodata, memory: 64 << 20 };
    let output = Output::create(&args.output)?;
    let progress = Work::start(global, "pixels")?;
    export_window(&*tree, &request, output, format, &progress)
        .with_context(|| format!("cannot write {}", args.output.display()))
}
