//! Tiles that a surface may cross, in Z order: their extremes, joined with those of the preceding
//! tiles, do not exclude the surface.

use std::collections::HashMap;

use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::{Progress, Result};
use spinney_engine::query::{Extremes, Relief};

/// Base-2 logarithm of a tile's side in cells. (A row of a tile's cells, plus the cell before it,
/// has one bit each in a u128.)
pub(super) const TILE: u8 = 6;

/// Tile that a surface may cross.
pub(super) struct Tile {
    /// Position at its level; may be one past the last node along an axis.
    pub(super) at: [u32; 3],
    /// Whether the surface may cross between the tile's own cells, or only between these and the
    /// preceding ones.
    pub(super) is_crossed: bool,
}

/// Cells that a surface crosses.
pub(super) struct IsosurfaceGround<'a> {
    pub(super) relief: &'a dyn Relief,
    /// Level, and extent of the tree at the level in cells.
    pub(super) level: u8,
    pub(super) whole: [u64; 3],
    /// Value of VOID and the exterior: finite; negative infinity, which closes surfaces; or NaN,
    /// which ends them.
    pub(super) none: f64,
}

impl IsosurfaceGround<'_> {
    /// Level whose nodes are tiles.
    fn tile_level(&self) -> u8 {
        self.level.saturating_sub(TILE)
    }

    /// Number of tiles along each axis, including those after the last cells that close the
    /// surface.
    pub(super) fn tiles(&self) -> [u64; 3] {
        self.whole.map(|cells| (cells + u64::from(!self.none.is_nan())).div_ceil(1 << TILE))
    }

    /// Extremes of the exterior.
    fn outside(&self) -> Extremes {
        match self.none.is_finite() {
            true => Extremes { min: self.none, max: self.none, has_values: true, has_void: false },
            false => Extremes { has_void: true, ..Extremes::NONE },
        }
    }

    /// Cells of the extent in a node.
    pub(super) fn cells(&self, level: u8, node: [u32; 3]) -> u64 {
        let code = Code::from_cell(Dimension::Oct, level, node);
        code.map_or(0, |code| code.bounds(self.level).intersect(&Bounds::of_extent(self.whole)).volume())
    }

    /// Cells of the extent in a tile.
    pub(super) fn cells_of_tile(&self, tile: [u32; 3]) -> u64 {
        self.cells(self.tile_level(), tile)
    }
}

/// Maximum number of nodes whose extremes are cached.
const MAX_KNOWN: usize = 1 << 15;

/// Traversal of the tree for one value.
pub(super) struct TileTraversal<'a> {
    ground: &'a IsosurfaceGround<'a>,
    value: f64,
    /// Stack of nodes to visit.
    pending: Vec<(u8, [u32; 3])>,
    known: HashMap<Code, Extremes>,
}

impl<'a> TileTraversal<'a> {
    pub(super) fn new(ground: &'a IsosurfaceGround<'a>, value: f64) -> TileTraversal<'a> {
        // Tiles next to the space may close the surface.
        let pending = (0..8).rev().map(|step| (0, child([0; 3], step))).collect();
        TileTraversal { ground, value, pending, known: HashMap::new() }
    }

    /// Returns the next tiles, at most `most`; none at the end. Reports the cells of skipped nodes
    /// as progress.
    ///
    /// # Errors
    /// If the tree is corrupt, or on cancellation.
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

    /// Whether the surface may cross between cells with these extremes.
    fn may_pass(&self, cells: &Extremes) -> bool {
        let has_low = cells.min < self.value || self.ground.none < self.value && cells.has_void;
        cells.has_values && has_low && cells.max >= self.value
    }

    /// Extremes of a node joined with those of the nodes before it: covers all cubes whose last
    /// corners are in the node.
    fn with_before(&mut self, level: u8, node: [u32; 3], own: Extremes) -> Result<Extremes> {
        (1..8).try_fold(own, |all, step| {
            let before = std::array::from_fn(|axis| i64::from(node[axis]) - i64::from(step >> axis & 1));
            Ok(all.with(self.extremes(level, before)?))
        })
    }

    /// Extremes of a node; nodes outside of the extent are VOID.
    fn extremes(&mut self, level: u8, node: [i64; 3]) -> Result<Extremes> {
        let outside = self.ground.outside();
        let [Ok(x), Ok(y), Ok(z)] = node.map(u32::try_from) else { return Ok(outside) };
        let Some(code) = Code::from_cell(Dimension::Oct, level, [x, y, z]) else { return Ok(outside) };
        if let Some(known) = self.known.get(&code) {
            return Ok(*known);
        }
        let mut extremes = self.ground.relief.extremes(code)?;
        // (A tile may be larger than the whole space.)
        let is_inside = Bounds::of_extent(self.ground.whole).contains(&code.bounds(self.ground.level));
        if !is_inside || self.ground.level < TILE {
            extremes = extremes.with(outside);
        }
        if self.known.len() >= MAX_KNOWN {
            self.known.clear();
        }
        self.known.insert(code, extremes);
        Ok(extremes)
    }
}

fn child(node: [u32; 3], step: u32) -> [u32; 3] {
    std::array::from_fn(|axis| node[axis] << 1 | step >> axis & 1)
}
