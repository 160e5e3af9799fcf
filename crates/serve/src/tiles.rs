//! `/tiles/NAME.json`, and tiles of web maps and of a tree's own grid.

use std::str::FromStr as _;

use percent_encoding::utf8_percent_encode;
use serde_json::json;
use spinney_base::Progress;
use spinney_raster::tile_archives::{TileEncoding, TileFormat, encode_tile};
use spinney_raster::void_number;
use spinney_style::Style;
use spinney_tiles::TileId;

use crate::drawn::SIDE;
use crate::failure::Failure;
use crate::opened::OpenTree;
use crate::page::ESCAPED;
use crate::parameters::Parameters;
use crate::response::QueryResponse;

/// Parameters of a tile.
pub(crate) const PARAMETERS: [&str; 4] = ["grid", "style", "layer", "commit"];

/// Parameters of `/tiles/NAME.json`.
pub(crate) const JSON_PARAMETERS: [&str; 5] = ["grid", "style", "layer", "commit", "format"];

/// Tile in an address.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TileAddress {
    tile: TileId,
    format: TileFormat,
}

impl TileAddress {
    /// Parses zoom, column, and row with the extension of a format.
    pub(crate) fn parse(zoom: &str, column: &str, row: &str) -> Result<TileAddress, Failure> {
        let number = |text: &str| text.parse::<u32>().ok().filter(|_| !text.starts_with('+'));
        let (row, ending) = row.rsplit_once('.').unwrap_or((row, ""));
        let found = number(zoom).zip(number(column)).zip(number(row));
        let Some(((zoom @ 0..=30, column), row)) = found else {
            return Err(Failure::bad("tile: expected zoom, column and row, as in 3/4/2.png"));
        };
        if column >> zoom != 0 || row >> zoom != 0 {
            let message = format!(
                "tile: got {zoom}/{column}/{row}, expected a column and a row of 0 to {}",
                (1u64 << zoom) - 1
            );
            return Err(Failure::missing(message));
        }
        Ok(TileAddress { tile: TileId { zoom: zoom as u8, column, row }, format: format_of(ending)? })
    }
}

/// Tile format by its name.
fn format_of(name: &str) -> Result<TileFormat, Failure> {
    let format = TileFormat::from_str(name).ok();
    let sent = format.filter(|format| matches!(format, TileFormat::Png | TileFormat::Webp | TileFormat::Npy));
    sent.ok_or_else(|| {
        Failure::bad(format!("tile format: got `{}`, expected png, webp or npy", name.escape_debug()))
    })
}

/// Whether the tiles are those of the tree's own grid.
fn is_native(parameters: &Parameters) -> Result<bool, Failure> {
    match parameters.text("grid") {
        None | Some("web") => Ok(false),
        Some("native") => Ok(true),
        Some(other) => Err(Failure::bad(format!("grid: got `{other}`, expected web or native"))),
    }
}

/// Response with a tile; without content if the tile has no data.
pub(crate) fn respond(
    tree: &OpenTree,
    parameters: &Parameters,
    TileAddress { tile, format }: TileAddress,
    tag: String,
    progress: &dyn Progress,
) -> Result<QueryResponse, Failure> {
    let style = parameters.text("style").map(Style::parse).transpose()?;
    if style.is_some() && format.is_array() {
        return Err(Failure::bad("style: applies to images (png, webp), not to arrays"));
    }
    let drawn = tree.drawn(parameters.text("layer"))?;
    if drawn.is_composite && format.is_array() {
        return Err(Failure::bad(
            "layer: got several, expected one; only images (png, webp) show several, as colours",
        ));
    }
    let tiles = drawn.tiles(is_native(parameters)?)?;
    let source = tiles.source();
    let last = source.max_zoom(SIDE);
    if tile.zoom > last {
        return Err(Failure::missing(format!("zoom: got {}, expected 0 to {last}", tile.zoom)));
    }
    let painter = drawn.painter(style.as_ref(), progress)?;
    let void = if format.is_array() { void_number(&drawn.tree)? } else { None };
    // Tiles made on request use the fastest compression; colour images always do.
    let png_effort = painter.palette().is_some().then_some(1);
    let encoding = TileEncoding { format, png_effort, ..TileEncoding::default() };
    let content_type = match format {
        TileFormat::Png => "image/png",
        TileFormat::Webp => "image/webp",
        _ => "application/octet-stream",
    };
    let make = || encode_tile(source, &painter, encoding, SIDE, void, tile);
    let uniform = if format.is_array() { None } else { tiles.uniform(tile, painter.margin())? };
    let made = match uniform {
        Some(value) => {
            drawn.uniform_image((painter.colours().look.clone(), format.extension(), value), make)?
        }
        None => make()?,
    };
    Ok(match made {
        Some(bytes) => QueryResponse::new(content_type, tag, bytes),
        None => QueryResponse::nothing(tag),
    })
}

