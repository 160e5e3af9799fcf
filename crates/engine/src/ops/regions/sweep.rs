//! Scan of all cells of a view, block by block in FD order, which reports what touches across the
//! borders of blocks.

use super::border::{Borders, ComponentSpan, Face};
use super::local::{Local, Pair};
use crate::ops::affine::View;
use crate::query::{Filling, HALF};
use crate::tree::{Child, Source, no_children};
use spinney_base::space::{Code, Dimension};
use spinney_base::value::{Rule, Value};
use spinney_base::{Progress, Result, TreeType, parallel};

/// Levels below a block of a quadtree, and of an octree.
const BLOCK_LEVELS: [u8; 2] = [8, 6];

/// Minimum and maximum number of concurrent blocks.
const BATCH: [u64; 2] = [4, 64];

/// Approximate bytes per cell of a block in progress, in addition to its value.
const CELL_BYTES: u64 = 40;

/// Cells of a view, with the criterion for components.
#[derive(Clone)]
pub(super) struct Cells {
    pub(super) view: View,
    /// For solids, whose values store the fill level of cells: the criterion for full cells.
    pub(super) filling: Option<Filling>,
    /// Distance along the other axes at which a cell touches others: 0, or 1 to include edges and
    /// corners.
    pub(super) reach: u32,
    /// Levels below a block.
    pub(super) block_levels: u8,
}

/// Node whose cells are read together.
pub(super) struct Unit<'a> {
    pub(super) code: Code,
    pub(super) content: Content<'a>,
}

pub(super) enum Content<'a> {
    /// Cells of one value.
    Uniform(Value),
    /// Components of a block, and pairs of them that touch, if requested.
    Block(&'a Local, &'a [Pair]),
}

/// Receiver of units and of their borders.
pub(super) trait Sweeper {
    /// Receives the next unit in FD order; returns the numbers of its components.
    fn take(&mut self, unit: &Unit<'_>) -> Result<Vec<u64>>;

    /// Receives two runs of cells in different units that touch, and the number of cell faces that
    /// they share.
    fn meet(&mut self, a: &ComponentSpan, b: &ComponentSpan, faces: u64) -> Result<()>;
}

impl Cells {
    /// Cells that are compared by value.
    pub(super) fn values(view: View, reach: u32) -> Cells {
        let block_levels = BLOCK_LEVELS[usize::from(view.form().dimension == Dimension::Oct)];
        Cells { view, filling: None, reach, block_levels }
    }

    /// Cells of solids, as full or VOID: with [`Rule::Occupancy`], cells that are at least half
    /// full are full.
    pub(super) fn bodies(view: View, reach: u32) -> Cells {
        let rule = view.source().header().rule;
        let filling = (rule == Rule::Occupancy).then(|| Filling::of(rule, view.form().value));
        Cells { filling, ..Cells::values(view, reach) }
    }

    pub(super) fn form(&self) -> TreeType {
        self.view.form()
    }

    /// Level of blocks.
    pub(super) fn block_level(&self) -> u8 {
        self.view.depth().saturating_sub(self.block_levels)
    }

    /// Cells along an edge of a node.
    fn side(&self, code: Code) -> u32 {
        1 << (self.view.depth() - code.level())
    }

    /// Value that decides the component of a cell.
    fn seen(&self, value: Option<Value>) -> Option<Value> {
        match self.filling {
            None => value,
            Some(filling) => (filling.fill(value) >= HALF).then_some(full()),
        }
    }

    /// Components of a block.
    pub(super) fn local(&self, code: Code) -> Result<Local> {
        let (form, depth) = (self.form(), self.view.depth());
        let bounds = code.bounds(depth);
        let (cells, width) = (bounds.volume() as usize, form.width());
        let (mut values, mut valid) = (vec![0; cells * width], vec![false; cells]);
        self.view.draw_at(depth, &bounds, &mut values, &mut valid)?;
        if self.filling.is_some() {
            for (value, valid) in values.chunks_exact_mut(width).zip(&mut valid) {
                let seen = self.seen(valid.then(|| Value::from_bytes(value)));
                *valid = seen.is_some();
                full().write(value);
            }
        }
        Ok(Local::new(form.dimension, depth - code.level(), width, (&values, &valid), self.reach))
    }

