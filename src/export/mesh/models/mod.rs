//! Octrees as models for viewers: 3D Tiles 1.1, and single levels as binary glTF.
//!
//! A tileset is the octree itself (implicit tiling): a tile is a node, and has the surface of the 64 x 64 x 64 cells that lie so
//! many levels below it, in place of which viewers load its eight children when they come nearer. Tiles are made each by
//! itself, on all threads, and meet without cracks: all of a level are on one lattice.

mod glb;
mod part;
mod subtree;
mod surface;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;

use serde_json::json;

use self::glb::{Model, ModelAttribute};
use self::part::Part;
use self::subtree::{SUBTREE_LEVELS, Tiles, place, subtrees};
use self::surface::{Surface, surface};
use super::visit::Reach;
use super::{MeshRequest, Precision};
use crate::dataset::Dataset;
use crate::io::{Output, OutputFolder};
use crate::parallel::{self, Pool};
use crate::query::cell_blocks::{Carry, CellBlocks, can_carry_value};
use crate::query::check_level;
use crate::space::Frame;
use crate::value::{Kind, Rule, SampleType};
use crate::{Error, Progress, Result};

/// Levels between a tile and its cells.
const TILE_LEVELS: u8 = 6;
/// Tiles that are made at a time.
const BATCH: usize = 256;
/// Bytes that a single model may have: it is made in memory.
const MAX_MODEL: usize = 1 << 30;

/// Size of a written tileset or model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ModelSummary {
    /// Tiles with content.
    pub tiles: u64,
    /// Levels of tiles.
    pub levels: usize,
    /// Triangles of all tiles.
    pub triangles: u64,
}

/// Writes an octree, or a view of one, as a tileset of 3D Tiles 1.1: `tileset.json`, subtrees and contents (glTF with
/// normals, colours, and classes as features) in a new folder, which appears whole or not at all. The request's level is
/// the finest. Coordinates are those of the tree's world, whatever system that is; `asset.extras` tells it.
///
/// Memory: for each thread the blocks around the tile that it makes (64 MiB at most), and some bytes per tile.
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is damaged; if its frame is flat; if the folder is there already and
/// is not empty, or cannot be written; or on interruption.
pub fn export_tileset(
    tree: &Dataset,
    request: &MeshRequest,
    output: OutputFolder,
    progress: &dyn Progress,
) -> Result<ModelSummary> {
    let maker = Maker::new(tree, request)?;
    let planned = maker.plan(progress)?;
    let total: u64 = planned.iter().map(|level| level.len() as u64).sum();
    let mut summary = ModelSummary { levels: planned.len(), ..ModelSummary::default() };
    let mut tiles: Tiles = Vec::new();
    for (tile_level, planned) in (0u8..).zip(&planned) {
        let cells = maker.cells_of(tile_level);
        let pool = Pool::new();
        let mut made = BTreeMap::new();
        for batch in planned.chunks(BATCH) {
            let written = parallel::map(batch, |order| {
                progress.check()?;
                let node = place(*order);
                let tile = maker.surface(&pool, tile_level, node)?;
                progress.advance(1, total);
                let count = tile.triangles.len() as u64;
                if count > 0 {
                    let mut model = Model::new(
                        maker.attribute,
                        tree.metadata(),
                        columns(&Frame::identity(), true),
                        tile.corners.iter().map(|corner| corner.attribute),
                    );
                    maker.push(&mut model, &tile, tile_level, node);
                    let [x, y, z] = node;
                    output.write(&format!("content/{tile_level}/{x}/{y}/{z}.glb"), &model.finish())?;
                }
                Ok((*order, count))
            });
            for written in written {
                let (order, count) = written?;
                made.insert(order, count > 0);
                summary.triangles += count;
                summary.tiles += u64::from(count > 0);
            }
        }
        debug_assert!(cells <= maker.level);
        tiles.push(made);
    }
    prune(&mut tiles);
    let subtree_levels = SUBTREE_LEVELS.min(tiles.len());
    for (level, [x, y, z], bytes) in subtrees(&tiles, subtree_levels) {
        progress.check()?;
        output.write(&format!("subtrees/{level}/{x}/{y}/{z}.subtree"), &bytes)?;
    }
    let mut text =
        serde_json::to_vec_pretty(&maker.tileset(tiles.len(), subtree_levels)).expect("no maps of others");
    text.push(b'\n');
    output.write("tileset.json", &text)?;
    tree.check_unchanged()?;
    output.commit()?;
    Ok(summary)
}

