//! Cells in a polygon: how it covers a node, and the cells' shares, determined once for all trees
//! of a grid.

use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::Range;

use super::super::walk::Selection;
use spinney_base::space::{Bounds, Cover, EdgeRule};
use spinney_overlay::{Crossings, FULL_SHARE, Polygon};

/// The cells of a raster in a polygon.
pub(super) struct ZoneCells<'a> {
    pub(super) polygon: &'a Polygon,
    pub(super) rule: EdgeRule,
    pub(super) extent: Bounds,
    /// Cached results for the other trees of the grid, if there are any.
    pub(super) found: Option<RefCell<FoundCells>>,
}

/// Cached results for the cells in a polygon. Keys are first column and row, columns and rows of
/// nodes.
#[derive(Default)]
pub(super) struct FoundCells {
    covers: HashMap<[u64; 4], Cover>,
    counts: HashMap<[u64; 4], CellCount>,
    spans: HashMap<[u64; 4], Vec<Span>>,
    /// Total length of all span lists.
    count: usize,
}

/// Row, columns, and share of each cell in units of 1/[`FULL_SHARE`].
type Span = (u64, Range<u64>, u64);

/// Number of cells that count fully, and the sum of the shares of all others.
pub(super) type CellCount = (u64, u128);

/// Returns full cells and shares together, in shares.
pub(super) fn in_shares((cells, shares): CellCount) -> u128 {
    u128::from(cells) * u128::from(FULL_SHARE) + shares
}

/// Converts a sum of shares to cells, with one rounding.
pub(super) fn in_cells(shares: u128) -> f64 {
    shares as f64 / FULL_SHARE as f64
}

/// Maximum number of cached entries of each kind.
const MAX_FOUND: usize = 1 << 16;

/// Returns the cache key of a node.
fn area_of(bounds: &Bounds) -> [u64; 4] {
    let ([x, y, _], [columns, rows, _]) = (bounds.min, bounds.size());
    [x, y, columns, rows]
}

impl ZoneCells<'_> {
    /// Returns the cached result, or computes and caches it.
    fn find<T: Copy>(
        &self,
        bounds: &Bounds,
        kind: fn(&mut FoundCells) -> &mut HashMap<[u64; 4], T>,
        find: impl FnOnce() -> T,
    ) -> T {
        let Some(known) = &self.found else { return find() };
        let area = area_of(bounds);
        if let Some(found) = kind(&mut known.borrow_mut()).get(&area) {
            return *found;
        }
        let found = find();
        let (mut known, limit) = (known.borrow_mut(), MAX_FOUND);
        let of_kind = kind(&mut known);
        if of_kind.len() < limit {
            of_kind.insert(area, found);
        }
        found
    }

    /// Counts the cells of a box that are in the polygon.
    pub(super) fn count(&self, bounds: &Bounds, crossings: &mut Crossings) -> CellCount {
        // (In an octree, a polygon extends along all of z.)
        let layers = bounds.max[2] - bounds.min[2];
        let count = || match self.rule {
            EdgeRule::Centre => (self.polygon.count_centres(bounds, crossings), 0),
            EdgeRule::Touch => (self.polygon.count_touched(bounds, crossings), 0),
            EdgeRule::Area => self.polygon.sum_shares(bounds, crossings),
        };
        let (cells, shares) = self.find(bounds, |found| &mut found.counts, count);
        (layers * cells, u128::from(layers) * shares)
    }

    /// Returns the area outside of the raster in cells.
    pub(super) fn outside(&self) -> f64 {
        self.polygon.area_outside(&self.extent) * self.extent.max[2] as f64
    }

    /// Passes the spans of a box's cells in the polygon to `each`, row by row, with the share of
    /// each cell.
    pub(super) fn spans(
        &self,
        bounds: &Bounds,
        crossings: &mut Crossings,
        each: &mut dyn FnMut(u64, Range<u64>, u64),
    ) {
        let mut spans = |each: &mut dyn FnMut(u64, Range<u64>, u64)| match self.rule {
            EdgeRule::Centre => {
                self.polygon.spans(bounds, crossings, &mut |row, span| each(row, span, FULL_SHARE))
            }
            EdgeRule::Touch => {
                self.polygon.touched_spans(bounds, crossings, &mut |row, span| each(row, span, FULL_SHARE));
            }
            EdgeRule::Area => self.polygon.shares(bounds, crossings, each),
        };
        let Some(found) = &self.found else { return spans(each) };
        let area = area_of(bounds);
        let mut found = found.borrow_mut();
        if let Some(known) = found.spans.get(&area) {
            return known.iter().for_each(|(row, span, share)| each(*row, span.clone(), *share));
        }
        if found.count >= MAX_FOUND {
            return spans(each);
        }
        let mut list = Vec::new();
        spans(&mut |row, span, share| {
            each(row, span.clone(), share);
            list.push((row, span, share));
        });
        found.count += list.len();
        found.spans.insert(area, list);
    }

    fn cover_of(&self, space: &Bounds) -> Cover {
        match self.rule {
            EdgeRule::Centre => self.polygon.cover_centres(space),
            EdgeRule::Touch | EdgeRule::Area => self.polygon.cover_area(space),
        }
    }
}

impl Selection for ZoneCells<'_> {
    fn cover(&self, space: &Bounds) -> Cover {
        // Cells outside of the raster are VOID and do not count.
        if self.extent.intersect(space).is_empty() {
            return Cover::Nothing;
        }
        self.find(space, |found| &mut found.covers, || self.cover_of(space))
    }

    fn part(&self, space: &Bounds) -> Bounds {
        *space
    }
}
