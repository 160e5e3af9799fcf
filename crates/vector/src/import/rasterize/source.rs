//! The tree of shapes. Nodes that shapes cover entirely are uniform, nodes with edges are divided,
//! and cells are painted in blocks. In an octree, each shape covers columns of cells: all layers
//! are equal.

use std::sync::Arc;

use spinney_base::Result;
use spinney_base::space::{Bounds, Code, Dimension, EdgeRule};
use spinney_base::value::{Number, Value, ValueType};
use spinney_engine::ops::BlockSource;
use spinney_engine::tree::{CellBlock, Child};

use super::coverage::{Coverage, Shares};
use super::edge::Point;
use super::mask::{Mask, index_of};
use super::node_cache::NodeCache;
use super::shapes::{ClippedShape, ClippedShapes, ShapeKind, Shapes};

/// Rule for a cell's value from its shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    /// Value of the last shape.
    Top,
    /// Value with the largest share of the cell, where VOID counts as a value. Shapes of one value
    /// are consecutive.
    LargestShare,
    /// Share of the cell that shapes cover.
    Share,
    /// Sum of all values.
    Sum,
    /// Number of shapes; each point counts.
    Count,
    /// Mean of all values.
    Mean,
}

impl Paint {
    /// Returns whether only cell centres decide which cells a polygon covers.
    pub(super) fn needs_centres_alone(self, edge: EdgeRule) -> bool {
        edge == EdgeRule::Centre && !matches!(self, Paint::Share | Paint::LargestShare)
    }
}

/// Tree of shapes, whose cells are computed on request.
pub(super) struct ShapeTree {
    pub(super) shapes: Shapes,
    /// Values by value number.
    pub(super) values: Vec<Number>,
    pub(super) value_type: ValueType,
    /// Value of all covered cells, if it has several numbers.
    pub(super) fixed: Option<Value>,
    pub(super) paint: Paint,
    pub(super) edge: EdgeRule,
    /// Dimension of the tree.
    pub(super) dimension: Dimension,
    pub(super) extent: [u64; 3],
    pub(super) depth: u8,
    /// Cache of the parts of nodes.
    pub(super) node_cache: NodeCache,
}

/// Numbers of a block's cells during painting.
enum Painted {
    /// Value numbers, from 1; 0 is VOID.
    Tops(Vec<u32>),
    /// Sums and counts.
    Sums(Vec<f64>, Vec<u32>),
    /// Shares, which become 4-byte values.
    Shares(Vec<f64>),
}

impl ShapeTree {
    fn raster_bounds(&self) -> Bounds {
        Bounds::of_extent(self.extent)
    }

    fn value_of(&self, number: Number) -> Value {
        self.fixed.unwrap_or_else(|| self.value_type.nearest_numbers(|_| number))
    }

    /// Returns the value of cells that all of these shapes cover entirely; `None` is VOID.
    fn uniform(&self, parts: &[ClippedShape]) -> Option<Value> {
        let numbers = || parts.iter().map(|part| self.number(part));
        let sum = || numbers().map(Number::to_f64).sum::<f64>();
        let number = match self.paint {
            Paint::Share => Number::from(if parts.is_empty() { 0.0 } else { 1.0 }),
            _ if parts.is_empty() => return None,
            Paint::Top | Paint::LargestShare => numbers().next_back()?,
            Paint::Sum => sum().into(),
            Paint::Count => (parts.len() as u64).into(),
            Paint::Mean => (sum() / parts.len() as f64).into(),
        };
        Some(self.value_of(number))
    }

    fn value_number(&self, part: &ClippedShape) -> usize {
        self.shapes.shapes[part.shape as usize].value as usize
    }

    fn number(&self, part: &ClippedShape) -> Number {
        self.values[self.value_number(part)]
    }

    fn kind(&self, part: &ClippedShape) -> ShapeKind {
        self.shapes.shapes[part.shape as usize].kind
    }

    /// Returns the square of the plane below a node.
    fn square(&self, code: Code) -> Code {
        let [x, y, _] = code.cell();
        match self.dimension {
            Dimension::Quad => code,
            Dimension::Oct => Code::from_cell(Dimension::Quad, code.level(), [x, y, 0])
                .unwrap_or_else(|| unreachable!("quadtrees are deeper than octrees")),
        }
    }

    /// Returns the parts of a square, computed from those of its nearest cached ancestor.
    fn parts(&self, code: Code) -> Arc<ClippedShapes> {
        let (mut at, mut parts) = self.node_cache.nearest(code).unwrap_or_else(|| {
            let root = Code::root(Dimension::Quad);
            let parts = Arc::new(self.seen(self.shapes.root(&root.bounds(self.depth))));
            self.node_cache.insert(root, &parts);
            (root, parts)
        });
        while at.level() < code.level() {
            let codes = [0, 1, 2, 3].map(|step| at.child(step));
            let bounds = codes.map(|code| code.bounds(self.depth));
            let children = self.shapes.children(&parts, &at.bounds(self.depth), &bounds);
            let children = children.map(|parts| Arc::new(self.seen(parts)));
            codes.iter().zip(&children).for_each(|(code, parts)| self.node_cache.insert(*code, parts));
            let step = code.step(at.level());
            (at, parts) = (codes[step], children[step].clone());
        }
        parts
    }

