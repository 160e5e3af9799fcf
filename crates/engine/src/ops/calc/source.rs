//! Tree of a calculation's results.

use super::calculation::Calculation;
use super::composite;
use super::kernel::{Machine, settle, store, value_of};
use super::operands::{Operands, resolve};
use crate::ops::affine::View;
use crate::ops::blocks::{Block, Blocks, block_levels};
use crate::ops::view_source::ViewSource;
use crate::tree::{CellBlock, Child, Children, Source, no_children};
use spinney_base::TreeType;
use spinney_base::space::{Bounds, Code, Dimension};
use spinney_base::value::{DataKind, Rule, SampleType, Value, ValueType};
use spinney_base::{Progress, Result};
use spinney_container::{Codec, Header, Metadata, Shape};

/// Tree whose cells are computed from those of other trees on its grid, on request.
///
/// A node is settled without its cells if its operands' nodes determine its value. Otherwise blocks
/// of cells are read as rows, and computed strip by strip in f64. A level above the cells is
/// computed from its operands' values at that level, which differs from the mean of the cells'
/// results: see [`Dataset::is_approximate`](crate::dataset::Dataset::is_approximate). Memory: some
/// megabytes of samples for each concurrent request, and a cache of sixteen blocks for traversals
/// by node.
pub struct Calculated {
    operands: Operands,
    header: Header,
    metadata: Metadata,
    remarks: Vec<String>,
    /// Whether channels are unchanged channels of layers.
    is_composite: bool,
    blocks: Blocks,
}

/// Approximate bytes of samples that are read at a time.
const MAX_PAINT_BYTES: u64 = 2 << 20;
/// Maximum and minimum number of cells that are read at a time, regardless of their size.
const PAINT_CELLS: [u64; 2] = [1 << 16, 1 << 10];
/// Returns the number of levels below the blocks that are returned as cells: those that files are
/// built from.
fn max_levels(dimension: Dimension) -> u8 {
    match dimension {
        Dimension::Quad => 8,
        Dimension::Oct => 6,
    }
}

impl Calculated {
    /// Tree of a calculation applied to a view.
    ///
    /// # Errors
    /// If a name cannot be resolved, or a file cannot be read or aligned.
    pub(super) fn new(calculation: &Calculation, view: &View) -> Result<Calculated> {
        let operands = resolve(calculation, view)?;
        let first = &operands.trees[0];
        let source = first.source();
        let is_composite = calculation.is_composite();
        let (value, kind, rule) = match is_composite {
            true => composite::values(&operands)?,
            false => one_channel(calculation.sample, &operands),
        };
        let header = Header {
            form: TreeType::new(first.form().dimension, value),
            rule,
            kind,
            codec: Codec::Plain,
            shape: Shape { depth: first.depth(), ..source.header().shape },
            extent: first.extent(),
        };
        let own = first.metadata(false);
        let remarks = if is_composite { Vec::new() } else { left_out(&own) };
        let mut provenance = own.provenance;
        provenance.push(calculation.to_string());
        // Descriptions of the operands' values do not apply to the results.
        let mut metadata = Metadata {
            frame: own.frame,
            control_points: own.control_points,
            tags: own.tags,
            provenance,
            ..Metadata::default()
        };
        if is_composite {
            composite::describe(&operands, value, &mut metadata);
        }
        Ok(Calculated { operands, header, metadata, remarks, is_composite, blocks: Blocks::default() })
    }

    /// Whether levels above the cells are computed from the operands' values at these levels,
    /// instead of from the cells' results. False for composites, which copy channels.
    pub(in crate::ops) fn is_approximate(&self) -> bool {
        !self.is_composite
    }

    /// Source that the calculation is applied to.
    pub fn source(&self) -> &ViewSource {
        self.operands.trees[0].source()
    }

    /// Header that a file of the tree would have.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Metadata that a file of the tree would have: georeferencing of the source, without colours
    /// and class names.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// Warnings about properties of the source that the results do not have.
    pub(in crate::ops) fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// Reports the warnings about the operands' files to `progress`.
    pub(in crate::ops) fn warn_of_remarks(&self, progress: &dyn Progress) {
        self.operands.trees.iter().for_each(|tree| tree.source().report_remark(progress));
    }

    /// Number of cells in the source that are not VOID.
    pub(in crate::ops) fn cells_before(&self) -> Result<u64> {
        self.source().cells_before()
    }

    fn block_level(&self) -> u8 {
        self.header.depth().saturating_sub(block_levels(self.header.form.dimension))
    }

