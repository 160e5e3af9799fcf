//! A raster as a cloud-optimized GeoTIFF.

use std::time::Instant;

use anyhow::{Context as _, Result};
use clap::ValueEnum;
use spinney::Number;
use spinney::export::{CogCompression, CogRequest, export_cog};

use super::super::args::check_output;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;

/// Options of cloud-optimized GeoTIFF.
#[derive(clap::Args)]
pub(super) struct CogOptions {
    /// Compression of tiles, always lossless [default: deflate]
    #[arg(long, value_name = "METHOD")]
    compression: Option<Compression>,
    /// Nodata number for VOID; an error if it lies within the values [default: the layer's own if
    /// no value can be equal to it, else a free number, else a mask]
    #[arg(long, allow_hyphen_values = true)]
    nodata: Option<Number>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Compression {
    /// All TIFF readers support it
    Deflate,
    /// Smaller and faster, for newer readers
    Zstd,
    None,
}

impl CogOptions {
    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        let nodata = self.nodata.map(|_| "--nodata");
        self.compression.map(|_| "--compression").or(nodata)
    }
}

/// Writes the file.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file, global)?.is_some() {
        exact::refuse(&args.tree.file, &[(".tif", true)])?;
    }
    let tree = args.tree.open_drawn(global)?;
    global.report_overviews(&tree);
    check_output([args.tree.file.as_path()], args.output.path())?;
    let mut request = CogRequest::new();
    request.tile_size = args.tiles.tile_size.unwrap_or(request.tile_size);
    request.nodata = args.cog.nodata;
    request.compression = match args.cog.compression {
        None | Some(Compression::Deflate) => CogCompression::Deflate,
        Some(Compression::Zstd) => CogCompression::Zstd,
        Some(Compression::None) => CogCompression::None,
    };
    let work = Work::start(global, "cells")?;
    let output = global.access().create(args.output.path())?;
    let summary = export_cog(&tree, &request, output, &work)
        .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
    work.finish();
    let masks = if summary.has_masks { ", with masks" } else { "" };
    let sparse = summary.sparse_tiles;
    global.report(
        "tiles",
        format_args!("{} stored, {sparse} empty, {} overviews{masks}", summary.tiles, summary.overviews),
    );
    report_output(global, args.output.path(), start);
    Ok(())
}
