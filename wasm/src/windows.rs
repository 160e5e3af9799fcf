//! Windows: the samples of a region at a level.

use serde::Deserialize;
use serde_json::json;
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;

use crate::failure::too_large;
use crate::region::Region;
use crate::result::Found;

/// Maximum bytes of a window.
const MAX_BYTES: u64 = 1 << 30;

/// Selection of a window's samples.
#[derive(Deserialize)]
pub(crate) struct Window {
    /// Selected channels, from 0, in this order; by default all.
    channels: Option<Vec<u8>>,
    /// The number for VOID cells.
    fill: Option<Number>,
}

/// A level, or the minimum size of a result.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct Detail {
    pub(crate) level: Option<u8>,
    /// Minimum number of cells along the longer axis: the coarsest level that has as many.
    pub(crate) size: Option<f64>,
}

impl Detail {
    /// Returns the selected level, for a box of the deepest cells.
    pub(crate) fn level(&self, tree: &Dataset, bounds: &Bounds) -> Result<u8> {
        let depth = tree.depth();
        match (self.level, self.size) {
            (Some(_), Some(_)) => Err(Error::invalid("detail", "both a level and a size", "one of the two")),
            (Some(level), None) if level > depth => {
                Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")))
            }
            (Some(level), None) => Ok(level),
            (None, None) => Ok(depth),
            (None, Some(size)) if size >= 1.0 => {
                let cells = bounds.size().into_iter().max().unwrap_or(1);
                let is_enough = |shift: &u8| (cells >> shift) as f64 >= size;
                Ok(depth - (0..=depth).rev().find(is_enough).unwrap_or(0))
            }
            (None, Some(size)) => Err(Error::invalid("size", size.to_string(), "1 or more")),
        }
    }
}

/// Returns the cells of a level that a box of the deepest ones intersects.
pub(crate) fn at_level(bounds: &Bounds, shift: u8) -> Bounds {
    Bounds {
        min: bounds.min.map(|cell| cell >> shift),
        max: bounds.max.map(|cell| cell.div_ceil(1 << shift)),
    }
}

/// Returns the samples of a window.
pub(crate) fn window(tree: &Dataset, (region, detail): (&Region, &Detail), window: &Window) -> Result<Found> {
    let bounds = region.one_box(tree)?;
    let level = detail.level(tree, &bounds)?;
    samples(tree, &bounds, level, window.channels.as_deref(), window.fill)
}

/// Returns the samples of a box of the deepest cells at a level.
pub(crate) fn samples(
    tree: &Dataset,
    bounds: &Bounds,
    level: u8,
    channels: Option<&[u8]>,
    fill: Option<Number>,
) -> Result<Found> {
    let (header, metadata) = (tree.header(), tree.metadata());
    let (value, axes, shift) = (header.form.value, header.form.axes(), tree.depth() - level);
    let cells = at_level(bounds, shift);
    let none = if value.sample.is_float() { Number::NAN } else { Number::default() };
    let (bytes, valid) = read(tree, level, &cells, fill.or(metadata.nodata).unwrap_or(none))?;
    let width = header.form.width();
    let size = value.sample.size();
    let count = usize::from(value.channels);
    let (bytes, channels) = match channels {
        None if width == size * count => (bytes, count),
        None => (chosen(&bytes, width, size, &(0..value.channels).collect::<Vec<_>>()), count),
        Some(wanted) => {
            if let Some(wrong) = wanted.iter().find(|channel| **channel >= value.channels) {
                return Err(Error::invalid("channel", wrong.to_string(), format!("less than {count}")));
            }
            (chosen(&bytes, width, size, wanted), wanted.len())
        }
    };
    let has_void = valid.iter().any(|is_valid| !is_valid);
    let mask = if has_void { valid.into_iter().map(u8::from).collect() } else { Vec::new() };
    let covered =
        Bounds { min: cells.min.map(|cell| cell << shift), max: cells.max.map(|cell| cell << shift) };
    let covered = if axes == 3 {
        covered
    } else {
        Bounds { min: [covered.min[0], covered.min[1], 0], max: [covered.max[0], covered.max[1], 1] }
    };
    let [low, high] = metadata.frame.world_box(&covered);
    let ends = |low: &[f64], high: &[f64]| -> Vec<f64> { low.iter().chain(high).copied().collect() };
    let [columns, rows, layers] = cells.size();
    let json = json!({
        "width": columns,
        "height": rows,
        "layers": layers,
        "channels": channels,
        "sampleType": value.sample.name(),
        "level": level,
        "cells": covered.min[..axes].iter().chain(&covered.max[..axes]).collect::<Vec<_>>(),
        "bounds": ends(&low[..axes], &high[..axes]),
        "hasMask": has_void,
    });
    Ok(Found { json, buffers: vec![bytes, mask] })
}

/// Returns the values of a box of a level's cells, and whether each has one.
///
/// # Errors
/// If there are too many, or the file is corrupt.
pub(crate) fn read(tree: &Dataset, level: u8, cells: &Bounds, fill: Number) -> Result<(Vec<u8>, Vec<bool>)> {
    let width = tree.header().form.width();
    let needed = cells.volume().saturating_mul(width as u64 + 1);
    if needed > MAX_BYTES {
        return Err(too_large(tree.name(), "the window", needed, MAX_BYTES));
    }
    let mut bytes = vec![0; cells.volume() as usize * width];
    let mut valid = vec![false; cells.volume() as usize];
    tree.window(level, cells, fill, &mut bytes, Some(&mut valid))?;
    Ok((bytes, valid))
}

/// Selects channels of values of `width` bytes, with samples of `size` bytes.
fn chosen(bytes: &[u8], width: usize, size: usize, channels: &[u8]) -> Vec<u8> {
    let mut found = Vec::with_capacity(bytes.len() / width.max(1) * size * channels.len());
    for value in bytes.chunks_exact(width) {
        for channel in channels {
            found.extend_from_slice(&value[usize::from(*channel) * size..][..size]);
        }
    }
    found
}