    /// Reads a box of cells of a level inside the tree's space, as [`Source::draw`] does, from the
    /// operands' values at that level.
    ///
    /// # Errors
    /// If a tree is corrupt there.
    pub(in crate::ops) fn draw_at(
        &self,
        level: u8,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        valid.fill(false);
        let above = self.header.depth() - level;
        let extent = Bounds::of_extent(self.header.extent.map(|cells| cells.div_ceil(1 << above)));
        let inside = bounds.intersect(&extent);
        if inside.is_empty() {
            return Ok(());
        }
        let each: u64 = self.operands.read().map(|tree| tree.form().width() as u64 + 1).sum();
        let most = (MAX_PAINT_BYTES / each.max(1)).clamp(PAINT_CELLS[1], PAINT_CELLS[0]);
        let mut painter = Painter {
            operands: &self.operands,
            value: self.header.form.value,
            machine: Machine::new(&self.operands.expressions, self.operands.operands.len(), inside.volume()),
            read: self.operands.trees.iter().map(|_| (Vec::new(), Vec::new())).collect(),
            level,
            bounds,
            values,
            valid,
        };
        let mut pending = vec![inside];
        while let Some(part_bounds) = pending.pop() {
            if part_bounds.volume() <= most {
                painter.paint(&part_bounds)?;
            } else {
                pending.extend(halves(&part_bounds));
            }
        }
        Ok(())
    }

    /// Numbers of the operands at a node, where they are known: in uniform nodes, including VOID
    /// ones.
    fn known(&self, code: Code) -> Result<Vec<Option<f64>>> {
        let uniform = |(number, tree): (usize, &View)| match self.operands.is_read(number) {
            true => uniform(tree, code),
            false => Ok(None),
        };
        let nodes: Result<Vec<Option<Option<Value>>>> =
            self.operands.trees.iter().enumerate().map(uniform).collect();
        let nodes = nodes?;
        let number = |operand: usize| {
            let (value_type, channel) = self.operands.channel(operand);
            let value = nodes[self.operands.operands[operand].tree]?;
            let value = value.filter(|value| value_type.present(*value)[channel]);
            let (factor, summand) = self.operands.scales[operand];
            Some(value.map_or(f64::NAN, |value| value_type.samples(value)[channel] * factor + summand))
        };
        Ok((0..self.operands.operands.len()).map(number).collect())
    }

    /// Node at the block level, or above it. INNER nodes get the given representative.
    fn node(&self, code: Code, representative: Value) -> Result<Child<Code>> {
        let (cells, extent) = (code.bounds(self.header.depth()), self.header.extent_bounds());
        if cells.intersect(&extent).is_empty() {
            return Ok(Child::Void);
        }
        let known = self.known(code)?;
        let settled = self.operands.expressions.iter().map(|expression| settle(expression, &known));
        let value =
            settled.collect::<Option<Vec<f64>>>().map(|numbers| value_of(self.header.form.value, &numbers));
        match value {
            Some(None) => Ok(Child::Void),
            // (Beyond the extent all cells are VOID.)
            Some(value) if extent.contains(&cells) => Ok(Child::uniform(value)),
            _ => Ok(Child::Inner { representative, node: code }),
        }
    }
}

/// Type, kind and rule of calculated values of one channel.
fn one_channel(sample: Option<SampleType>, operands: &Operands) -> (ValueType, DataKind, Rule) {
    let sample = sample.unwrap_or(SampleType::F32);
    // Integers that are calculated from classes only are classes.
    let is_class = |view: &View| view.source().header().kind == DataKind::Categorical;
    let is_classes = !sample.is_float() && operands.read().next().is_some() && operands.read().all(is_class);
    let kind = if is_classes { DataKind::Categorical } else { DataKind::Continuous };
    let rule = match operands.trees[0].source().header().rule {
        rule @ (Rule::Min | Rule::Max | Rule::Nearest) if !is_classes => rule,
        _ => kind.default_rule(),
    };
    (ValueType::new(sample, 1), kind, rule)
}

/// Properties of a tree that its cells' results do not have.
fn left_out(metadata: &Metadata) -> Vec<String> {
    let parts = [
        ("colours", metadata.palette.is_some()),
        ("class names", !metadata.class_names.is_empty()),
        ("units", metadata.units.iter().any(|unit| !unit.is_empty())),
    ];
    let left: Vec<&str> = parts.into_iter().filter(|(_, is_there)| *is_there).map(|(what, _)| what).collect();
    if left.is_empty() {
        return Vec::new();
    }
    vec![format!("the result has no {}: they describe the values that are calculated with", left.join(", "))]
}

/// Value of all cells of a node (`None` is VOID), if its own state or that of an ancestor
/// determines it.
fn uniform(tree: &View, code: Code) -> Result<Option<Option<Value>>> {
    let (mut child, mut children) = (tree.root()?, no_children());
    for level in 0..code.level() {
        let Child::Inner { node, .. } = &child else { break };
        tree.children(node, &mut children)?;
        child = std::mem::take(&mut children[code.step(level)]);
    }
    Ok(match child {
        Child::Void => Some(None),
        Child::Leaf(value) => Some(Some(value)),
        Child::Inner { .. } => None,
    })
}

/// Halves of a box along its longest axis, cut at the border of the largest possible nodes.
fn halves(bounds: &Bounds) -> [Bounds; 2] {
    let size = bounds.size();
    let axis = (0..3).max_by_key(|axis| size[*axis]).unwrap_or(0);
    let (first, last) = (bounds.min[axis], bounds.max[axis] - 1);
    let middle = last >> (first ^ last).ilog2() << (first ^ last).ilog2();
    let (mut low, mut high) = (*bounds, *bounds);
    (low.max[axis], high.min[axis]) = (middle, middle);
    [high, low]
}

