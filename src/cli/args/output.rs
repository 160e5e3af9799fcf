//! Outputs: checks against the inputs, formats, and size limits.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use spinney::Output;
use spinney::export::VectorFormat;
use spinney::raw::export::image::{Format, format_of};
use spinney::raw::ops::overwritten_input;
use spinney::raw::store::create_tree_file;

use super::Global;
use super::memory::parse_bytes;

/// The output file: the argument of `-o`, or the last argument.
#[derive(clap::Args, Clone, Debug)]
#[group(required = true, multiple = false)]
pub(crate) struct OutputFile {
    /// File to write; its name determines the format, - is standard output
    #[arg(short = 'o', long = "output", value_name = "FILE")]
    named: Option<PathBuf>,
    /// File to write, as the last argument
    #[arg(value_name = "OUT")]
    last: Option<PathBuf>,
}

impl OutputFile {
    /// Returns the output's path.
    pub(crate) fn path(&self) -> &Path {
        self.named.as_deref().or(self.last.as_deref()).unwrap_or(Path::new("-"))
    }
}

/// Maximum size of an output.
#[derive(clap::Args, Clone, Copy, Debug)]
pub(crate) struct OutputLimit {
    /// Fail, and leave no file, if the output exceeds this size, such as 500M or 20G [default: free
    /// space of the file system]
    #[arg(long, value_name = "BYTES", value_parser = parse_bytes)]
    max_bytes: Option<u64>,
}

impl OutputLimit {
    /// Whether a limit was given.
    pub(crate) fn is_given(&self) -> bool {
        self.max_bytes.is_some()
    }

    /// Returns the limit.
    pub(crate) fn bytes(&self) -> Option<u64> {
        self.max_bytes
    }

    /// Creates a file with this limit.
    pub(crate) fn create(&self, path: &Path, global: &Global) -> spinney::Result<Output> {
        global.access().create(path).map(|output| output.with_limit(self.max_bytes))
    }

    /// Creates a tree file with this limit.
    pub(crate) fn create_tree(&self, path: &Path, global: &Global) -> spinney::Result<Output> {
        create_tree_file(path, global.access()).map(|output| output.with_limit(self.max_bytes))
    }
}

/// Formats of lines and polygons.
pub(crate) const VECTOR_FORMATS: [&str; 8] = ["geojson", "csv", "svg", "gpkg", "fgb", "shp", "obj", "ply"];

/// Their file name extensions, for messages.
pub(crate) const VECTOR_ENDINGS: &str = ".geojson, .csv, .svg, .gpkg, .fgb, .shp, .obj or .ply";

/// Returns the format of lines and polygons by the argument of `--format`, or else by the output's
/// name.
pub(crate) fn vector_format(named: Option<&str>, output: &Path) -> Result<VectorFormat> {
    match named.map(str::parse).transpose()?.or_else(|| VectorFormat::of(output)) {
        Some(format) => Ok(format),
        None => bail!("{}: unknown format; use {VECTOR_ENDINGS}, or --format", output.display()),
    }
}

/// Returns the format of lines and polygons by the output's name, for commands without `--format`.
pub(crate) fn vector_format_of(output: &Path) -> Result<VectorFormat> {
    VectorFormat::of(output)
        .with_context(|| format!("{}: unknown format; use {VECTOR_ENDINGS}", output.display()))
}

/// Fails if the output is one of the inputs, or has cells of one.
pub(crate) fn check_output<'a>(inputs: impl IntoIterator<Item = &'a Path>, output: &Path) -> Result<()> {
    let inputs: Vec<&Path> = inputs.into_iter().collect();
    overwritten_input(&inputs, output).map_or(Ok(()), |message| bail!("{message}"))
}

/// Whether two paths name the same file.
pub(crate) fn same_file(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Returns the format of an image or array by `format_option`, or else by the output's name.
/// `known` lists formats for the error message.
pub(crate) fn raster_format(output: &Path, format_option: Option<&str>, known: &str) -> Result<Format> {
    let name = format_option.map(|format| Path::new("x").with_extension(format));
    let format = format_of(name.as_deref().unwrap_or(output));
    format.with_context(|| format!("{}: unknown format; use {known}, or --format", output.display()))
}
