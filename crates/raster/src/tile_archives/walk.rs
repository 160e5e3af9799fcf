//! Traversal of all tiles of some zooms, in the order of their numbers, from the root down. Empty
//! and uniform regions are settled without descending into them.

use std::ops::{Range, RangeInclusive};

use spinney_base::value::Value;
use spinney_base::{Progress, Result};
use spinney_tiles::{TileContent, TileSource};
use spinney_tiles::{TileId, TileRange, first_number};

/// Consecutive tiles: one that must be drawn, or many that are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TileSpan {
    /// Number of the first tile: [`TileId::number`].
    pub(super) first: u64,
    pub(super) count: u64,
    /// The value of all their cells; `None` for a single tile that must be drawn.
    pub(super) uniform: Option<Value>,
}

/// The extent of a traversal.
#[derive(Clone, Debug)]
pub(super) struct TileExtent {
    pub(super) zooms: RangeInclusive<u8>,
    /// West, south, east, north; tiles that do not intersect this box are omitted.
    pub(super) degrees: [f64; 4],
    /// Width of the margin of cells that a tile's image depends on. If it is not 0, a tile is
    /// settled only together with its neighbours.
    pub(super) margin: usize,
    /// Whether tiles store their positions, so that no two are equal and none is settled.
    pub(super) is_georeferenced: bool,
    /// The range of runs to yield, by their indices.
    pub(super) runs: Range<u64>,
}

/// State of a traversal.
pub(super) struct TileTraversal<'a> {
    source: &'a dyn TileSource,
    extent: TileExtent,
    zoom: u8,
    range: TileRange,
    /// Nodes still to be visited, the next one last.
    pending: Vec<TileId>,
    /// Index of the next run.
    next: u64,
}

impl<'a> TileTraversal<'a> {
    pub(super) fn new(source: &'a dyn TileSource, extent: &TileExtent) -> TileTraversal<'a> {
        let mut walk = TileTraversal {
            source,
            extent: extent.clone(),
            zoom: *extent.zooms.start(),
            range: TileRange::world(0),
            pending: Vec::new(),
            next: 0,
        };
        walk.start_zoom();
        walk
    }

    fn start_zoom(&mut self) {
        self.range = TileRange::of_degrees(self.zoom, self.extent.degrees);
        self.pending.push(TileId { zoom: 0, column: 0, row: 0 });
    }

    /// Returns the next non-empty tiles among the requested runs.
    ///
    /// Invariant: runs and their order depend only on the source and the extent. So the shares of
    /// several processes together yield every run exactly once.
    pub(super) fn next_run(&mut self) -> Result<Option<TileSpan>> {
        while self.next < self.extent.runs.end
            && let Some(run) = self.any_run()?
        {
            self.next += 1;
            if self.next > self.extent.runs.start {
                return Ok(Some(run));
            }
        }
        Ok(None)
    }

    fn any_run(&mut self) -> Result<Option<TileSpan>> {
        loop {
            while let Some(node) = self.pending.pop() {
                if let Some(run) = self.visit(node)? {
                    return Ok(Some(run));
                }
            }
            if self.zoom >= *self.extent.zooms.end() {
                return Ok(None);
            }
            self.zoom += 1;
            self.start_zoom();
        }
    }

    /// Returns up to `most` further runs.
    pub(super) fn next_runs(&mut self, most: usize) -> Result<Vec<TileSpan>> {
        let mut runs = Vec::with_capacity(most);
        while runs.len() < most
            && let Some(run) = self.next_run()?
        {
            runs.push(run);
        }
        Ok(runs)
    }

    fn visit(&mut self, node: TileId) -> Result<Option<TileSpan>> {
        let below = TileRange::below(node, self.zoom);
        if self.range.intersect(&below).is_empty() {
            return Ok(None);
        }
        let content = self.source.content(node)?;
        // A neighbour with values does not matter: VOID cells stay VOID.
        if content == TileContent::Empty {
            return Ok(None);
        }
        if node.zoom == self.zoom {
            let uniform = settled(self.source, &self.extent, node, content)?;
            return Ok(Some(TileSpan { first: node.number(), count: 1, uniform }));
        }
        let along = node.along_curve();
        if self.range.contains(&below)
            && let Some(value) = settled(self.source, &self.extent, node, content)?
        {
            let shift = 2 * (self.zoom - node.zoom);
            let first = first_number(self.zoom) + (along << shift);
            return Ok(Some(TileSpan { first, count: 1 << shift, uniform: Some(value) }));
        }
        // The children's section of the curve, in its order.
        let children = (0..4).rev().map(|step| TileId::on_curve(node.zoom + 1, along << 2 | step));
        self.pending.extend(children);
        Ok(None)
    }

    /// Counts all non-empty tiles and their runs, without drawing any.
    pub(super) fn count(mut self, progress: &dyn Progress) -> Result<(u64, u64)> {
        let (mut tiles, mut runs) = (0, 0u64);
        while let Some(run) = self.next_run()? {
            tiles += run.count;
            runs += 1;
            if runs.is_multiple_of(1 << 12) {
                progress.check()?;
            }
        }
        Ok((tiles, runs))
    }
}

/// Returns the value of all cells of a tile and its margin, if it is uniform. `content` is the
/// source's content of the tile.
pub(super) fn settled(
    source: &dyn TileSource,
    extent: &TileExtent,
    tile: TileId,
    content: TileContent,
) -> Result<Option<Value>> {
    let TileContent::Uniform(value) = content else { return Ok(None) };
    if extent.is_georeferenced {
        return Ok(None);
    }
    if extent.margin == 0 {
        return Ok(Some(value));
    }
    let side = 1u32 << tile.zoom;
    for step in 0..9u32 {
        // One column and row back, none, and one forward.
        let column = (tile.column + side + step % 3 - 1) % side;
        let Some(row) = (tile.row + step / 3).checked_sub(1).filter(|row| *row < side) else {
            return Ok(None);
        };
        if source.content(TileId { column, row, ..tile })? != content {
            return Ok(None);
        }
    }
    Ok(Some(value))
}
