//! Tilesets of 3D Tiles 1.1: an implicit octree, subtree by subtree.

use glam::DMat4;
use serde_json::{Value as Json, json};

use super::super::MeshRequest;
use super::super::losses::Losses;
use super::glb::{Glb, y_up};
use super::globe::OnGlobe;
use super::subtree::Subtree;
use super::tiles::{Blocks, Tile, TileMaker};
use super::{BATCH, GltfOptions};
use spinney_base::io::OutputDirectory;
use spinney_base::parallel::{self, Pool};
use spinney_base::{Progress, Result};
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;

/// Levels of tiles in a subtree: at most 585 tiles.
const SUBTREE_LEVELS: u8 = 4;

/// Size of a written tileset, and its deviation from the globe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TilesetSummary {
    /// Tiles with content.
    pub tiles: u64,
    /// Levels of tiles.
    pub levels: u8,
    /// Triangles of all tiles.
    pub triangles: u64,
    /// Maximum deviation from the curved globe in metres; `None` if the tileset is in the tree's
    /// world coordinates, in metres.
    pub deviation: Option<f64>,
}

/// Writes an octree, or a view of one, as a tileset of 3D Tiles 1.1: `tileset.json`, subtrees and
/// contents. Contents are glTF with normals, colours, and classes as features. The output is a new
/// directory, which is created atomically. The request's level is the finest level.
///
/// A tree with a known coordinate system is placed on the globe, by the affine map that touches the
/// globe in the middle of the tree. Other trees keep their world coordinates, in metres, with z up:
/// other units of length are converted, and without a unit, coordinates are taken as metres.
///
/// Each thread holds the blocks around the tiles that it makes, at most 128 MiB. Memory does not
/// grow with the number of tiles.
///
/// # Errors
/// If the tree is a quadtree, has no such level, or is corrupt; if its frame is flat; if the
/// directory exists and is not empty, or cannot be written; or on cancellation.
pub fn export_tileset(
    tree: &Dataset,
    request: &MeshRequest,
    options: &GltfOptions,
    output: OutputDirectory,
    progress: &dyn Progress,
) -> Result<TilesetSummary> {
    options.check()?;
    super::super::warn_full(tree, progress)?;
    let maker = TileMaker::new(tree, request)?;
    let mut total = 0;
    maker.visit(progress, |_| total += 1)?;
    let space = [[0.0; 3], maker.extent()];
    let on_globe = OnGlobe::touching(&maker.in_crs(), space);
    let matrix = on_globe.map_or_else(|| matrix(&maker.in_metres()), |on_globe| on_globe.matrix);
    let mut shape = maker.shape()?;
    let mut writer = TilesetWriter {
        tree,
        // In metres on the globe, the unit of geometric errors.
        unit: (0..3).map(|axis| matrix.col(axis).truncate().length()).fold(0.0, f64::max),
        matrix,
        subtree_levels: SUBTREE_LEVELS.min(maker.tile_levels()),
        summary: TilesetSummary {
            levels: maker.tile_levels(),
            deviation: on_globe.map(|on_globe| on_globe.deviation),
            ..TilesetSummary::default()
        },
        maker,
        finest: Pool::default(),
        options,
        output: &output,
        progress,
        total,
    };
    writer.subtree(&mut shape, Tile::ROOT)?;
    let mut text = serde_json::to_vec_pretty(&writer.tileset()).expect("keys are text");
    text.push(b'\n');
    let summary = writer.summary;
    let mut losses = Losses::in_file(&output.path().join("tileset.json"));
    // (Tilesets on the globe are in metres; others store their coordinate system as a note.)
    if summary.deviation.is_none() {
        writer.maker.add_losses(&mut losses)?;
    }
    output.write("tileset.json", &text)?;
    tree.check_unchanged()?;
    output.commit()?;
    losses.report(progress);
    Ok(summary)
}

/// Frame as a matrix.
fn matrix(frame: &Frame) -> DMat4 {
    let [x, y, z] = frame.matrix;
    DMat4::from_cols_array_2d(&[x, y, z, [0.0, 0.0, 0.0, 1.0]]).transpose()
}

struct TilesetWriter<'a, 'b> {
    tree: &'a Dataset,
    maker: TileMaker<'a>,
    options: &'b GltfOptions,
    output: &'b OutputDirectory,
    progress: &'b dyn Progress,
    /// From cells of the finest level to the coordinates of the tileset.
    matrix: DMat4,
    /// Side of these cells in the coordinates below the root. The root's transform then mostly
    /// rotates and translates.
    unit: f64,
    subtree_levels: u8,
    summary: TilesetSummary,
    /// Blocks of the finest cells.
    finest: Pool<Blocks<'a>>,
    /// Number of tiles to make.
    total: u64,
}

