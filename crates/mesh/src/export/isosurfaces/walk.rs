//! The tiles that a surface may pass through, in Z order: those whose extremes, with those of the tiles before them, do not exclude it.

use std::collections::HashMap;

use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::{Progress, Result};
use spinney_engine::query::{Extremes, Relief};

/// Cells along an edge of a tile as a power of two. (A row of a tile's cells, with the one before it, has a bit each in a u128.)
pub(super) const TILE: u8 = 6;

/// A tile that a surface may pass through.
pub(super) struct Tile {
    /// Its place among the nodes of its level, or beside these.
    pub(super) at: [u32; 3],
    /// Whether the surface may pass between the tile's own cells, or only between these and the ones before them.
    pub(super) is_crossed: bool,
}

/// The cells that a surface goes through.
pub(super) struct IsosurfaceGround<'a> {
    pub(super) relief: &'a dyn Relief,
    /// The level, and the cells of the whole there.
    pub(super) level: u8,
    pub(super) whole: [u64; 3],
    /// The value that VOID and all outside count as: a number, less than everything (so that surfaces are closed), or not a number (so that they end).
    pub(super) none: f64,
}

impl IsosurfaceGround<'_> {
    /// The level whose nodes are tiles.
    fn tile_level(&self) -> u8 {
        self.level.saturating_sub(TILE)
    }

    /// Tiles along the axes, with those behind the last cells that close the surface.
    pub(super) fn tiles(&self) -> [u64; 3] {
        self.whole.map(|cells| (cells + u64::from(!self.none.is_nan())).div_ceil(1 << TILE))
    }

    /// The extremes of what is outside.
    fn outside(&self) -> Extremes {
        match self.none.is_finite() {
            true => Extremes { least: self.none, greatest: self.none, has_values: true, has_void: false },
            false => Extremes { has_void: true, ..Extremes::NONE },
        }
    }

    /// Cells of the whole in a node of a level.
    pub(super) fn cells(&self, level: u8, node: [u32; 3]) -> u64 {
        let code = Code::from_cell(Dimension::Oct, level, node);
        code.map_or(0, |code| code.bounds(self.level).intersect(&Bounds::picture(self.whole)).volume())
    }

    /// Cells of the whole in a tile.
    pub(super) fn cells_of_tile(&self, tile: [u32; 3]) -> u64 {
        self.cells(self.tile_level(), tile)
    }
}

/// Most nodes whose extremes are held.
const MOST: usize = 1 << 15;

/// The way through the tree for one value.
pub(super) struct TileWalk<'a> {
    ground: &'a IsosurfaceGround<'a>,
    value: f64,
    /// Nodes that are still to be looked at; the next is the last.
    pending: Vec<(u8, [u32; 3])>,
    known: HashMap<Code, Extremes>,
}

impl<'a> TileWalk<'a> {
    pub(super) fn new(ground: &'a IsosurfaceGround<'a>, value: f64) -> TileWalk<'a> {
        // Beside the space there may be tiles that close the surface.
        let pending = (0..8).rev().map(|step| (0, child([0; 3], step))).collect();
        TileWalk { ground, value, pending, known: HashMap::new() }
    }

    /// The next tiles, at most so many; none at the end. Tells of the cells that are left out.
    ///
    /// # Errors
    /// If the tree is damaged, or on interruption.
    pub(super) fn next(&mut self, most: usize, total: u64, progress: &dyn Progress) -> Result<Vec<Tile>> {
        let (tile_level, tiles) = (self.ground.tile_level(), self.ground.tiles());
        let mut found = Vec::new();
        while found.len() < most
            && let Some((level, node)) = self.pending.pop()
        {
            progress.check()?;
            let below = tile_level - level;
            if (0..3).any(|axis| u64::from(node[axis]) << below >= tiles[axis]) {
                continue;
            }
            let own = self.extremes(level, node.map(i64::from))?;
            let around = self.with_before(level, node, own)?;
            if !self.may_pass(&around) {
                progress.advance(self.ground.cells(level, node), total);
            } else if below == 0 {
                found.push(Tile { at: node, is_crossed: self.may_pass(&own) });
            } else {
                self.pending.extend((0..8).rev().map(|step| (level + 1, child(node, step))));
            }
        }
        Ok(found)
    }

    /// Whether the surface may pass between cells with these extremes.
    fn may_pass(&self, cells: &Extremes) -> bool {
        let has_low = cells.least < self.value || self.ground.none < self.value && cells.has_void;
        cells.has_values && has_low && cells.greatest >= self.value
    }

    /// The extremes of a node and the nodes before it: of all cubes whose last corners are in it.
    fn with_before(&mut self, level: u8, node: [u32; 3], own: Extremes) -> Result<Extremes> {
        (1..8).try_fold(own, |all, step| {
            let before = std::array::from_fn(|axis| i64::from(node[axis]) - i64::from(step >> axis & 1));
            Ok(all.with(self.extremes(level, before)?))
        })
    }

    /// The extremes of a node; all outside is VOID.
    fn extremes(&mut self, level: u8, node: [i64; 3]) -> Result<Extremes> {
        let outside = self.ground.outside();
        let [Ok(x), Ok(y), Ok(z)] = node.map(u32::try_from) else { return Ok(outside) };
        let Some(code) = Code::from_cell(Dimension::Oct, level, [x, y, z]) else { return Ok(outside) };
        if let Some(known) = self.known.get(&code) {
            return Ok(*known);
        }
        let mut extremes = self.ground.relief.extremes(code)?;
        // (A tile may be larger than the whole space.)
        let is_inside = Bounds::picture(self.ground.whole).contains(&code.bounds(self.ground.level));
        if !is_inside || self.ground.level < TILE {
            extremes = extremes.with(outside);
        }
        if self.known.len() >= MOST {
            self.known.clear();
        }
        self.known.insert(code, extremes);
        Ok(extremes)
    }
}

fn child(node: [u32; 3], step: u32) -> [u32; 3] {
    std::array::from_fn(|axis| node[axis] << 1 | step >> axis & 1)
}