/// Response that describes the tiles (`TileJSON` 3.0); `server` is the server's URL.
pub(crate) fn about(
    tree: &OpenTree,
    parameters: &Parameters,
    (server, name): (&str, &str),
    tag: String,
) -> Result<QueryResponse, Failure> {
    let format = format_of(parameters.text("format").unwrap_or("png"))?;
    if let Some(style) = parameters.text("style") {
        Style::parse(style)?;
    }
    let drawn = tree.drawn(parameters.text("layer"))?;
    let is_native = is_native(parameters)?;
    let tiles = drawn.tiles(is_native)?;
    let source = tiles.source();
    let mut query = form_urlencoded::Serializer::new(String::new());
    for name in PARAMETERS {
        parameters.text(name).map(|value| query.append_pair(name, value));
    }
    let query = query.finish();
    let query = if query.is_empty() { query } else { format!("?{query}") };
    let path = format!("{server}/tiles/{}/{{z}}/{{x}}/{{y}}", utf8_percent_encode(name, ESCAPED));
    let metadata = drawn.tree.metadata();
    let mut about = json!({
        "tilejson": "3.0.0",
        "name": if metadata.name.is_empty() { name } else { &metadata.name },
        "scheme": "xyz",
        "tiles": [format!("{path}.{}{query}", format.extension())],
        "minzoom": 0,
        "maxzoom": source.max_zoom(SIDE),
    });
    if is_native {
        // Tiles of another grid have no position on a web map.
        let frame = source.frame(drawn.tree.depth());
        let [columns, rows, _] = drawn.tree.header().extent;
        about["grid"] = json!({
            "cells": [columns, rows],
            "depth": drawn.tree.depth(),
            "crs": frame.crs.as_ref().map(ToString::to_string),
            "affine": [frame.matrix[0][0], frame.matrix[0][1], frame.matrix[0][3], frame.matrix[1][0], frame.matrix[1][1], frame.matrix[1][3]],
        });
    } else {
        let place = source.data_place()?;
        let [longitude, latitude] = place.centre;
        about["bounds"] = json!(place.bounds);
        about["center"] = json!([longitude, latitude, source.max_zoom(SIDE).saturating_sub(2)]);
    }
    Ok(QueryResponse::new("application/json", tag, format!("{about:#}\n").into_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tile_addresses_are_parsed() {
        let found = TileAddress::parse("3", "7", "0.png").unwrap();
        assert_eq!(
            (found.tile.zoom, found.tile.column, found.tile.row, found.format),
            (3, 7, 0, TileFormat::Png)
        );
        for (zoom, column, row) in [
            ("3", "8", "0.png"),
            ("3", "0", "8.png"),
            ("31", "0", "0.png"),
            ("-1", "0", "0.png"),
            ("3", "0", "0"),
            ("3", "0", "0.tif"),
            ("3", "+1", "0.png"),
            ("3", "0", ".png"),
            ("99999999999", "0", "0.png"),
            ("", "", ""),
        ] {
            assert!(TileAddress::parse(zoom, column, row).is_err(), "{zoom}/{column}/{row}");
        }
    }
}