    /// Passes all units that are not VOID to a sweeper, with the pairs of components that touch
    /// inside if requested.
    ///
    /// # Errors
    /// If the tree is corrupt, or on cancellation.
    pub(super) fn sweep(
        &self,
        with_pairs: bool,
        memory: u64,
        sweeper: &mut dyn Sweeper,
        progress: &dyn Progress,
    ) -> Result<()> {
        let form = self.form();
        let block_cells = form.dimension.cells(self.view.depth() - self.block_level());
        let each = block_cells * (form.width() as u64 + CELL_BYTES);
        let most = (memory / 8 / each).clamp(BATCH[0], BATCH[1]) as usize;
        let mut traversal = SweepTraversal { cells: self, with_pairs, stack: Vec::new(), sweeper, progress };
        let mut pending = vec![(Code::root(form.dimension), self.view.root()?)];
        let mut children = no_children();
        let (mut batch, mut blocks) = (Vec::new(), 0);
        while let Some((code, node)) = pending.pop() {
            match node {
                Child::Inner { node, .. } if code.level() < self.block_level() => {
                    self.view.children(&node, &mut children)?;
                    let below = children[..form.children()].iter_mut().enumerate().rev();
                    pending.extend(below.map(|(step, child)| (code.child(step), std::mem::take(child))));
                    continue;
                }
                Child::Inner { .. } if code.level() < self.view.depth() => {
                    blocks += 1;
                    batch.push((code, UnitNode::Block));
                }
                node => batch.push((code, UnitNode::Uniform(self.seen(node.value())))),
            }
            if blocks >= most || batch.len() >= 4096 {
                traversal.units(&std::mem::take(&mut batch))?;
                blocks = 0;
            }
        }
        traversal.units(&batch)?;
        self.view.check_unchanged()
    }
}

fn full() -> Value {
    Value::from([255u8])
}

/// Node that is not subdivided further.
enum UnitNode {
    Block,
    Uniform(Option<Value>),
}

/// Result of a block: its components, pairs of them, and its borders.
type BlockComponents = Option<(Local, Vec<Pair>, Borders)>;

struct SweepTraversal<'a> {
    cells: &'a Cells,
    with_pairs: bool,
    /// Nodes that wait for their siblings, in FD order.
    stack: Vec<(Code, Borders)>,
    sweeper: &'a mut dyn Sweeper,
    progress: &'a dyn Progress,
}

impl SweepTraversal<'_> {
    fn units(&mut self, batch: &[(Code, UnitNode)]) -> Result<()> {
        self.progress.check()?;
        let cells = self.cells;
        let with_pairs = self.with_pairs;
        let made = parallel::map(batch, |(code, found)| -> Result<BlockComponents> {
            let UnitNode::Block = found else { return Ok(None) };
            let local = cells.local(*code)?;
            let pairs = if with_pairs { local.pairs(cells.reach) } else { Vec::new() };
            let borders = local.borders();
            Ok(Some((local, pairs, borders)))
        });
        let dimension = cells.form().dimension;
        let total = dimension.cells(cells.view.depth());
        for ((code, found), made) in batch.iter().zip(made) {
            let borders = match (found, made?) {
                (_, Some((local, pairs, mut borders))) => {
                    let unit = Unit { code: *code, content: Content::Block(&local, &pairs) };
                    if !local.components.is_empty() {
                        borders.renumber(&self.sweeper.take(&unit)?);
                    }
                    borders
                }
                (UnitNode::Uniform(Some(value)), _) => {
                    let unit = Unit { code: *code, content: Content::Uniform(*value) };
                    let ids = self.sweeper.take(&unit)?;
                    Borders::uniform(dimension.axes(), cells.side(*code), ids[0], *value)
                }
                _ => Borders::default(),
            };
            self.push(*code, borders)?;
            self.progress.advance(dimension.cells(cells.view.depth() - code.level()), total);
        }
        Ok(())
    }

    /// Adds the borders of the next node, and joins nodes whose siblings are complete.
    fn push(&mut self, mut code: Code, mut borders: Borders) -> Result<()> {
        let children = self.cells.form().children();
        // There are no cells beyond the extent.
        let (bounds, extent) = (code.bounds(self.cells.view.depth()), self.cells.view.extent());
        for (axis, [low, high]) in borders.faces.iter_mut().enumerate() {
            if bounds.min[axis] == 0 {
                *low = Face::default();
            }
            if bounds.max[axis] >= extent[axis] {
                *high = Face::default();
            }
        }
        while let Some(parent) = code.parent() {
            if code.step(parent.level()) + 1 < children {
                break;
            }
            let mut siblings: Vec<Borders> =
                self.stack.drain(self.stack.len() + 1 - children..).map(|(_, borders)| borders).collect();
            siblings.push(borders);
            borders = self.merge(siblings, self.cells.side(code))?;
            code = parent;
        }
        self.stack.push((code, borders));
        Ok(())
    }

    /// Joins the children of a node, each with `side` cells along an edge.
    fn merge(&mut self, mut nodes: Vec<Borders>, side: u32) -> Result<Borders> {
        let mut result = Ok(());
        let (sweeper, reach) = (&mut *self.sweeper, self.cells.reach);
        for axis in 0..self.cells.form().axes() {
            let mut joined = Vec::with_capacity(nodes.len() / 2);
            let mut rest = nodes.into_iter();
            while let (Some(one), Some(other)) = (rest.next(), rest.next()) {
                joined.push(one.join(other, axis, side, reach, &mut |a, b, faces| {
                    if result.is_ok() {
                        result = sweeper.meet(a, b, faces);
                    }
                }));
            }
            nodes = joined;
        }
        result.map(|()| nodes.pop().unwrap_or_default())
    }
}
