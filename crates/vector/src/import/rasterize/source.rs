//! The tree of shapes: nodes that shapes have all of are uniform, what edges pass through is gone into, and cells are painted in blocks.

use std::sync::Arc;

use spinney_base::space::{Bounds, Code, Dimension, EdgeRule};
use spinney_base::value::{Number, Value, ValueType};
use spinney_base::{Form, Result};
use spinney_engine::store::builder::ReusableSource;
use spinney_engine::tree::{CellBlock, Child, Children, Source};

use super::coverage::Coverage;
use super::edge::Point;
use super::mask::{Mask, index_of};
use super::shapes::{Node, Part, Parts, ShapeKind, Shapes};

/// The way from the shapes over a cell to its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Paint {
    /// The value of the last one.
    Top,
    /// The value that has the largest share of the cell, VOID being one of them; shapes of a value stand together.
    LargestShare,
    /// The share of the cell that shapes have.
    Share,
    /// The sum of all values.
    Sum,
    /// The number of shapes, and of points.
    Count,
    /// The mean of all values.
    Mean,
}

/// Levels below the blocks whose cells are painted at a time.
const BLOCK_LEVELS: u8 = 8;

/// A tree of shapes, of which no cell is before somebody asks for it.
pub(super) struct ShapeTree {
    pub(super) shapes: Shapes,
    /// The value of each number.
    pub(super) values: Vec<Number>,
    pub(super) value_type: ValueType,
    pub(super) paint: Paint,
    pub(super) edge: EdgeRule,
    pub(super) extent: [u64; 3],
    pub(super) depth: u8,
}

/// Numbers of the cells of a block in the making.
enum Painted {
    /// Numbers of values, from 1; 0 is VOID.
    Tops(Vec<u32>),
    /// Sums and counts, of which values of 8 and 4 bytes are made.
    Sums(Vec<f64>, Vec<u32>),
    /// Shares, of which values of 4 bytes are made.
    Shares(Vec<f64>),
}

impl ShapeTree {
    fn picture(&self) -> Bounds {
        Bounds::picture(self.extent)
    }

    fn value_of(&self, number: Number) -> Value {
        self.value_type.nearest_numbers(|_| number)
    }

