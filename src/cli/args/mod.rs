//! Options that several subcommands share, and the parsers of arguments.

mod class;
mod commit;
mod coordinates;
mod crs;
mod given;
mod global;
mod layer;
mod list;
mod memory;
mod operation;
mod output;
mod packing;
mod part;
mod positions;
mod reconcile;
mod seconds;
mod size;
mod slice;
mod style;
mod viewed;
mod words;

use std::fmt::Display;
use std::str::FromStr;

use anyhow::{Result, ensure};
use spinney::Dataset;

pub(crate) use class::class_value;
pub(crate) use commit::{CommitOptions, EditOptions};
pub(crate) use coordinates::CoordinatesOption;
pub(crate) use crs::parse_crs;
pub(crate) use given::GivenOptions;
pub(crate) use global::Global;
pub(crate) use layer::LayerOption;
pub(crate) use list::expand_lists;
pub(crate) use memory::{DEFAULT_MEMORY, Memory, parse_bytes};
pub(crate) use operation::{OperationName, parse_operation};
pub(crate) use output::{
    OutputFile, OutputLimit, VECTOR_ENDINGS, VECTOR_FORMATS, check_output, raster_format, same_file,
    vector_format, vector_format_of,
};
pub(crate) use packing::{Packing, packing};
pub(crate) use part::PartOptions;
pub(crate) use positions::positions;
pub(crate) use reconcile::{MeaningArgs, ReconcileArgs};
pub(crate) use seconds::parse_seconds;
pub(crate) use size::{Size, parse_size};
pub(crate) use slice::{Slice, parse_slice};
pub(crate) use style::parse_style;
pub(crate) use viewed::{ViewedTree, parse_step};
pub(crate) use words::words;

/// Parses a number, with or without blanks around it.
pub(crate) fn number<T: FromStr<Err: Display>>(text: &str) -> Result<T, String> {
    text.trim().parse().map_err(|error: T::Err| error.to_string())
}

/// Parses exactly `N` comma-separated numbers.
pub(crate) fn numbers<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// Returns the level of `--level`, or the deepest if it was not given.
pub(crate) fn level_of(tree: &Dataset, level_option: Option<u8>) -> Result<u8> {
    let depth = tree.depth();
    let level = level_option.unwrap_or(depth);
    ensure!(level <= depth, "--level: got {level}, expected 0 to {depth}, the tree's levels");
    Ok(level)
}

/// Units of length that models may have.
pub(crate) const UNITS: [&str; 6] = ["mm", "cm", "m", "km", "in", "ft"];