/// Writes one level of an octree, or of a view of one, as binary glTF, in the coordinates of its world (with y upwards, as
/// glTF has it): a node for each part of 64 x 64 x 64 cells. The model is made in memory.
///
/// # Errors
/// Those of [`export_tileset`]; also if the model would have more than 1 GiB.
pub fn export_glb(
    tree: &Dataset,
    request: &MeshRequest,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<ModelSummary> {
    let maker = Maker::new(tree, request)?;
    let planned = maker.plan(progress)?.pop().unwrap_or_default();
    let tile_level = maker.tile_levels() - 1;
    let mut surfaces: Vec<([u32; 3], Surface)> = Vec::new();
    let mut summary = ModelSummary { levels: 1, ..ModelSummary::default() };
    let pool = Pool::new();
    let mut bytes = 0;
    for batch in planned.chunks(BATCH) {
        let made = parallel::map(batch, |order| {
            progress.check()?;
            let tile = maker.surface(&pool, tile_level, place(*order))?;
            progress.advance(1, planned.len() as u64);
            Ok((place(*order), tile))
        });
        for made in made.into_iter().collect::<Result<Vec<_>>>()? {
            let (corners, triangles) = (made.1.corners.len(), made.1.triangles.len());
            if triangles > 0 {
                bytes += 24 * corners + 12 * triangles;
                surfaces.push(made);
            }
        }
        if bytes > MAX_MODEL {
            return Err(Error::TooLarge {
                path: tree.path().to_path_buf(),
                what: format!("a model of level {}", maker.level),
                needed: bytes as u64,
                limit: MAX_MODEL as u64,
                advice: "choose a coarser level, or write a tileset (x/tileset.json)".into(),
            });
        }
    }
    let attributes = surfaces.iter().flat_map(|(_, tile)| tile.corners.iter().map(|corner| corner.attribute));
    let classes: BTreeSet<u32> = attributes.collect();
    let mut model = Model::new(maker.attribute, tree.metadata(), columns(&maker.frame, true), classes);
    for (node, tile) in surfaces {
        summary.tiles += 1;
        summary.triangles += tile.triangles.len() as u64;
        maker.push(&mut model, &tile, tile_level, node);
    }
    tree.check_unchanged()?;
    output.write_all(&model.finish()).map_err(Error::io(output.path(), "write"))?;
    output.commit()?;
    Ok(summary)
}

/// Keeps the tiles that have content or lead to some, and the root.
fn prune(tiles: &mut Tiles) {
    for level in (1..tiles.len()).rev() {
        let (above, here) = tiles.split_at_mut(level);
        let below: BTreeSet<u64> = match here.get(1) {
            Some(next) => next.keys().map(|order| order >> 3).collect(),
            None => BTreeSet::new(),
        };
        here[0].retain(|order, has_content| *has_content || below.contains(order));
        debug_assert!(here[0].keys().all(|order| above[level - 1].contains_key(&(order >> 3))));
    }
    tiles[0].entry(0).or_insert(false);
}

/// A frame's matrix by columns; with y upwards if asked for, as glTF has it, where trees have z.
fn columns(frame: &Frame, y_up: bool) -> [f64; 16] {
    let m = &frame.matrix;
    let mut columns = [0.0; 16];
    for column in 0..4 {
        let [x, y, z] = [m[0][column], m[1][column], m[2][column]];
        // (Without minus zeros.)
        let rows = if y_up { [x, z, 0.0 - y] } else { [x, y, z] };
        columns[4 * column..4 * column + 3].copy_from_slice(&rows);
    }
    columns[15] = 1.0;
    columns
}

/// The way from nodes to surfaces.
struct Maker<'a> {
    tree: &'a Dataset,
    /// The finest level of cells, and their frame.
    level: u8,
    frame: Frame,
    smooth: bool,
    attribute: ModelAttribute,
    carry: Carry,
}

