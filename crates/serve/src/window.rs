//! `/window/NAME`: a window at any level or size, as an image, an array or JSON.

use std::io::{self, Write};
use std::path::Path;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

use serde_json::json;
use spinney_base::io::Output;
use spinney_base::space::Bounds;
use spinney_base::value::{SampleType, Value, ValueType};
use spinney_base::{Error, Progress};
use spinney_crs::{CellLocator, Coordinates};
use spinney_engine::dataset::Dataset;
use spinney_raster::image::Format;
use spinney_raster::{Detail, WindowRequest, export_painted_window, export_window, window_rows};
use spinney_report::{printable_json, write_number};
use spinney_style::Style;

use crate::failure::Failure;
use crate::opened::OpenTree;
use crate::parameters::Parameters;
use crate::response::QueryResponse;

/// Parameters of the query.
pub(crate) const PARAMETERS: [&str; 10] =
    ["bounds", "crs", "cells", "level", "size", "z", "format", "style", "layer", "commit"];

/// File format of a window.
#[derive(Clone, Copy, PartialEq)]
enum WindowFormat {
    Raster(Format, &'static str),
    Json,
}

impl FromStr for WindowFormat {
    type Err = Error;

    fn from_str(name: &str) -> Result<WindowFormat, Error> {
        Ok(match name {
            "png" => WindowFormat::Raster(Format::Png, "image/png"),
            "webp" => WindowFormat::Raster(Format::Webp, "image/webp"),
            "npy" => WindowFormat::Raster(Format::Npy, "application/octet-stream"),
            "json" => WindowFormat::Json,
            _ => return Err(Error::invalid("window format", name, "png, webp, npy or json")),
        })
    }
}

/// Response with a window of at most `max_pixels` pixels.
pub(crate) fn respond(
    tree: &OpenTree,
    parameters: &Parameters,
    max_pixels: u64,
    tag: String,
    progress: &dyn Progress,
) -> Result<QueryResponse, Failure> {
    let format = parameters.value("format")?.unwrap_or(WindowFormat::Raster(Format::Png, "image/png"));
    let style = parameters.text("style").map(Style::parse).transpose()?;
    let is_array = matches!(format, WindowFormat::Json | WindowFormat::Raster(Format::Npy, _));
    if style.is_some() && is_array {
        return Err(Failure::bad("style: applies to images (png, webp), not to arrays and JSON"));
    }
    let drawn = tree.drawn(parameters.text("layer"))?;
    if drawn.is_composite && is_array {
        return Err(Failure::bad(
            "layer: got several, expected one; only images (png, webp) show several, as colours",
        ));
    }
    let tree = &*drawn.tree;
    let bounds = bounds(tree, parameters)?;
    let (detail, [columns, rows]) = detail(tree, parameters, &bounds)?;
    if columns.checked_mul(rows).is_none_or(|pixels| pixels > max_pixels) {
        return Err(Failure::too_large(format!(
            "window: got {columns} x {rows} pixels, expected at most {max_pixels}; request a smaller window, a coarser level or a size"
        )));
    }
    let mut request = WindowRequest::new(bounds, detail);
    request.style = style.or_else(|| drawn.is_composite.then(|| Style::default_for(tree)));
    let (format, content_type) = match format {
        WindowFormat::Json => {
            let text = values(tree, &request, [columns, rows], progress)?;
            return Ok(QueryResponse::new("application/json", tag, text));
        }
        WindowFormat::Raster(format, content_type) => (format, content_type),
    };
    let bytes = Memory::default();
    let output = Output::to_writer(Path::new("window"), Box::new(bytes.clone()));
    match request.painted_style(tree, format) {
        Some(style) => {
            let painter = drawn.painter(Some(&style), progress)?;
            export_painted_window(tree, &request, painter.painter(), output, format, progress)?;
        }
        None => export_window(tree, &request, output, format, progress)?,
    }
    Ok(QueryResponse::new(content_type, tag, bytes.take()))
}

/// Requested cells of the deepest level: the entire raster by default; in octrees, one layer of
/// cells.
fn bounds(tree: &Dataset, parameters: &Parameters) -> Result<Bounds, Failure> {
    let raster = tree.header().extent_bounds();
    let mut bounds = match (parameters.numbers::<4>("bounds")?, parameters.list::<u64>("cells")?) {
        (Some(_), Some(_)) => {
            return Err(Failure::bad("bounds, cells: got both, expected one of them"));
        }
        (None, None) => raster,
        (None, Some(cells)) => {
            let [column, row, width, height] = <[u64; 4]>::try_from(cells)
                .map_err(|_| Failure::bad("cells: expected 4 integers: column, row, width, height"))?;
            let min = [column, row, raster.min[2]];
            let max = [column.saturating_add(width), row.saturating_add(height), raster.max[2]];
            let extent = tree.header().extent;
            if width == 0 || height == 0 || column >= extent[0] || row >= extent[1] {
                let [columns, rows, _] = extent;
                return Err(Failure::bad(format!(
                    "cells: the window is empty, or outside of the tree of {columns} x {rows} cells"
                )));
            }
            Bounds { min, max }
        }
        (Some([west, south, east, north]), None) => {
            let coordinates = parameters.value("crs")?.unwrap_or(Coordinates::World);
            let locator = CellLocator::new(&coordinates, &tree.metadata().frame, tree.header().extent)?;
            let low = [west, south, f64::NEG_INFINITY];
            let boxes = locator.boxes(low, [east, north, f64::INFINITY])?;
            match boxes[..] {
                [one] => one,
                [] => {
                    return Err(Failure::bad(format!(
                        "bounds: outside of the tree, which is {}",
                        locator.bounds_text()
                    )));
                }
                _ => {
                    return Err(Failure::bad(
                        "bounds: cross the tree's seam; request the boxes on its two sides separately",
                    ));
                }
            }
        }
    };
    if tree.header().form.axes() == 3 {
        let z: u64 = parameters.value("z")?.unwrap_or(0);
        if z >= raster.max[2] {
            return Err(Failure::bad(format!(
                "z: got {z}, expected a layer of cells, 0 to {}",
                raster.max[2] - 1
            )));
        }
        (bounds.min[2], bounds.max[2]) = (z, z + 1);
    } else if parameters.text("z").is_some() {
        return Err(Failure::bad("z: applies to octrees; this is a quadtree"));
    }
    Ok(bounds)
}

/// Requested detail, and the resulting columns and rows.
fn detail(tree: &Dataset, parameters: &Parameters, bounds: &Bounds) -> Result<(Detail, [u64; 2]), Failure> {
    let depth = tree.depth();
    let size = |text: &str| {
        let number = |text: &str| text.trim().parse().ok().filter(|number: &u64| *number > 0);
        match text.split_once(['x', ',']) {
            Some((width, height)) => number(width).zip(number(height)),
            None => number(text).map(|longer| longer_side(longer, bounds)),
        }
    };
    match (parameters.value::<u8>("level")?, parameters.text("size")) {
        (Some(_), Some(_)) => Err(Failure::bad("level, size: got both, expected one of them")),
        (_, Some(text)) => {
            let expected = || Failure::bad("size: expected WxH, as in 1024x512, or the longer side");
            let (width, height) = size(text).ok_or_else(expected)?;
            Ok((Detail::Size(width, height), [width, height]))
        }
        (level, None) => {
            let level = level.unwrap_or(depth);
            if level > depth {
                return Err(Failure::bad(format!("level: got {level}, expected 0 to {depth}")));
            }
            let shift = depth - level;
            // Blocks that are partly within the window count.
            let blocks = |axis: usize| bounds.max[axis].div_ceil(1 << shift) - (bounds.min[axis] >> shift);
            Ok((Detail::Level(level), [blocks(0), blocks(1)]))
        }
    }
}

/// Columns and rows of an image with the window's aspect ratio, from its longer side.
fn longer_side(longer: u64, bounds: &Bounds) -> (u64, u64) {
    let [width, height, _] = bounds.size();
    let share = width.min(height) as f64 / width.max(height).max(1) as f64;
    let shorter = ((longer as f64 * share).round() as u64).max(1);
    if width >= height { (longer, shorter) } else { (shorter, longer) }
}

/// Values of a window as JSON, by rows; `null` is VOID.
fn values(
    tree: &Dataset,
    request: &WindowRequest,
    [columns, rows]: [u64; 2],
    progress: &dyn Progress,
) -> Result<Vec<u8>, Failure> {
    let value = tree.header().form.value;
    let Bounds { min, .. } = request.bounds;
    let [width, height, _] = request.bounds.size();
    let heading = json!({
        "layer": tree.metadata().name,
        "cells": [min[0], min[1], width, height],
        "level": request.level(tree)?,
        "columns": columns,
        "rows": rows,
        "channels": value.channels,
    });
    let heading = heading.to_string();
    let heading = printable_json(heading.strip_suffix('}').unwrap_or(&heading));
    let mut text = format!("{heading},\"values\":[").into_bytes();
    let mut is_first = true;
    window_rows(tree, request, progress, &mut |bytes, valid| {
        progress.check()?;
        let columns = columns as usize;
        for (bytes, valid) in bytes.chunks_exact(columns * value.size()).zip(valid.chunks_exact(columns)) {
            text.extend(if std::mem::take(&mut is_first) { &b"\n["[..] } else { b",\n[" });
            for (column, (bytes, is_valid)) in bytes.chunks_exact(value.size()).zip(valid).enumerate() {
                if column > 0 {
                    text.push(b',');
                }
                if *is_valid { write_pixel(value, bytes, &mut text) } else { text.extend(b"null") }
            }
            text.push(b']');
        }
        Ok(())
    })?;
    text.extend(b"\n]}\n");
    Ok(text)
}

/// Writes a pixel's sample, or the list of its samples.
fn write_pixel(value: ValueType, bytes: &[u8], text: &mut Vec<u8>) {
    let is_list = value.channels > 1;
    if is_list {
        text.push(b'[');
    }
    for (channel, number) in value.numbers(Value::from_bytes(bytes)).iter().enumerate() {
        if channel > 0 {
            text.push(b',');
        }
        // JSON has no numbers that are not finite.
        if number.is_finite() {
            write_number(*number, value.sample == SampleType::F64, text);
        } else {
            text.extend(b"null");
        }
    }
    if is_list {
        text.push(b']');
    }
}

/// In-memory output.
#[derive(Clone, Default)]
struct Memory(Arc<Mutex<Vec<u8>>>);

impl Memory {
    fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
