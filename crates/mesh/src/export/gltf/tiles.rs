//! Tiles of an octree: which tiles a surface crosses, and the triangles of each.

use super::super::losses::Losses;
use super::super::units::{length, metres_of_unit, units_of_crs};
use super::super::visit::Reach;
use super::super::{MeshRequest, Precision};
use super::glb::{Glb, TileAttribute};
use super::tile_cells::TileCells;
use super::tile_mesh::TileMesh;
use spinney_base::parallel::Pool;
use spinney_base::value::{DataKind, Rule, SampleType};
use spinney_base::{Progress, Result};
use spinney_container::Tag;
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_engine::query::cell_blocks::{BlockAttribute, CellBlocks, can_be_block_attribute};
use spinney_engine::query::check_level;

/// Levels between a tile and its cells.
const TILE_LEVELS: u8 = 6;

/// Frame whose coordinates are multiplied by a factor.
fn scaled(frame: &Frame, factor: f64) -> Frame {
    Frame { matrix: frame.matrix.map(|row| row.map(|number| number * factor)), ..frame.clone() }
}

/// Node at a level of tiles, by its index in Z order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    pub(super) level: u8,
    pub(super) order: u64,
}

impl Tile {
    pub(super) const ROOT: Tile = Tile { level: 0, order: 0 };

    /// Position at the level, in tiles.
    pub(super) fn place(self) -> [u32; 3] {
        let bit = |axis: usize, level: u8| ((self.order >> (3 * level + axis as u8)) as u32 & 1) << level;
        [0, 1, 2].map(|axis| (0..self.level).map(|level| bit(axis, level)).sum())
    }

    pub(super) fn children(self) -> impl Iterator<Item = Tile> {
        let first = self.order << 3;
        (first..first + 8).map(move |order| Tile { level: self.level + 1, order })
    }
}

/// Blocks of cells from which a thread makes tiles.
pub(super) type Blocks<'a> = Box<dyn CellBlocks + Send + 'a>;

/// Makes triangles from tiles.
pub(super) struct TileMaker<'a> {
    tree: &'a Dataset,
    /// Finest level of cells, and its frame.
    level: u8,
    frame: Frame,
    smooth: bool,
    attribute: TileAttribute,
    carry: BlockAttribute,
}

impl<'a> TileMaker<'a> {
    pub(super) fn new(tree: &'a Dataset, request: &MeshRequest) -> Result<TileMaker<'a>> {
        let header = tree.header();
        let level = request.level.unwrap_or(tree.depth());
        check_level(level, tree.depth())?;
        let frame = tree.metadata().frame.coarser(tree.depth() - level);
        Precision::of(&frame, level)?;
        let is_class = header.kind == DataKind::Categorical && can_be_block_attribute(header.form.value);
        let attribute = match (header.form.value.sample, header.form.value.channels) {
            _ if header.rule == Rule::Occupancy => TileAttribute::None,
            (SampleType::U8, 3 | 4) => TileAttribute::Colour,
            _ if is_class => TileAttribute::Class,
            _ => TileAttribute::None,
        };
        let carry = match attribute {
            TileAttribute::None if request.smooth && header.rule == Rule::Occupancy => {
                BlockAttribute::Coverage
            }
            TileAttribute::None => BlockAttribute::Nothing,
            _ => BlockAttribute::Value,
        };
        Ok(TileMaker { tree, level, frame, smooth: request.smooth, attribute, carry })
    }

    /// Adds what glTF cannot store: values that are neither colours nor classes, and units that are
    /// not lengths.
    pub(super) fn add_losses(&self, losses: &mut Losses) -> Result<()> {
        let is_lost = self.attribute == TileAttribute::None && self.tree.header().rule != Rule::Occupancy;
        if is_lost {
            losses.add_values(self.tree, "values of cells")?;
        }
        let unit = self.tree.metadata().tag(Tag::Unit);
        losses.add_unit(unit.filter(|unit| length(Some(unit)).is_none()), None);
        Ok(())
    }

    /// Finest level of cells.
    pub(super) fn level(&self) -> u8 {
        self.level
    }

    /// Frame of the finest cells, in metres.
    pub(super) fn in_metres(&self) -> Frame {
        let crs = self.frame.crs.as_ref();
        scaled(&self.frame, metres_of_unit(self.tree.metadata().tag(Tag::Unit), crs))
    }

    /// Frame of the finest cells, in units of the coordinate system.
    pub(super) fn in_crs(&self) -> Frame {
        let unit = self.tree.metadata().tag(Tag::Unit);
        let units = self.frame.crs.as_ref().filter(|crs| !crs.is_geographic());
        scaled(&self.frame, units.map_or(1.0, |crs| units_of_crs(unit, crs)))
    }

    /// Cells of the finest level along each axis of the tree's extent.
    pub(super) fn extent(&self) -> [f64; 3] {
        let shift = self.tree.depth() - self.level;
        self.tree.header().extent.map(|cells| cells.div_ceil(1 << shift) as f64)
    }

    pub(super) fn attribute(&self) -> TileAttribute {
        self.attribute
    }

    /// Whether surfaces extend beyond the cells of their tile: see [`TileMaker::bounds`].
    pub(super) fn is_smooth(&self) -> bool {
        self.smooth
    }

    /// Number of tile levels.
    pub(super) fn tile_levels(&self) -> u8 {
        self.level.saturating_sub(TILE_LEVELS) + 1
    }

    /// Side of a tile, and of its cells, in cells of the finest level.
    fn sides(&self, tile_level: u8) -> [f64; 2] {
        let cells = self.cells_of(tile_level);
        [tile_level, cells].map(|level| f64::from(1u32 << (self.level - level)))
    }

    /// Side of the cells of a level's tiles, in cells of the finest level.
    pub(super) fn cell_side(&self, tile_level: u8) -> f64 {
        self.sides(tile_level)[1]
    }

    /// Level of the cells of a level's tiles.
    fn cells_of(&self, tile_level: u8) -> u8 {
        self.level - (self.tile_levels() - 1 - tile_level)
    }

    /// Bounding box of the surfaces of a tile and its descendants, in cells of the finest level.
    pub(super) fn bounds(&self, tile: Tile) -> [[f64; 3]; 2] {
        let [side, cell] = self.sides(tile.level);
        let least = tile.place().map(|at| f64::from(at) * side);
        self.with_reach(least, least.map(|at| at + side), cell)
    }

    /// Bounding box of the surfaces of all tiles.
    pub(super) fn all_bounds(&self) -> [[f64; 3]; 2] {
        // The coarsest cells extend furthest.
        let cell = self.cell_side(0);
        self.with_reach([0.0; 3], self.extent().map(|cells| (cells / cell).ceil() * cell), cell)
    }

    /// Box of cells with side `cell`, extended by the margin of the surfaces.
    fn with_reach(&self, least: [f64; 3], most: [f64; 3], cell: f64) -> [[f64; 3]; 2] {
        // Quadrangles around a cell's edges have corners in the two cells before it. At the end of
        // the space they also extend half a cell after it.
        let (before, after) = if self.smooth { (1.5 * cell, 0.5 * cell) } else { (0.0, 0.0) };
        [least.map(|at| at - before), most.map(|at| at + after)]
    }

    /// Cells without attributes, for [`TileMaker::wants`].
    pub(super) fn shape(&self) -> Result<Blocks<'a>> {
        self.tree.cell_blocks(self.level, BlockAttribute::Nothing)
    }