    /// The value of the cells that all of some shapes have wholly; `None` is VOID.
    fn uniform(&self, parts: &[Part]) -> Option<Value> {
        let numbers = || parts.iter().map(|part| self.values[self.value_number(part)]);
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

    fn value_number(&self, part: &Part) -> usize {
        self.shapes.shapes[part.shape as usize].value as usize
    }

    fn kind(&self, part: &Part) -> ShapeKind {
        self.shapes.shapes[part.shape as usize].kind
    }

    /// A node with what it has of the shapes.
    fn node(&self, code: Code, parts: Parts) -> Child<Node> {
        let cells = code.bounds(self.depth);
        if cells.intersect(&self.picture()).is_empty() {
            return Child::Void;
        }
        let parts = match self.paint {
            Paint::Top => parts.uncovered(),
            _ => parts,
        };
        if parts.parts.iter().all(Part::is_whole) {
            let value = self.uniform(&parts.parts);
            if value.is_none() || self.picture().contains(&cells) {
                return Child::uniform(value);
            }
        }
        if code.level() == self.depth {
            let block = self.paint(code, &parts, 0);
            return Child::uniform(block.present[0].then(|| Value::from_bytes(&block.values)));
        }
        // (What stands for a node before its cells are known is looked at by nobody: whoever stores a tree averages anew.)
        let representative = self.uniform(&parts.parts).unwrap_or_default();
        Child::Inner { representative, node: Node { code, parts: Arc::new(parts) } }
    }

    /// The cells of a node with so many levels below it.
    fn paint(&self, code: Code, parts: &Parts, levels: u8) -> CellBlock {
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

    /// The cells that a shape has by the rule for edges.
    fn mask(&self, mask: &mut Mask, parts: &Parts, part: &Part, cell: Point) {
        let edges = || self.shapes.edges_of(parts, part);
        match self.kind(part) {
            ShapeKind::Polygon if part.is_whole() => mask.fill(true),
            ShapeKind::Polygon => {
                mask.centres(edges(), cell, part.is_inside());
                if self.edge == EdgeRule::Touch {
                    mask.touch(edges(), cell, false);
                }
            }
            ShapeKind::Line => {
                mask.fill(false);
                mask.touch(edges(), cell, true);
            }
            ShapeKind::Points => {
                mask.fill(false);
                mask.points(edges(), cell);
            }
        }
    }

    fn tops(&self, parts: &Parts, cell: Point, side: usize) -> Painted {
        let (mut tops, mut mask) = (vec![0; side * side], Mask::new(side));
        for part in &parts.parts {
            let number = self.value_number(part) as u32 + 1;
            if part.is_whole() {
                tops.fill(number);
                continue;
            }
            self.mask(&mut mask, parts, part, cell);
            mask.each(|at| tops[at] = number);
        }
        Painted::Tops(tops)
    }

    fn sums(&self, parts: &Parts, cell: Point, side: usize) -> Painted {
        let (mut sums, mut counts) = (vec![0.0; side * side], vec![0; side * side]);
        let mut mask = Mask::new(side);
        for part in &parts.parts {
            let number = self.values[self.value_number(part)].to_f64();
            let mut add = |at: usize| {
                sums[at] += number;
                counts[at] += 1;
            };
            if self.kind(part) == ShapeKind::Points {
                // (Each of them counts.)
                let edges = self.shapes.edges_of(parts, part);
                edges.filter_map(|point| index_of(point.a, cell, side)).for_each(add);
                continue;
            }
            self.mask(&mut mask, parts, part, cell);
            mask.each(&mut add);
        }
        Painted::Sums(sums, counts)
    }

    /// Adds a shape's shares of cells: of what has no area the cells that it touches.
    fn add_shares(
        &self,
        (parts, part): (&Parts, &Part),
        cell: Point,
        (coverage, mask): (&mut Coverage, &mut Mask),
        shares: &mut [f64],
    ) {
        let edges = || self.shapes.edges_of(parts, part);
        if part.is_whole() {
            shares.iter_mut().for_each(|share| *share += 1.0);
        } else if self.kind(part) == ShapeKind::Polygon {
            coverage.measure(edges(), cell, part.winding, shares);
        } else {
            self.mask(mask, parts, part, cell);
            mask.each(|at| shares[at] += 1.0);
        }
    }

    fn shares(&self, parts: &Parts, cell: Point, side: usize) -> Painted {
        let mut shares = vec![0.0; side * side];
        let (mut coverage, mut mask) = (Coverage::new(side), Mask::new(side));
        for part in &parts.parts {
            self.add_shares((parts, part), cell, (&mut coverage, &mut mask), &mut shares);
        }
        Painted::Shares(shares)
    }

    fn largest_shares(&self, parts: &Parts, cell: Point, side: usize) -> Painted {
        let (mut tops, mut best) = (vec![0; side * side], vec![0.0; side * side]);
        let (mut shares, mut all) = (vec![0.0; side * side], vec![0.0; side * side]);
        let (mut coverage, mut mask) = (Coverage::new(side), Mask::new(side));
        let same =
            |a: &Part, b: &Part| self.values[self.value_number(a)] == self.values[self.value_number(b)];
        for alike in parts.parts.chunk_by(same) {
            shares.fill(0.0);
            for part in alike {
                self.add_shares((parts, part), cell, (&mut coverage, &mut mask), &mut shares);
            }
            let number = self.value_number(&alike[0]) as u32 + 1;
            for (((top, best), share), all) in tops.iter_mut().zip(&mut best).zip(&shares).zip(&mut all) {
                let share: f64 = share.min(1.0);
                *all += share;
                if share > *best {
                    (*top, *best) = (number, share);
                }
            }
        }
        // (Of two that are as large the one with the lesser value stays, and both before nothing.)
        for ((top, best), all) in tops.iter_mut().zip(best).zip(all) {
            if 1.0 - all > best {
                *top = 0;
            }
        }
        Painted::Tops(tops)
    }

    /// The values of cells, which are VOID outside the picture.
    fn cells(&self, painted: &Painted, bounds: &Bounds, side: usize) -> CellBlock {
        let width = self.value_type.size();
        let mut block = CellBlock::void(side * side, width);
        let inside = |axis: usize| (self.extent[axis].saturating_sub(bounds.min[axis]) as usize).min(side);
        let mut last = (0, [0; 16]);
        for row in 0..inside(1) {
            for at in row * side..row * side + inside(0) {
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
                    Painted::Sums(sums, counts) => match self.paint {
                        Paint::Count => value.copy_from_slice(&counts[at].to_le_bytes()),
                        Paint::Mean => {
                            value.copy_from_slice(&(sums[at] / f64::from(counts[at])).to_le_bytes())
                        }
                        _ => value.copy_from_slice(&sums[at].to_le_bytes()),
                    },
                    Painted::Shares(shares) => {
                        value.copy_from_slice(&(shares[at].min(1.0) as f32).to_le_bytes())
                    }
                }
                block.present[at] = true;
            }
        }
        block
    }
}

impl Source for ShapeTree {
    type Node = Node;

    fn form(&self) -> Form {
        Form::new(Dimension::Quad, self.value_type)
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<Node>> {
        let root = Code::root(Dimension::Quad);
        Ok(self.node(root, self.shapes.root(&root.bounds(self.depth))))
    }

    fn children(&self, node: &Node, children: &mut Children<Node>) -> Result<()> {
        let codes = [0, 1, 2, 3].map(|step| node.code.child(step));
        let bounds = codes.map(|code| code.bounds(self.depth));
        let parts = self.shapes.children(&node.parts, &node.code.bounds(self.depth), &bounds);
        for ((child, code), parts) in children.iter_mut().zip(codes).zip(parts) {
            *child = self.node(code, parts);
        }
        Ok(())
    }

    fn cells(&self, node: &Node, levels: u8) -> Result<Option<CellBlock>> {
        let is_block = levels <= BLOCK_LEVELS && node.code.level() + levels == self.depth;
        Ok(is_block.then(|| self.paint(node.code, &node.parts, levels)))
    }
}

impl ReusableSource for ShapeTree {}
