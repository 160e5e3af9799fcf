//! The set of tiles that differences touch: a quadtree per zoom, in which a fully touched square is
//! one node.

use std::ops::RangeInclusive;

use spinney_base::space::Code;
use spinney_tiles::TileSource;
use spinney_tiles::{TileId, TileRange};

/// A set of tiles at some zooms.
pub(super) struct TouchedTiles {
    zooms: RangeInclusive<u8>,
    /// By zoom.
    roots: Vec<Node>,
}

/// Tiles per side, as a power of two, of the squares that are stored as the bits of one number.
const SQUARE: u8 = 3;

#[derive(Debug, Default)]
enum Node {
    #[default]
    None,
    All,
    /// A square of 8 x 8 tiles, one byte per row.
    Square(u64),
    /// The quadrants: index bit 0 is the column, bit 1 the row.
    Quarters(Box<[Node; 4]>),
}

impl Node {
    /// Adds the intersection of a range with this node, which begins at `min` and has 2^`size`
    /// tiles per side.
    fn add(&mut self, min: [u32; 2], size: u8, range: &TileRange) {
        let own = TileRange { min, max: min.map(|at| at + (1 << size)) };
        let part = own.intersect(range);
        if matches!(self, Node::All) || part.is_empty() {
            return;
        }
        if part == own {
            *self = Node::All;
        } else if size == SQUARE {
            let mut bits = if let Node::Square(bits) = self { *bits } else { 0 };
            for row in part.min[1]..part.max[1] {
                let columns = ((1u64 << (part.max[0] - part.min[0])) - 1) << (part.min[0] - min[0]);
                bits |= columns << (8 * (row - min[1]));
            }
            *self = if bits == u64::MAX { Node::All } else { Node::Square(bits) };
        } else {
            if !matches!(self, Node::Quarters(_)) {
                *self = Node::Quarters(Box::default());
            }
            let Node::Quarters(quarters) = self else { return };
            let half = 1 << (size - 1);
            for (at, quarter) in quarters.iter_mut().enumerate() {
                let min = [min[0] + half * (at as u32 & 1), min[1] + half * (at as u32 >> 1)];
                quarter.add(min, size - 1, range);
            }
            if quarters.iter().all(|quarter| matches!(quarter, Node::All)) {
                *self = Node::All;
            }
        }
    }

    /// The child of this node, which has 2^`size` tiles per side, that contains a tile; the node
    /// itself if it has no children.
    fn below(&self, column: u32, row: u32, size: u8) -> &Node {
        let Node::Quarters(quarters) = self else { return self };
        let at = (column >> (size - 1) & 1) | (row >> (size - 1) & 1) << 1;
        &quarters[at as usize]
    }
}

impl TouchedTiles {
    pub(super) fn none(zooms: RangeInclusive<u8>) -> TouchedTiles {
        let roots = zooms.clone().map(|_| Node::None).collect();
        TouchedTiles { zooms, roots }
    }

    /// Tiles per side of a zoom's root, as a power of two.
    fn size(zoom: u8) -> u8 {
        zoom.max(SQUARE)
    }

    fn root(&self, zoom: u8) -> &Node {
        let at = zoom.checked_sub(*self.zooms.start()).map(usize::from);
        at.and_then(|at| self.roots.get(at)).unwrap_or(&Node::None)
    }

    /// Adds a rectangle and, with a margin, the adjacent tiles, whose images depend on it.
    pub(super) fn add(&mut self, zoom: u8, range: TileRange, margin: usize, within: &TileRange) {
        let side = 1u32 << zoom;
        let more = u32::from(margin > 0);
        let min = range.min.map(|at| at.saturating_sub(more));
        let max = range.max.map(|at| (at + more).min(side));
        let mut ranges = vec![TileRange { min, max }];
        // Columns on both sides of the antimeridian are adjacent.
        if more > 0 && range.min[0] == 0 {
            ranges.push(TileRange { min: [side - 1, min[1]], max: [side, max[1]] });
        }
        if more > 0 && range.max[0] == side {
            ranges.push(TileRange { min: [0, min[1]], max: [1, max[1]] });
        }
        let root = usize::from(zoom - self.zooms.start());
        for range in ranges {
            self.roots[root].add([0; 2], TouchedTiles::size(zoom), &range.intersect(within));
        }
    }

    pub(super) fn contains(&self, tile: TileId) -> bool {
        let (mut node, mut size) = (self.root(tile.zoom), TouchedTiles::size(tile.zoom));
        while matches!(node, Node::Quarters(_)) {
            node = node.below(tile.column, tile.row, size);
            size -= 1;
        }
        match node {
            Node::All => true,
            Node::Square(bits) => bits >> (8 * (tile.row & 7) + (tile.column & 7)) & 1 == 1,
            _ => false,
        }
    }

    /// Iterates over all tiles, in the order of their numbers.
    pub(super) fn iter(&self) -> impl Iterator<Item = TileId> + '_ {
        self.zooms.clone().flat_map(|zoom| ZoomTiles {
            zoom,
            pending: vec![(self.root(zoom), 0, 0)],
            run: 0..0,
            square: None,
        })
    }

    /// Number of tiles.
    pub(super) fn count(&self) -> u64 {
        fn count(node: &Node, size: u8) -> u64 {
            match node {
                Node::None => 0,
                Node::All => 1 << (2 * size),
                Node::Square(bits) => bits.count_ones().into(),
                Node::Quarters(quarters) => quarters.iter().map(|quarter| count(quarter, size - 1)).sum(),
            }
        }
        self.zooms.clone().zip(&self.roots).map(|(zoom, root)| count(root, TouchedTiles::size(zoom))).sum()
    }
}