    /// Drops hidden parts.
    fn seen(&self, parts: ClippedShapes) -> ClippedShapes {
        if self.paint == Paint::Top { parts.uncovered() } else { parts }
    }

    /// Paints the cells of a square with this number of levels below it.
    fn paint(&self, code: Code, parts: &ClippedShapes, levels: u8) -> CellBlock {
        let side = 1usize << levels;
        let bounds = code.bounds(self.depth);
        let cell = [bounds.min[0] as i64, bounds.min[1] as i64];
        let painted = match self.paint {
            Paint::Top => self.tops(parts, cell, side),
            Paint::LargestShare => self.largest_shares(parts, cell, side),
            Paint::Share => self.shares(parts, cell, side),
            Paint::Sum | Paint::Count | Paint::Mean => self.sums(parts, cell, side),
        };
        self.cells(&painted, &bounds, side)
    }

    fn tops(&self, parts: &ClippedShapes, cell: Point, side: usize) -> Painted {
        let (mut tops, mut mask) = (vec![0; side * side], Mask::new(side));
        for part in &parts.parts {
            let number = self.value_number(part) as u32 + 1;
            if part.is_whole() {
                tops.fill(number);
                continue;
            }
            self.shapes.mask(&mut mask, (parts, part), cell, self.edge);
            mask.each(|at| tops[at] = number);
        }
        Painted::Tops(tops)
    }

    fn sums(&self, parts: &ClippedShapes, cell: Point, side: usize) -> Painted {
        let (mut sums, mut counts) = (vec![0.0; side * side], vec![0; side * side]);
        let mut mask = Mask::new(side);
        for part in &parts.parts {
            let number = self.number(part).to_f64();
            let mut add = |at: usize| {
                sums[at] += number;
                counts[at] += 1;
            };
            if self.kind(part) == ShapeKind::Points {
                // Each point counts.
                let edges = self.shapes.edges_of(parts, part);
                edges.filter_map(|point| index_of(point.a, cell, side)).for_each(add);
                continue;
            }
            self.shapes.mask(&mut mask, (parts, part), cell, self.edge);
            mask.each(&mut add);
        }
        Painted::Sums(sums, counts)
    }

    /// Adds the shares of cells that a shape covers. Shapes without an area cover the cells that
    /// they touch entirely.
    fn add_shares(
        &self,
        (parts, part): (&ClippedShapes, &ClippedShape),
        cell: Point,
        (coverage, mask): (&mut Coverage, &mut Mask),
        shares: &mut Shares,
    ) {
        let edges = || self.shapes.edges_of(parts, part);
        let side = coverage.side();
        if part.is_whole() {
            shares.add(1.0, 0..side * side);
            (0..side).for_each(|row| coverage.touch(row, 0..side));
        } else if self.kind(part) == ShapeKind::Polygon {
            coverage.measure(edges(), cell, part.winding, shares);
        } else {
            self.shapes.mask(mask, (parts, part), cell, self.edge);
            mask.each(|at| {
                shares.add(1.0, at..at + 1);
                coverage.touch(at / side, at % side..at % side + 1);
            });
        }
    }

    fn shares(&self, parts: &ClippedShapes, cell: Point, side: usize) -> Painted {
        let mut shares = Shares::new(side * side);
        let (mut coverage, mut mask) = (Coverage::new(side), Mask::new(side));
        for part in &parts.parts {
            self.add_shares((parts, part), cell, (&mut coverage, &mut mask), &mut shares);
        }
        let mut several = vec![false; side * side];
        let share = |(at, several): (usize, &mut bool)| {
            let (share, count) = shares.take(at);
            *several = count > 1;
            share
        };
        let mut shares: Vec<f64> = several.iter_mut().enumerate().map(share).collect();
        self.shapes.each_cell(parts, cell, &several, &mut |at, parts, cell| {
            shares[at] = self.shapes.union_share(parts, cell, parts.parts.iter());
        });
        Painted::Shares(shares)
    }