/// Computes the cells of a box, one sub-box at a time.
struct Painter<'a> {
    operands: &'a Operands,
    value: ValueType,
    machine: Machine<'a>,
    /// Values of each tree in the sub-box, and which of them are valid.
    read: Vec<(Vec<u8>, Vec<bool>)>,
    level: u8,
    bounds: &'a Bounds,
    values: &'a mut [u8],
    valid: &'a mut [bool],
}

impl Painter<'_> {
    fn paint(&mut self, part_bounds: &Bounds) -> Result<()> {
        let cells = part_bounds.volume() as usize;
        for (number, (bytes, valid)) in self.read.iter_mut().enumerate() {
            if !self.operands.is_read(number) {
                continue;
            }
            let tree = &self.operands.trees[number];
            bytes.resize(cells * tree.form().width(), 0);
            valid.resize(cells, false);
            tree.draw_at(self.level, part_bounds, bytes, valid)?;
        }
        let [width, height, _] = part_bounds.size().map(|cells| cells as usize);
        let [columns, rows, _] = self.bounds.size().map(|cells| cells as usize);
        let [x, y, z] = [0, 1, 2].map(|axis| (part_bounds.min[axis] - self.bounds.min[axis]) as usize);
        // Cells of the box are contiguous if the sub-box has whole rows (and layers); else a run is
        // a row.
        let is_one_run = width == columns && (height == rows || part_bounds.size()[2] == 1);
        let run = if is_one_run { cells } else { width };
        for first in (0..cells).step_by(run) {
            let (row, layer) = (first / width % height, first / width / height);
            let to = ((z + layer) * rows + y + row) * columns + x;
            for start in (0..run).step_by(self.machine.length()) {
                let count = self.machine.length().min(run - start);
                self.strip(first + start, to + start, count);
            }
        }
        Ok(())
    }

    /// Computes `count` cells of the sub-box from index `from`, and stores them in the box from
    /// index `to`.
    fn strip(&mut self, from: usize, to: usize, count: usize) {
        for operand in 0..self.operands.operands.len() {
            let channel = self.operands.channel(operand);
            let (bytes, valid) = &self.read[self.operands.operands[operand].tree];
            let width = channel.0.size();
            let bytes = &bytes[from * width..(from + count) * width];
            let scale = self.operands.scales[operand];
            self.machine.load(operand, (channel, scale), bytes, &valid[from..from + count]);
        }
        let size = self.value.size();
        let values = &mut self.values[to * size..(to + count) * size];
        for channel in 0..self.operands.expressions.len() {
            let numbers = self.machine.run(channel, count);
            store((self.value, channel), numbers, values, &mut self.valid[to..to + count]);
        }
    }
}

impl Source for Calculated {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<Code>> {
        let root = Code::root(self.header.form.dimension);
        let bounds = Bounds { min: [0; 3], max: [1; 3] };
        let mut value = vec![0; self.header.form.width()];
        let mut valid = [false];
        self.draw_at(0, &bounds, &mut value, &mut valid)?;
        let value = valid[0].then(|| Value::from_bytes(&value));
        if self.header.depth() == 0 {
            return Ok(Child::uniform(value));
        }
        self.node(root, value.unwrap_or_default())
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        if node.level() >= self.block_level() {
            let (form, depth) = (self.header.form, self.header.depth());
            return self.blocks.children((depth, self.block_level()), *node, children, &|code| {
                Block::new(form, (code, depth - code.level()), &mut |above, bounds, values, valid| {
                    self.draw_at(depth - above, bounds, values, valid)
                })
            });
        }
        let form = self.header.form;
        let cell = node.cell().map(|cell| 2 * u64::from(cell));
        let end = |axis: usize| if axis < form.axes() { cell[axis] + 2 } else { 1 };
        let bounds = Bounds { min: cell, max: std::array::from_fn(end) };
        let (mut values, mut valid) = ([0; 8 * 16], [false; 8]);
        let (values, valid) = (&mut values[..form.children() * form.width()], &mut valid[..form.children()]);
        self.draw_at(node.level() + 1, &bounds, values, valid)?;
        for (step, child) in children[..form.children()].iter_mut().enumerate() {
            let value = Value::from_bytes(&values[step * form.width()..(step + 1) * form.width()]);
            *child = self.node(node.child(step), if valid[step] { value } else { Value::ZERO })?;
        }
        Ok(())
    }

    fn cells(&self, node: &Code, levels: u8) -> Result<Option<CellBlock>> {
        if levels > max_levels(self.header.form.dimension) {
            return Ok(None);
        }
        let bounds = node.bounds(self.header.depth());
        let mut block = CellBlock::void(bounds.volume() as usize, self.header.form.width());
        self.draw_at(self.header.depth(), &bounds, &mut block.values, &mut block.present)?;
        Ok(Some(block))
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        self.draw_at(self.header.depth(), bounds, values, valid)?;
        Ok(true)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.operands.trees.iter().try_for_each(View::check_unchanged)
    }
}
