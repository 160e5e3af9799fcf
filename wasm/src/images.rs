//! Images, tiles and legends of trees in a style.

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
use spinney_tiles::{MAX_ZOOM, TileId, TilePainter, TreeTiles, WarpedTiles, draw_tile};

use crate::failure::too_large;
use crate::files::Opened;
use crate::region::Region;
use crate::result::Found;
use crate::solid::IN_SLICE;
use crate::windows::{Detail, at_level, read};

/// Maximum bytes of an image.
const MAX_BYTES: u64 = 1 << 28;

/// How a region is drawn.
#[derive(Deserialize)]
pub(crate) struct Image {
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

/// Styles and grids, prepared once for many images of a tree.
#[derive(Default)]
pub(crate) struct Prepared {
    painters: RefCell<BTreeMap<Option<String>, Rc<TilePainter>>>,
    warped: RefCell<BTreeMap<usize, Rc<WarpedTiles>>>,
}

/// Maximum number of prepared styles.
const MAX_STYLES: usize = 16;

impl Prepared {
    /// Returns a prepared style, by default the tree's.
    fn painter(&self, tree: &Dataset, style: Option<&String>) -> Result<Rc<TilePainter>> {
        let key = style.cloned();
        if let Some(ready) = self.painters.borrow().get(&key) {
            return Ok(ready.clone());
        }
        let style = style.map_or_else(|| Ok(Style::default_for(tree)), |text| Style::parse(text))?;
        let ready = Rc::new(TilePainter::new(&style, tree, &())?);
        let mut all = self.painters.borrow_mut();
        if all.len() >= MAX_STYLES {
            all.clear();
        }
        all.insert(key, ready.clone());
        Ok(ready)
    }