    fn largest_shares(&self, parts: &ClippedShapes, cell: Point, side: usize) -> Painted {
        let (mut tops, mut best) = (vec![0; side * side], vec![0.0; side * side]);
        // The sum of the shares of all values, and whether any value has several polygons in a
        // cell.
        let mut all = vec![0.0; side * side];
        let mut several = vec![false; side * side];
        let mut shares = Shares::new(side * side);
        let (mut coverage, mut mask) = (Coverage::new(side), Mask::new(side));
        let same = |a: &ClippedShape, b: &ClippedShape| self.number(a) == self.number(b);
        for alike in parts.parts.chunk_by(same) {
            for part in alike {
                self.add_shares((parts, part), cell, (&mut coverage, &mut mask), &mut shares);
            }
            let number = self.value_number(&alike[0]) as u32 + 1;
            // With thousands of values, each covers few cells, so only changed cells are visited.
            for row in 0..side {
                for at in coverage.take_touched(row).map(|column| row * side + column) {
                    let (share, count) = shares.take(at);
                    all[at] += share;
                    several[at] |= count > 1;
                    if share > best[at] {
                        (tops[at], best[at]) = (number, share);
                    }
                }
            }
        }
        // Of two equal shares the lower value wins, and any value wins over VOID.
        for (((top, best), all), several) in tops.iter_mut().zip(best).zip(all).zip(&mut several) {
            if 1.0 - all > best {
                *top = 0;
            } else {
                // If values overlap, VOID is larger than the sum implies. This matters only if no
                // value covers half of the cell.
                *several |= best < 0.5 && all > best;
            }
        }
        self.shapes.each_cell(parts, cell, &several, &mut |at, parts, cell| {
            let (mut top, mut best) = (0, 0.0);
            for alike in parts.parts.chunk_by(same) {
                let share = self.shapes.union_share(parts, cell, alike.iter());
                if share > best {
                    (top, best) = (self.value_number(&alike[0]) as u32 + 1, share);
                }
            }
            // If the best share is at least half of the cell, VOID cannot be larger.
            let is_void = || 1.0 - self.shapes.union_share(parts, cell, parts.parts.iter()) > best;
            tops[at] = if best < 0.5 && is_void() { 0 } else { top };
        });
        Painted::Tops(tops)
    }

    /// Returns the values of cells; they are VOID outside the raster.
    fn cells(&self, painted: &Painted, bounds: &Bounds, side: usize) -> CellBlock {
        let width = self.value_type.size();
        let mut block = CellBlock::void(side * side, width);
        let inside = |axis: usize| (self.extent[axis].saturating_sub(bounds.min[axis]) as usize).min(side);
        let mut last = (0, [0; 16]);
        for row in 0..inside(1) {
            let columns = row * side..row * side + inside(0);
            // For long thin shapes, most rows of a block are empty.
            let is_empty = match painted {
                Painted::Tops(tops) => tops[columns.clone()].iter().all(|top| *top == 0),
                Painted::Sums(_, counts) => counts[columns.clone()].iter().all(|count| *count == 0),
                Painted::Shares(_) => false,
            };
            if is_empty {
                continue;
            }
            for at in columns {
                let value = &mut block.values[at * width..(at + 1) * width];
                match painted {
                    Painted::Tops(tops) if tops[at] == 0 => continue,
                    Painted::Tops(tops) => {
                        if tops[at] != last.0 {
                            last = (tops[at], self.value_of(self.values[tops[at] as usize - 1]).to_bytes());
                        }
                        value.copy_from_slice(&last.1[..width]);
                    }
                    Painted::Sums(_, counts) if counts[at] == 0 => continue,
                    Painted::Sums(sums, counts) => {
                        let number = match self.paint {
                            Paint::Count => counts[at].into(),
                            Paint::Mean => (sums[at] / f64::from(counts[at])).into(),
                            _ => sums[at].into(),
                        };
                        value.copy_from_slice(&self.value_of(number).to_bytes()[..width]);
                    }
                    Painted::Shares(shares) => value.copy_from_slice(&(shares[at] as f32).to_le_bytes()),
                }
                block.present[at] = true;
            }
        }
        block
    }
}

impl BlockSource for ShapeTree {
    fn node(&self, code: Code) -> Result<Child<Code>> {
        let cells = code.bounds(self.depth);
        if cells.intersect(&self.raster_bounds()).is_empty() {
            return Ok(Child::Void);
        }
        let square = self.square(code);
        let parts = self.parts(square);
        if parts.parts.iter().all(ClippedShape::is_whole) {
            let value = self.uniform(&parts.parts);
            if value.is_none() || self.raster_bounds().contains(&cells) {
                return Ok(Child::uniform(value));
            }
        }
        if code.level() == self.depth {
            let block = self.paint(square, &parts, 0);
            return Ok(Child::uniform(block.present[0].then(|| Value::from_bytes(&block.values))));
        }
        // The representative is never read: storing a tree recomputes representatives from the
        // cells.
        Ok(Child::Inner { representative: self.uniform(&parts.parts).unwrap_or_default(), node: code })
    }

    fn block(&self, code: Code) -> Result<CellBlock> {
        let (square, levels) = (self.square(code), self.depth - code.level());
        let layer = self.paint(square, &self.parts(square), levels);
        if self.dimension == Dimension::Quad {
            return Ok(layer);
        }
        let first = code.bounds(self.depth).min[2];
        let layers = self.extent[2].saturating_sub(first).min(1 << levels) as usize;
        let mut block =
            CellBlock { present: layer.present.repeat(layers), values: layer.values.repeat(layers) };
        block.present.resize(layer.present.len() << levels, false);
        block.values.resize(layer.values.len() << levels, 0);
        Ok(block)
    }
}