    /// Whether a surface may cross a tile.
    pub(super) fn wants(&self, shape: &mut Blocks<'a>, tile: Tile) -> Result<bool> {
        let node = tile.place();
        if !self.smooth {
            return Reach::Faces.wants(&mut **shape, tile.level, node);
        }
        // The last tiles also cover what lies beyond the space.
        let ends = node.map(|cell| cell + 1 == 1 << tile.level);
        for step in (0..8).filter(|step| (0..3).all(|axis| step >> axis & 1 == 0 || ends[axis])) {
            let node = [0, 1, 2].map(|axis| node[axis] + (step >> axis & 1));
            if Reach::Nets.wants(&mut **shape, tile.level, node)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Passes the tiles that a surface may cross to `each`, in Z order, each before its
    /// descendants.
    pub(super) fn visit(&self, progress: &dyn Progress, mut each: impl FnMut(Tile)) -> Result<()> {
        let mut shape = self.shape()?;
        // A stack: the last tile is the next one.
        let mut pending = vec![Tile::ROOT];
        while let Some(tile) = pending.pop() {
            progress.check()?;
            if !self.wants(&mut shape, tile)? {
                continue;
            }
            each(tile);
            if tile.level + 1 < self.tile_levels() {
                let first = pending.len();
                pending.extend(tile.children());
                pending[first..].reverse();
            }
        }
        Ok(())
    }

    /// Tiles of the finest level, in Z order.
    pub(super) fn finest(&self, progress: &dyn Progress) -> Result<Vec<Tile>> {
        let mut finest = Vec::new();
        self.visit(progress, |tile| {
            if tile.level + 1 == self.tile_levels() {
                finest.push(tile);
            }
        })?;
        Ok(finest)
    }

    /// Triangles of a tile. The thread takes the level's blocks from the pool.
    pub(super) fn mesh(&self, pool: &Pool<Blocks<'a>>, tile: Tile) -> Result<TileMesh> {
        let make = || self.tree.cell_blocks(self.cells_of(tile.level), self.carry);
        pool.with(make, |blocks| {
            let mut cells = TileCells { blocks: &mut **blocks, level: tile.level, node: tile.place() };
            TileMesh::of(&mut cells, self.smooth, self.attribute != TileAttribute::None)
        })
    }

    /// Adds a tile to a file whose coordinates are cells of the finest level.
    pub(super) fn push(&self, glb: &mut Glb<'_>, tile: Tile, mesh: &TileMesh) {
        let [side, cell] = self.sides(tile.level);
        glb.push(mesh, tile.place().map(|at| f64::from(at) * side), cell);
    }
}