    /// Returns the web map tiles of a tree on another grid.
    fn warped(&self, tree: &Dataset, side: usize) -> Result<Rc<WarpedTiles>> {
        if let Some(ready) = self.warped.borrow().get(&side) {
            return Ok(ready.clone());
        }
        let source = tree.whole_source().ok_or_else(|| {
            Error::unsupported(tree.name(), "drawing tiles of a view", "open the file itself")
        })?;
        let frame = &tree.metadata().frame;
        // (Also at zooms beyond the cells' resolution, which maps allow.)
        let deepest = MAX_ZOOM.min(29 - side.trailing_zeros() as u8).min(MAX_DRAWN_ZOOM);
        let mut options = WarpOptions::default();
        options.level_cells = Some(WarpOptions::PREVIEW);
        let ready = Rc::new(WarpedTiles::new(source, frame, side, Some(deepest), &options)?);
        let mut all = self.warped.borrow_mut();
        all.insert(side, ready.clone());
        Ok(ready)
    }
}

/// The deepest zoom of warped tiles.
const MAX_DRAWN_ZOOM: u8 = 22;

fn check_quadtree(tree: &Dataset) -> Result<()> {
    if tree.header().form.axes() == 2 {
        return Ok(());
    }
    Err(Error::unsupported(tree.name(), "this query of an octree", "octrees have slices and meshes"))
}

/// Returns an image of a region: red, green, blue and opacity of each pixel, which is a cell of a
/// level.
pub(crate) fn image(opened: &Opened, (region, detail): (&Region, &Detail), image: &Image) -> Result<Found> {
    let (tree, prepared) = (opened.cells()?, &opened.prepared);
    check_quadtree(tree)?;
    let bounds = region.one_box(tree)?;
    let level = detail.level(tree, &bounds)?;
    let shift = tree.depth() - level;
    let cells = at_level(&bounds, shift);
    let needed = cells.volume().saturating_mul(4);
    if needed > MAX_BYTES {
        return Err(too_large(tree.name(), "the image", needed, MAX_BYTES));
    }
    let painter = prepared.painter(tree, image.style.as_ref())?;
    let painter = painter.painter();
    let margin = painter.margin() as usize;
    let [width, height] = [0, 1].map(|axis| cells.size()[axis] as usize);
    let (bytes, valid) = with_margin(tree, level, &cells, margin)?;
    // (Without georeferencing, cells have the size 1 at all levels, as in images.)
    let frame = &tree.metadata().frame;
    let frame = if frame.is_identity() { frame.clone() } else { frame.coarser(shift) };
    let columns = tree.extent_at(level).size()[0];
    let ground = Ground::new(&frame, columns).rows(cells.min[1] as f64, height);
    let block = SampleBlock { width, height, margin, bytes: &bytes, valid: &valid, ground: &ground };
    let mut rgba = vec![0; width * height * 4];
    painter.paint(&block, &mut rgba)?;
    Ok(Found { json: image_json(tree, [width, height], level, &cells), buffers: vec![rgba] })
}

/// Returns size and extent of an image of a level's cells: cells of the deepest level, and
/// coordinates.
fn image_json(tree: &Dataset, [width, height]: [usize; 2], level: u8, cells: &Bounds) -> Value {
    let (axes, shift) = (tree.header().form.axes(), tree.depth() - level);
    let mut covered = Bounds { min: cells.min.map(|at| at << shift), max: cells.max.map(|at| at << shift) };
    if axes == 2 {
        (covered.min[2], covered.max[2]) = (0, 1);
    }
    let [low, high] = tree.metadata().frame.world_box(&covered);
    let cells = [&covered.min[..axes], &covered.max[..axes]].concat();
    let bounds = [&low[..axes], &high[..axes]].concat();
    json!({
        "width": width,
        "height": height,
        "level": level,
        "cells": cells,
        "bounds": bounds,
    })
}

/// Returns the samples of a box of a level's cells with a margin, VOID outside of the tree.
fn with_margin(tree: &Dataset, level: u8, cells: &Bounds, margin: usize) -> Result<(Vec<u8>, Vec<bool>)> {
    let width = tree.header().form.width();
    let margin = margin as u64;
    let all = cells.size().map(|size| size + 2 * margin);
    let inside = Bounds {
        min: [cells.min[0].saturating_sub(margin), cells.min[1].saturating_sub(margin), 0],
        max: [cells.max[0] + margin, cells.max[1] + margin, 1],
    };
    let (bytes, valid) = read(tree, level, &inside, Number::default())?;
    // (Cells at negative positions are missing.)
    let before = [0, 1].map(|axis| (margin - (cells.min[axis] - inside.min[axis])) as usize);
    let [from, to] = [inside.size(), all].map(|size| [size[0] as usize, size[1] as usize]);
    Ok((framed(bytes, width, (from, to, before)), framed(valid, 1, (from, to, before))))
}

/// Embeds cells of `items` items each into a larger array of defaults, given the columns and rows
/// of both and the margin before them.
fn framed<T: Copy + Default>(
    cells: Vec<T>,
    items: usize,
    ([columns, _], to, before): ([usize; 2], [usize; 2], [usize; 2]),
) -> Vec<T> {
    if cells.len() == to[0] * to[1] * items {
        return cells;
    }
    let mut all = vec![T::default(); to[0] * to[1] * items];
    for (row, from) in cells.chunks_exact(columns * items).enumerate() {
        let first = ((before[1] + row) * to[0] + before[0]) * items;
        all[first..][..from.len()].copy_from_slice(from);
    }
    all
}

/// Returns an image of a slice of an octree across an axis; a vertical slice has the highest cells
/// at the top.
pub(crate) fn slice_image(
    tree: &Dataset,
    prepared: &Prepared,
    style: Option<&String>,
    (bounds, level, across): (&Bounds, u8, usize),
) -> Result<Found> {
    let cells = at_level(bounds, tree.depth() - level);
    let painter = prepared.painter(tree, style)?;
    let painter = painter.painter();
    let margin = painter.margin() as usize;
    let [width, height] = IN_SLICE[across].map(|axis| cells.size()[axis] as usize);
    let (bytes, valid) = read(tree, level, &cells, Number::default())?;
    let sides = ([width, height], [width + 2 * margin, height + 2 * margin], [margin; 2]);
    let bytes = framed(bytes, tree.header().form.width(), sides);
    let valid = framed(valid, 1, sides);
    // (Slices have no ground distances.)
    let ground = vec![Ground::PIXEL; height];
    let block = SampleBlock { width, height, margin, bytes: &bytes, valid: &valid, ground: &ground };
    let mut rgba = vec![0; width * height * 4];
    painter.paint(&block, &mut rgba)?;
    if across != 2 {
        rgba = rgba.chunks_exact(width * 4).rev().flatten().copied().collect();
    }
    Ok(Found { json: image_json(tree, [width, height], level, &cells), buffers: vec![rgba] })
}

/// Returns a tile: red, green, blue and opacity of each pixel, or nothing if it is empty.
pub(crate) fn tile(opened: &Opened, tile: &Tile) -> Result<Found> {
    let (tree, prepared) = (opened.cells()?, &opened.prepared);
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
        Some("native") => draw_tile(&TreeTiles::native(tree), &painter, id, side)?,
        None | Some("web-mercator") => match TreeTiles::world(tree) {
            Some(tiles) => draw_tile(&tiles, &painter, id, side)?,
            None => draw_tile(&*prepared.warped(tree, side)?, &painter, id, side)?,
        },
        Some(other) => return Err(Error::invalid("grid", other, "web-mercator or native")),
    };
    let buffers: Vec<Vec<u8>> = pixels.into_iter().map(|pixels| pixels.into_flattened()).collect();
    Ok(Found { json: json!({ "side": side, "isEmpty": buffers.is_empty() }), buffers })
}

/// Returns the meaning of the colours of a style, section by section.
pub(crate) fn legend(opened: &Opened, image: &Image) -> Result<Found> {
    let tree = opened.cells()?;
    let painter = opened.prepared.painter(tree, image.style.as_ref())?;
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