impl<'a> TilesetWriter<'a, '_> {
    /// Writes a subtree and all subtrees below it. Returns whether it has any tiles.
    fn subtree(&mut self, shape: &mut Blocks<'a>, root: Tile) -> Result<bool> {
        let levels = self.subtree_levels.min(self.maker.tile_levels() - root.level);
        let mut tiles = Vec::new();
        let mut here = vec![root];
        for _ in 0..levels {
            let mut next = Vec::new();
            for tile in here {
                if self.maker.wants(shape, tile)? {
                    tiles.push(tile);
                    next.extend(tile.children());
                }
            }
            here = next;
        }
        if root.level + levels == self.maker.tile_levels() {
            here.clear();
        }
        let mut children = Vec::new();
        for child in here {
            if self.subtree(shape, child)? {
                children.push(child);
            }
        }
        let mut made = Vec::new();
        for tiles in tiles.chunk_by(|a, b| a.level == b.level) {
            made.extend(self.contents(tiles)?);
        }
        let subtree = Subtree::of(root, self.subtree_levels, made, children);
        if subtree.is_empty() {
            return Ok(false);
        }
        let bounds = |tile| self.bounding_box(self.maker.bounds(tile));
        let bounds: Option<&dyn Fn(Tile) -> [f64; 12]> = self.maker.is_smooth().then_some(&bounds);
        let [x, y, z] = root.place();
        self.output
            .write(&format!("subtrees/{}/{x}/{y}/{z}.subtree", root.level), &subtree.to_bytes(bounds))?;
        Ok(true)
    }

    /// Writes the contents of tiles of a level; returns which of them have content.
    fn contents(&mut self, tiles: &[Tile]) -> Result<Vec<(Tile, bool)>> {
        // Most tiles are of the finest level; neighbours among these share blocks across subtrees.
        let is_finest = tiles.iter().all(|tile| tile.level + 1 == self.maker.tile_levels());
        let (own, this) = (Pool::default(), &*self);
        let pool = if is_finest { &self.finest } else { &own };
        let mut made = Vec::new();
        for batch in tiles.chunks(BATCH) {
            let counts = parallel::map(batch, |tile| {
                this.progress.check()?;
                let count = this.content(pool, *tile)?;
                this.progress.advance(1, this.total);
                Ok(count)
            });
            made.extend(counts.into_iter().collect::<Result<Vec<u64>>>()?);
        }
        self.summary.triangles += made.iter().sum::<u64>();
        self.summary.tiles += made.iter().filter(|count| **count > 0).count() as u64;
        Ok(tiles.iter().copied().zip(made.into_iter().map(|count| count > 0)).collect())
    }

    /// Writes a tile if it has triangles; returns their number.
    fn content(&self, pool: &Pool<Blocks<'a>>, tile: Tile) -> Result<u64> {
        let mesh = self.maker.mesh(pool, tile)?;
        if !mesh.triangles.is_empty() {
            let mut cells = Frame::identity();
            (0..3).for_each(|axis| cells.matrix[axis][axis] = self.unit);
            let (attribute, metadata) = (self.maker.attribute(), self.tree.metadata());
            let mut glb = Glb::new(attribute, self.options, metadata, y_up(&cells), mesh.attributes());
            self.maker.push(&mut glb, tile, &mesh);
            let [x, y, z] = tile.place();
            self.output.write(&format!("content/{}/{x}/{y}/{z}.glb", tile.level), &glb.finish())?;
        }
        Ok(mesh.triangles.len() as u64)
    }

    /// Centre and half axes of a box of cells.
    fn bounding_box(&self, [least, most]: [[f64; 3]; 2]) -> [f64; 12] {
        let centre = |axis: usize| (least[axis] + most[axis]) / 2.0 * self.unit;
        let half = |axis: usize| (most[axis] - least[axis]) / 2.0 * self.unit;
        [centre(0), centre(1), centre(2), half(0), 0.0, 0.0, 0.0, half(1), 0.0, 0.0, 0.0, half(2)]
    }

    /// Content of `tileset.json`.
    fn tileset(&self) -> Json {
        let mut asset = json!({ "version": "1.1", "generator": "spinney" });
        if let Some(crs) = &self.tree.metadata().frame.crs {
            let note = match self.summary.deviation {
                Some(_) => "the root's transform leads to EPSG:4978 by an affine map",
                None => "the root's transform leads to coordinates of this system, not to geocentric ones",
            };
            asset["extras"] = json!({ "crs": crs.definition(), "note": note });
        }
        let mut transform = self.matrix;
        (0..3).for_each(|axis| *transform.col_mut(axis) /= self.unit);
        let side = f64::from(1u32 << self.maker.level());
        let mut tileset = json!({
            "asset": asset,
            "geometricError": side * self.unit,
            // The box of the tree's cells; they may fill only little of the cube below.
            "root": {
                "transform": transform.to_cols_array(),
                "boundingVolume": { "box": self.bounding_box(self.maker.all_bounds()) },
                "geometricError": side * self.unit,
                "refine": "REPLACE",
                "children": [{
                    "boundingVolume": { "box": self.bounding_box([[0.0; 3], [side; 3]]) },
                    // Side of a cell. It halves from level to level.
                    "geometricError": self.maker.cell_side(0) * self.unit,
                    "content": { "uri": "content/{level}/{x}/{y}/{z}.glb" },
                    "implicitTiling": {
                        "subdivisionScheme": "OCTREE",
                        "availableLevels": self.maker.tile_levels(),
                        "subtreeLevels": self.subtree_levels,
                        "subtrees": { "uri": "subtrees/{level}/{x}/{y}/{z}.subtree" },
                    },
                }],
            },
        });
        if self.maker.is_smooth() {
            // Surfaces extend beyond the cells of their tiles.
            tileset["schema"] = json!({ "id": "tiles", "classes": { "tile": { "properties": {
                "boundingBox": { "type": "SCALAR", "componentType": "FLOAT64", "array": true, "count": 12,
                    "required": true, "semantic": "TILE_BOUNDING_BOX" },
            } } } });
        }
        tileset
    }
}
