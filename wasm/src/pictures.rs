//! Colours: pictures, tiles and legends of trees in a style.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use serde::Deserialize;
use serde_json::{Value, json};
use spinney_base::space::Bounds;
use spinney_base::value::Number;
use spinney_base::{Error, Result};
use spinney_engine::dataset::Dataset;
use spinney_engine::ops::WarpOptions;
use spinney_style::{Ground, Key, LegendClass, SampleBlock, Style};
use spinney_tiles::{MAX_ZOOM, TileId, TilePainter, TileSource, TreeTiles, WarpedTiles, draw_tile};

use crate::answer::Found;
use crate::failure::too_large;
use crate::part::Part;
use crate::solid::{self, Slice};
use crate::windows::{Detail, at_level};

/// Bytes that a picture may have.
const MOST_BYTES: u64 = 1 << 28;

/// A part in a style.
#[derive(Deserialize)]
pub(crate) struct Image {
    #[serde(flatten)]
    part: Part,
    #[serde(flatten)]
    detail: Detail,
    style: Option<String>,
}

/// A tile in a style.
#[derive(Deserialize)]
pub(crate) struct Tile {
    x: u32,
    y: u32,
    z: u8,
    grid: Option<String>,
    /// Pixels along a side.
    size: Option<usize>,
    style: Option<String>,
}

/// What is made ready once for many pictures of a tree.
#[derive(Default)]
pub(crate) struct Prepared {
    painters: RefCell<BTreeMap<Option<String>, Rc<TilePainter>>>,
    warped: RefCell<BTreeMap<usize, Rc<WarpedTiles>>>,
}

/// Styles that are kept ready.
const MOST_STYLES: usize = 16;

impl Prepared {
    /// A style made ready: that of the tree, if none is given.
    fn painter(&self, tree: &Dataset, style: Option<&String>) -> Result<Rc<TilePainter>> {
        let key = style.cloned();
        if let Some(ready) = self.painters.borrow().get(&key) {
            return Ok(ready.clone());
        }
        let style = style.map_or_else(|| Ok(Style::default_for(tree)), |text| Style::parse(text))?;
        let ready = Rc::new(TilePainter::new(&style, tree, &())?);
        let mut all = self.painters.borrow_mut();
        if all.len() >= MOST_STYLES {
            all.clear();
        }
        all.insert(key, ready.clone());
        Ok(ready)
    }

    /// Tiles of web maps of a tree that lies on another grid.
    fn warped(&self, tree: &Dataset, side: usize) -> Result<Rc<WarpedTiles>> {
        if let Some(ready) = self.warped.borrow().get(&side) {
            return Ok(ready.clone());
        }
        let source = tree.whole_source().ok_or_else(|| {
            Error::unsupported(tree.name(), "a view as the source of tiles", "open the file itself")
        })?;
        let frame = &tree.metadata().frame;
        // (Farther in than its cells are, too: maps are looked at closely.)
        let deepest = MAX_ZOOM.min(29 - side.trailing_zeros() as u8).min(MOST_ZOOM);
        let ready = Rc::new(WarpedTiles::new(source, frame, side, Some(deepest), &WarpOptions::default())?);
        let mut all = self.warped.borrow_mut();
        all.insert(side, ready.clone());
        Ok(ready)
    }
}

/// The deepest zoom of tiles that are warped.
const MOST_ZOOM: u8 = 22;

fn check_quadtree(tree: &Dataset) -> Result<()> {
    if tree.header().form.axes() == 2 {
        return Ok(());
    }
    Err(Error::unsupported(
        tree.name(),
        "an octree, where a quadtree is asked for,",
        "ask for slices or meshes",
    ))
}

/// A picture of a part: red, green, blue and opacity of each pixel, which are the cells of a level.
pub(crate) fn image(tree: &Dataset, prepared: &Prepared, image: &Image) -> Result<Found> {
    check_quadtree(tree)?;
    let bounds = image.part.one_box(tree)?;
    let level = image.detail.level(tree, &bounds)?;
    let shift = tree.depth() - level;
    let cells = at_level(&bounds, shift);
    let needed = cells.volume().saturating_mul(4);
    if needed > MOST_BYTES {
        return Err(too_large(tree.name(), "the picture", needed, MOST_BYTES));
    }
    let painter = prepared.painter(tree, image.style.as_ref())?;
    let painter = painter.painter();
    let margin = painter.margin() as usize;
    let [width, height] = [0, 1].map(|axis| cells.size()[axis] as usize);
    let (bytes, valid) = with_margin(tree, level, &cells, margin)?;
    let frame = tree.metadata().frame.coarser(shift);
    let columns = tree.extent_at(level).size()[0];
    let ground = Ground::new(&frame, columns).rows(cells.min[1] as f64, height);
    let block = SampleBlock { width, height, margin, bytes: &bytes, valid: &valid, ground: &ground };
    let mut rgba = vec![0; width * height * 4];
    painter.paint(&block, &mut rgba)?;
    let covered = Bounds {
        min: [cells.min[0] << shift, cells.min[1] << shift, 0],
        max: [cells.max[0] << shift, cells.max[1] << shift, 1],
    };
    let [low, high] = tree.metadata().frame.world_box(&covered);
    let json = json!({
        "width": width,
        "height": height,
        "level": level,
        "cells": [covered.min[0], covered.min[1], covered.max[0], covered.max[1]],
        "bounds": [low[0], low[1], high[0], high[1]],
    });
    Ok(Found { json, buffers: vec![rgba] })
}

