//! `spinney legend`: the legend of a style.

use anyhow::{Context as _, Result, bail};
use spinney::raw::export::{LegendFormat, export_legend};
use spinney::raw::style::StylePainter;
use spinney::style::Style;

use super::Global;
use super::args::{OutputFile, ViewedTree, check_output, parse_style};
use super::report::Work;

const EXAMPLES: &str = "Examples:
  spinney legend relief.goblin legend.png --style terrain
  spinney legend landcover.goblin legend.svg
  spinney legend relief.goblin - --format json --style style.json";

/// Write the legend of a style: what its colours mean
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    tree: ViewedTree,
    #[command(flatten)]
    output: OutputFile,
    /// Colours: a style's name, its JSON or a file with it: see `spinney get --style` [default: the
    /// tree's own]
    #[arg(long, value_name = "STYLE", value_parser = parse_style)]
    style: Option<Style>,
    /// Format [default: by the output's extension]
    #[arg(long, value_parser = ["png", "svg", "json"])]
    format: Option<String>,
    /// Scale factor of a .png [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=8))]
    scale: Option<u8>,
}

pub(crate) fn run(args: &Args, global: &Global) -> Result<()> {
    let tree = args.tree.open_drawn(global)?;
    let path = args.output.path();
    check_output([args.tree.file.as_path()], path)?;
    let extension = path.extension().and_then(|extension| extension.to_str());
    let ending = args.format.as_deref().or(extension).unwrap_or_default();
    let Some(format) = LegendFormat::named(ending, args.scale.unwrap_or(2)) else {
        bail!("{}: unknown format; use .png, .svg or .json, or --format", path.display());
    };
    if args.scale.is_some() && !matches!(format, LegendFormat::Png(_)) {
        bail!("--scale: works only with .png, not with {}", path.display());
    }
    let style = args.style.clone().unwrap_or_else(|| Style::default_for(&tree));
    let progress = Work::start(global, "cells")?;
    let legend = StylePainter::new(&style, &tree, &progress)?.legend(&tree)?;
    tree.check_unchanged()?;
    export_legend(&legend, global.access().create(path)?, format)
        .with_context(|| format!("{}: cannot write", path.display()))
}