impl<'a> Maker<'a> {
    fn new(tree: &'a Dataset, request: &MeshRequest) -> Result<Maker<'a>> {
        let header = tree.header();
        let level = request.level.unwrap_or(tree.depth());
        check_level(level, tree.depth())?;
        let frame = tree.metadata().frame.coarser(tree.depth() - level);
        Precision::of(&frame, level)?;
        let attribute = match (header.form.value.sample, header.form.value.channels) {
            _ if header.rule == Rule::Occupancy => ModelAttribute::None,
            (SampleType::U8, 3 | 4) => ModelAttribute::Colour,
            _ if header.kind == Kind::Categorical && can_carry_value(header.form.value) => {
                ModelAttribute::Class
            }
            _ => ModelAttribute::None,
        };
        let carry = match attribute {
            ModelAttribute::None if request.smooth && header.rule == Rule::Occupancy => Carry::Coverage,
            ModelAttribute::None => Carry::Nothing,
            _ => Carry::Value,
        };
        Ok(Maker { tree, level, frame, smooth: request.smooth, attribute, carry })
    }

    fn tile_levels(&self) -> u8 {
        self.level.saturating_sub(TILE_LEVELS) + 1
    }

    /// The level of the cells of tiles of a level.
    fn cells_of(&self, tile_level: u8) -> u8 {
        self.level - (self.tile_levels() - 1 - tile_level)
    }

    /// The tiles of each level that a surface may pass through, in Z order.
    fn plan(&self, progress: &dyn Progress) -> Result<Vec<Vec<u64>>> {
        let mut blocks = self.tree.cell_blocks(self.level, Carry::Nothing)?;
        let mut levels: Vec<Vec<u64>> = Vec::new();
        for tile_level in 0..self.tile_levels() {
            progress.check()?;
            let nodes: Vec<u64> = match levels.last() {
                Some(above) => above.iter().flat_map(|order| (order << 3)..(order + 1) << 3).collect(),
                None => vec![0],
            };
            let mut wanted = Vec::new();
            for order in nodes {
                if self.wants(&mut *blocks, tile_level, place(order))? {
                    wanted.push(order);
                }
            }
            levels.push(wanted);
        }
        Ok(levels)
    }

    fn wants(&self, blocks: &mut dyn CellBlocks, level: u8, node: [u32; 3]) -> Result<bool> {
        if !self.smooth {
            return Reach::Faces.wants(blocks, level, node);
        }
        // The last tiles have what lies beyond the space, too.
        let ends = node.map(|cell| cell + 1 == 1 << level);
        for step in (0..8).filter(|step| (0..3).all(|axis| step >> axis & 1 == 0 || ends[axis])) {
            if Reach::Nets.wants(blocks, level, [0, 1, 2].map(|axis| node[axis] + (step >> axis & 1)))? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The surface of a tile; its thread takes blocks from the pool.
    fn surface(
        &self,
        pool: &Pool<Box<dyn CellBlocks + Send + 'a>>,
        tile_level: u8,
        node: [u32; 3],
    ) -> Result<Surface> {
        let make = || self.tree.cell_blocks(self.cells_of(tile_level), self.carry);
        pool.with(make, |blocks| {
            let mut part = Part { blocks: &mut **blocks, level: tile_level, node };
            surface(&mut part, self.smooth, self.attribute != ModelAttribute::None)
        })
    }

    /// Adds a tile to a model.
    fn push(&self, model: &mut Model<'_>, tile: &Surface, tile_level: u8, node: [u32; 3]) {
        let cell = f64::from(1u32 << (self.level - self.cells_of(tile_level)));
        let side = f64::from(1u32 << (self.level - tile_level));
        model.push(tile, node.map(|at| f64::from(at) * side), cell);
    }

    /// The content of `tileset.json`.
    fn tileset(&self, levels: usize, subtree_levels: usize) -> serde_json::Value {
        let side = (1u64 << self.level) as f64;
        let half = side / 2.0;
        let longest = (0..3).map(|axis| self.frame.linear().col(axis).length()).fold(0.0, f64::max);
        let mut asset = json!({ "version": "1.1", "generator": "spinney" });
        if let Some(crs) = &self.frame.crs {
            asset["extras"] = json!({
                "crs": crs.definition(),
                "note": "coordinates after the root's transform are those of this system, not geocentric ones",
            });
        }
        json!({
            "asset": asset,
            "geometricError": side * longest,
            "root": {
                "transform": columns(&self.frame, false),
                "boundingVolume": { "box": [half, half, half, half, 0.0, 0.0, 0.0, half, 0.0, 0.0, 0.0, half] },
                // The side of a cell; that of each level is half of that above.
                "geometricError": f64::from(1u32 << (self.level - self.cells_of(0))),
                "refine": "REPLACE",
                "content": { "uri": "content/{level}/{x}/{y}/{z}.glb" },
                "implicitTiling": {
                    "subdivisionScheme": "OCTREE",
                    "availableLevels": levels,
                    "subtreeLevels": subtree_levels,
                    "subtrees": { "uri": "subtrees/{level}/{x}/{y}/{z}.subtree" },
                },
            },
        })
    }
}