/// The tiles of a zoom, along the Hilbert curve.
struct ZoomTiles<'a> {
    zoom: u8,
    /// Nodes still to be visited, the next one last: with the zoom at which the node is one tile,
    /// and its index along the curve there.
    pending: Vec<(&'a Node, u8, u64)>,
    /// Indices along the curve at the zoom itself.
    run: std::ops::Range<u64>,
    /// The square of the run, unless all of it is touched.
    square: Option<u64>,
}

impl Iterator for ZoomTiles<'_> {
    type Item = TileId;

    fn next(&mut self) -> Option<TileId> {
        loop {
            for along in self.run.by_ref() {
                let tile = TileId::on_curve(self.zoom, along);
                if self.square.is_none_or(|bits| bits >> (8 * (tile.row & 7) + (tile.column & 7)) & 1 == 1) {
                    return Some(tile);
                }
            }
            let (node, level, along) = self.pending.pop()?;
            let shift = 2 * (self.zoom - level);
            let run = along << shift..(along + 1) << shift;
            match node {
                Node::None => {}
                Node::All => (self.run, self.square) = (run, None),
                Node::Square(bits) => (self.run, self.square) = (run, Some(*bits)),
                Node::Quarters(quarters) => {
                    for step in (0..4).rev() {
                        let child = TileId::on_curve(level + 1, along << 2 | step);
                        let at = (child.column & 1) | (child.row & 1) << 1;
                        self.pending.push((&quarters[at as usize], level + 1, along << 2 | step));
                    }
                }
            }
        }
    }
}

/// Adds the tiles that blocks touch. Blocks must come in FD order. Blocks smaller than a fraction
/// of a tile are replaced by the ancestor of that size, whose tiles are queried once. So the cost
/// grows with tiles, not with blocks.
pub(super) struct TouchedBlocks<'a> {
    pub(super) tiles: TouchedTiles,
    source: &'a dyn TileSource,
    margin: usize,
    /// Per zoom: the range of possible tiles, and the last node.
    zooms: Vec<(u8, TileRange, Option<Code>)>,
}

impl<'a> TouchedBlocks<'a> {
    pub(super) fn new(
        source: &'a dyn TileSource,
        zooms: RangeInclusive<u8>,
        degrees: [f64; 4],
        margin: usize,
    ) -> TouchedBlocks<'a> {
        let of_zoom = |zoom| (zoom, TileRange::of_degrees(zoom, degrees), None);
        TouchedBlocks {
            tiles: TouchedTiles::none(zooms.clone()),
            source,
            margin,
            zooms: zooms.map(of_zoom).collect(),
        }
    }

    pub(super) fn add(&mut self, block: Code) {
        for (zoom, within, last) in &mut self.zooms {
            let node = block.ancestor(self.source.block_level(*zoom).min(block.level()));
            if *last != Some(node) {
                *last = Some(node);
                self.tiles.add(*zoom, self.source.tiles_of(node, *zoom), self.margin, within);
            }
        }
    }

    /// Adds all tiles.
    pub(super) fn add_all(&mut self) {
        for (zoom, within, _) in &self.zooms {
            self.tiles.add(*zoom, *within, 0, within);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use spinney_tiles::first_number;

    #[test]
    fn touched_tiles_equal_a_plain_set_and_are_sorted() {
        let mut state = 1u64;
        let mut random = |below: u32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 33) % u64::from(below)) as u32
        };
        for zooms in [0..=0, 0..=6, 2..=5, 7..=7] {
            for margin in [0, 1] {
                let mut tiles = TouchedTiles::none(zooms.clone());
                let mut plain = BTreeSet::new();
                for _ in 0..60 {
                    let zoom = zooms.start() + random(u32::from(zooms.end() - zooms.start()) + 1) as u8;
                    let side = 1u32 << zoom;
                    let min = [random(side), random(side)];
                    let max = min.map(|at| (at + 1 + random(side.min(9))).min(side));
                    let within = TileRange { min: [0; 2], max: [side, side - side / 4] };
                    tiles.add(zoom, TileRange { min, max }, margin, &within);
                    let more = margin as i64;
                    for row in i64::from(min[1]) - more..i64::from(max[1]) + more {
                        for column in i64::from(min[0]) - more..i64::from(max[0]) + more {
                            let column = column.rem_euclid(side.into()) as u32;
                            if (0..i64::from(within.max[1])).contains(&row) {
                                plain.insert(TileId { zoom, column, row: row as u32 }.number());
                            }
                        }
                    }
                }
                assert_eq!(
                    tiles.iter().map(TileId::number).collect::<Vec<_>>(),
                    plain.iter().copied().collect::<Vec<_>>(),
                    "{zooms:?} {margin}"
                );
                assert_eq!(tiles.count(), plain.len() as u64);
                for number in first_number(*zooms.start())..first_number(zooms.end() + 1) {
                    let tile = TileId::from_number(number).unwrap();
                    assert_eq!(tiles.contains(tile), plain.contains(&number), "{tile:?}");
                }
                // A full zoom is one node.
                let zoom = *zooms.end();
                let world = TileRange::world(zoom);
                tiles.add(zoom, world, 0, &world);
                assert!(matches!(tiles.root(zoom), Node::All) || zoom < SQUARE);
                assert_eq!(tiles.iter().filter(|tile| tile.zoom == zoom).count(), 1 << (2 * zoom));
            }
        }
    }
}
