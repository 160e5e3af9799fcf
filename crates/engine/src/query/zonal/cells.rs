//! Cells in a polygon: how it has those of a node, and their shares, found once for all trees of a grid.

use std::cell::RefCell;
use std::collections::HashMap;
use std::ops::Range;

use super::super::walk::Selection;
use spinney_base::space::{Bounds, Cover, EdgeRule};
use spinney_overlay::{Crossings, FULL_SHARE, Polygon};

/// The cells of a picture in a polygon.
pub(super) struct ZoneCells<'a> {
    pub(super) polygon: &'a Polygon,
    pub(super) rule: EdgeRule,
    pub(super) picture: Bounds,
    /// Findings for other trees of the grid, if there are any.
    pub(super) found: Option<RefCell<FoundCells>>,
}

/// Findings about the cells in a polygon, by first column and row, columns and rows of nodes.
#[derive(Default)]
pub(super) struct FoundCells {
    covers: HashMap<[u64; 4], Cover>,
    counts: HashMap<[u64; 4], CellCount>,
    spans: HashMap<[u64; 4], Vec<Span>>,
    /// Spans of all of them.
    count: usize,
}

/// Cells of a row, and the share of each that counts, of [`FULL_SHARE`].
type Span = (u64, Range<u64>, u64);

/// Cells that count as a whole, and the sum of the shares of all others.
pub(super) type CellCount = (u64, u128);

/// Whole cells and shares together, in shares.
pub(super) fn in_shares((cells, shares): CellCount) -> u128 {
    u128::from(cells) * u128::from(FULL_SHARE) + shares
}

/// A sum of shares, in cells; rounded once.
pub(super) fn in_cells(shares: u128) -> f64 {
    shares as f64 / FULL_SHARE as f64
}

/// Entries of each kind that are remembered.
const MAX_FOUND: usize = 1 << 16;

/// A node's place among what was found.
fn area_of(bounds: &Bounds) -> [u64; 4] {
    let ([x, y, _], [columns, rows, _]) = (bounds.min, bounds.size());
    [x, y, columns, rows]
}

impl ZoneCells<'_> {
    /// A finding of before; else it is found now.
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
        let (mut known, room) = (known.borrow_mut(), MAX_FOUND);
        let of_kind = kind(&mut known);
        if of_kind.len() < room {
            of_kind.insert(area, found);
        }
        found
    }

    /// Cells of a box that count.
    pub(super) fn count(&self, bounds: &Bounds, crossings: &mut Crossings) -> CellCount {
        // (A polygon goes through all of an octree along z.)
        let layers = bounds.max[2] - bounds.min[2];
        let count = || match self.rule {
            EdgeRule::Centre => (self.polygon.count_centres(bounds, crossings), 0),
            EdgeRule::Touch => (self.polygon.count_touched(bounds, crossings), 0),
            EdgeRule::Area => self.polygon.sum_shares(bounds, crossings),
        };
        let (cells, shares) = self.find(bounds, |found| &mut found.counts, count);
        (layers * cells, u128::from(layers) * shares)
    }

    /// The area outside of the picture, in cells.
    pub(super) fn outside(&self) -> f64 {
        self.polygon.area_outside(&self.picture) * self.picture.max[2] as f64
    }

    /// Hands out the columns, row by row, of a box's cells that count, and the share of each that does.
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
        // What lies outside the picture is VOID, and does not count.
        if self.picture.intersect(space).is_empty() {
            return Cover::Nothing;
        }
        self.find(space, |found| &mut found.covers, || self.cover_of(space))
    }

    fn part(&self, space: &Bounds) -> Bounds {
        *space
    }
}