/// The samples of a box of a level's cells and of those around it, VOID where the tree has none.
fn with_margin(tree: &Dataset, level: u8, cells: &Bounds, margin: usize) -> Result<(Vec<u8>, Vec<bool>)> {
    let width = tree.header().form.width();
    let margin = margin as u64;
    let all = cells.size().map(|size| size + 2 * margin);
    let inside = Bounds {
        min: [cells.min[0].saturating_sub(margin), cells.min[1].saturating_sub(margin), 0],
        max: [cells.max[0] + margin, cells.max[1] + margin, 1],
    };
    let count = inside.volume() as usize;
    let (mut bytes, mut valid) = (vec![0; count * width], vec![false; count]);
    tree.window(level, &inside, Number::default(), &mut bytes, Some(&mut valid))?;
    if inside.size()[..2] == all[..2] {
        return Ok((bytes, valid));
    }
    let [columns, rows] = [0, 1].map(|axis| all[axis] as usize);
    let (mut around, mut has_value) = (vec![0; columns * rows * width], vec![false; columns * rows]);
    // (Cells that would have negative numbers are missing.)
    let [left, above] = [0, 1].map(|axis| (margin - (cells.min[axis] - inside.min[axis])) as usize);
    let row_cells = inside.size()[0] as usize;
    for (row, (from, known)) in
        bytes.chunks_exact(row_cells * width).zip(valid.chunks_exact(row_cells)).enumerate()
    {
        let to = (above + row) * columns + left;
        around[to * width..][..from.len()].copy_from_slice(from);
        has_value[to..][..known.len()].copy_from_slice(known);
    }
    Ok((around, has_value))
}

/// A slice of an octree in a style: red, green, blue and opacity of each pixel.
pub(crate) fn slice_image(
    tree: &Dataset,
    prepared: &Prepared,
    slice: &Slice,
    style: Option<&String>,
) -> Result<Found> {
    let painter = prepared.painter(tree, style)?;
    let painter = painter.painter();
    if painter.margin() > 0 {
        let expected = "one that paints cells by their own values: slopes and light are those of maps";
        return Err(Error::invalid("style", "one of heights", expected));
    }
    let Found { mut json, buffers } = solid::slice(tree, slice)?;
    let [width, height] = ["width", "height"].map(|name| json[name].as_u64().unwrap_or(0) as usize);
    let valid: Vec<bool> = match buffers.get(1) {
        Some(mask) if json["hasMask"] == true => mask.iter().map(|is_there| *is_there != 0).collect(),
        _ => vec![true; width * height],
    };
    let ground = vec![[1.0; 2]; height];
    let block = SampleBlock { width, height, margin: 0, bytes: &buffers[0], valid: &valid, ground: &ground };
    let mut rgba = vec![0; width * height * 4];
    painter.paint(&block, &mut rgba)?;
    if let Some(members) = json.as_object_mut() {
        members.retain(|name, _| ["width", "height", "level", "cells", "bounds"].contains(&name.as_str()));
    }
    Ok(Found { json, buffers: vec![rgba] })
}

/// A tile: red, green, blue and opacity of each pixel, or nothing where nothing is there.
pub(crate) fn tile(tree: &Dataset, prepared: &Prepared, tile: &Tile) -> Result<Found> {
    check_quadtree(tree)?;
    let side = tile.size.unwrap_or(256);
    if !(side.is_power_of_two() && (16..=4096).contains(&side)) {
        return Err(Error::invalid("size", side.to_string(), "a power of two from 16 to 4096"));
    }
    let id = TileId { zoom: tile.z, column: tile.x, row: tile.y };
    let deepest = 29 - side.trailing_zeros() as u8;
    if tile.z > deepest || tile.x >> tile.z != 0 || tile.y >> tile.z != 0 {
        let found = format!("{}/{}/{}", tile.z, tile.x, tile.y);
        return Err(Error::invalid(
            "tile",
            found,
            format!("a zoom up to {deepest}, and x and y below 2^zoom"),
        ));
    }
    let painter = prepared.painter(tree, tile.style.as_ref())?;
    let pixels = match tile.grid.as_deref() {
        Some("native") => drawn(&TreeTiles::native(tree), &painter, id, side)?,
        None | Some("web-mercator") => match TreeTiles::world(tree) {
            Some(tiles) => drawn(&tiles, &painter, id, side)?,
            None => drawn(&*prepared.warped(tree, side)?, &painter, id, side)?,
        },
        Some(other) => return Err(Error::invalid("grid", other, "web-mercator or native")),
    };
    let buffers: Vec<Vec<u8>> = pixels.into_iter().map(|pixels| pixels.into_flattened()).collect();
    Ok(Found { json: json!({ "side": side, "isEmpty": buffers.is_empty() }), buffers })
}

fn drawn(
    source: &dyn TileSource,
    painter: &TilePainter,
    id: TileId,
    side: usize,
) -> Result<Option<Vec<[u8; 4]>>> {
    draw_tile(source, painter, id, side)
}

/// What the colours of a style mean, section by section.
pub(crate) fn legend(tree: &Dataset, prepared: &Prepared, style: Option<&String>) -> Result<Found> {
    let painter = prepared.painter(tree, style)?;
    let legend = painter.painter().legend(tree)?;
    let section = |section: &spinney_style::LegendSection| match &section.key {
        Key::Classes(classes) => {
            let class = |class: &LegendClass| json!({ "value": class.value, "label": class.name, "colour": class.colour });
            let classes = classes.iter().map(class);
            json!({ "title": section.title, "classes": classes.collect::<Vec<Value>>() })
        }
        Key::Ramp { colours, ticks } => {
            let ticks = ticks.iter().map(|tick| json!({ "at": tick.at, "label": tick.label }));
            json!({ "title": section.title, "ramp": { "stops": colours, "ticks": ticks.collect::<Vec<Value>>() } })
        }
    };
    let sections: Vec<Value> = legend.sections.iter().map(section).collect();
    Ok(json!({ "title": legend.title, "sections": sections }).into())
}
