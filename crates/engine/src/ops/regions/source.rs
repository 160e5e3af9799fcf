//! Trees of `components=` and `sieve=`. Blocks are read again on request.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use super::connectivity::{Connectivity, Sieve};
use super::labels::Labels;
use super::pattern::Pattern;
use super::sieve::Sieved;
use super::sweep::Cells;
use super::units::{UnitState, Units};
use crate::ops::affine::View;
use crate::ops::view_source::ViewSource;
use crate::tree::{CellBlock, Child, Children, Source};
use spinney_base::space::{Bounds, Code};
use spinney_base::value::{DataKind, Rule, SampleType, Value, ValueType};
use spinney_base::{Progress, Result, TreeType};
use spinney_container::{Codec, Header, Metadata, Shape};

/// Number of cached blocks, for traversals by node.
const MAX_CACHED: usize = 16;

/// Maximum number of labels that are u32; otherwise labels are u64. (The maximum of u32 is left
/// free.)
const MAX_NARROW: u64 = u32::MAX as u64 - 1;

/// Memory and progress of operations that scan all cells before the first result is available.
#[derive(Clone, Copy)]
pub(in crate::ops) struct ScanContext<'a> {
    /// Approximate memory limit in bytes.
    pub(in crate::ops) memory: u64,
    /// Directory for temporary files.
    pub(in crate::ops) directory: &'a Path,
    pub(in crate::ops) progress: &'a dyn Progress,
}

/// Values of the components.
enum ComponentValues {
    Labels(Labels),
    Sieved(Sieved),
}

/// Components of cells of equal value: their labels, or the tree without the small ones.
pub struct Regions {
    cells: Cells,
    made: ComponentValues,
    header: Header,
    metadata: Metadata,
    kept: Mutex<Vec<(Code, Arc<CellBlock>)>>,
}

impl Regions {
    /// Labels of the components of a view's cells, numbered by their first cells in FD order. In
    /// solids by occupancy, cells that are at least half full are connected.
    ///
    /// # Errors
    /// If the connectivity does not exist for this dimension, the tree is corrupt, a temporary file
    /// cannot be used, or on cancellation.
    pub(in crate::ops) fn components(
        view: &View,
        connect: Connectivity,
        passes: &ScanContext<'_>,
    ) -> Result<Regions> {
        let cells = Cells::bodies(view.clone(), connect.reach(view.form().dimension)?);
        Regions::labelled(cells, MAX_NARROW, passes)
    }

    /// Labels of some cells, as u64 if there are more than `most_narrow` of them.
    pub(super) fn labelled(cells: Cells, most_narrow: u64, passes: &ScanContext<'_>) -> Result<Regions> {
        let view = &cells.view;
        let labels =
            Labels::of(&cells, passes.memory / 4, (passes.directory, passes.memory), passes.progress)?;
        let sample = if labels.count > most_narrow { SampleType::U64 } else { SampleType::U32 };
        let own = view.metadata(false);
        let metadata = Metadata {
            frame: own.frame,
            control_points: own.control_points,
            tags: own.tags,
            name: own.name,
            provenance: own.provenance,
            ..Metadata::default()
        };
        let header = Header {
            form: TreeType::new(view.form().dimension, ValueType::new(sample, 1)),
            rule: Rule::Nearest,
            kind: DataKind::Categorical,
            ..header_of(view)
        };
        Ok(Regions { cells, made: ComponentValues::Labels(labels), header, metadata, kept: Mutex::default() })
    }

    /// A view's cells, in which small components have the values of their largest neighbours.
    ///
    /// # Errors
    /// Those of [`Regions::components`]; also if the components do not fit in memory.
    pub(in crate::ops) fn sieved(view: &View, sieve: &Sieve, passes: &ScanContext<'_>) -> Result<Regions> {
        let dimension = view.form().dimension;
        let cells = Cells::values(view.clone(), sieve.reach(dimension)?);
        let least = sieve.cells(dimension, &view.frame(false))?;
        Regions::sieved_cells(cells, least, passes)
    }

    /// Cells with components of fewer cells than `least` merged.
    pub(super) fn sieved_cells(cells: Cells, least: u64, passes: &ScanContext<'_>) -> Result<Regions> {
        let sieved = Sieved::of(&cells, least, passes.memory, passes.progress)?;
        let (metadata, header) = (cells.view.metadata(false), header_of(&cells.view));
        Ok(Regions { cells, made: ComponentValues::Sieved(sieved), header, metadata, kept: Mutex::default() })
    }

    /// Tree whose components these are.
    pub fn source(&self) -> &ViewSource {
        self.cells.view.source()
    }

    /// Header that a file of the tree would have.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// Metadata that a file of the tree would have.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn units(&self) -> &Units {
        match &self.made {
            ComponentValues::Labels(labels) => &labels.units,
            ComponentValues::Sieved(sieved) => &sieved.units,
        }
    }

    /// A label as the value of cells.
    fn label(&self, label: u64) -> Value {
        match self.header.form.value.sample {
            SampleType::U32 => Value::from([label as u32]),
            _ => Value::from([label]),
        }
    }

    /// Value of a uniform node, given by its index.
    fn value(&self, number: usize) -> Value {
        match &self.made {
            ComponentValues::Labels(labels) => self.label(labels.of_uniform(number)),
            ComponentValues::Sieved(sieved) => sieved.value(number, 0),
        }
    }

    /// Values of the components of a block, given by its index.
    fn values(&self, number: usize, is_at_border: &[bool]) -> Result<Vec<Value>> {
        Ok(match &self.made {
            ComponentValues::Labels(labels) => {
                let labels = labels.of_block(number, is_at_border.iter().copied())?;
                labels.into_iter().map(|label| self.label(label)).collect()
            }
            ComponentValues::Sieved(sieved) => sieved.values(number, is_at_border.len()),
        })
    }

    /// Cells of a block, given by its index.
    fn block(&self, code: Code, number: usize) -> Result<CellBlock> {
        let made;
        let pattern = match self.units().pattern(number) {
            Some(pattern) => pattern,
            None => {
                made = Pattern::new(&self.cells.local(code)?);
                &made
            }
        };
        let values = self.values(number, pattern.at_border())?;
        let width = self.header.form.width();
        let mut block = CellBlock::void(code.bounds(self.header.depth()).volume() as usize, width);
        match width {
            1 => fill::<1>(&mut block, pattern, &values),
            2 => fill::<2>(&mut block, pattern, &values),
            3 => fill::<3>(&mut block, pattern, &values),
            4 => fill::<4>(&mut block, pattern, &values),
            6 => fill::<6>(&mut block, pattern, &values),
            8 => fill::<8>(&mut block, pattern, &values),
            12 => fill::<12>(&mut block, pattern, &values),
            _ => fill::<16>(&mut block, pattern, &values),
        }
        Ok(block)
    }

    fn kept_block(&self, code: Code, number: usize) -> Result<Arc<CellBlock>> {
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, block)) = lock().iter().find(|(other, _)| *other == code) {
            return Ok(block.clone());
        }
        // (Without the lock: other threads continue, and in the worst case two compute the same
        // block.)
        let block = Arc::new(self.block(code, number)?);
        let mut kept = lock();
        if kept.len() >= MAX_CACHED {
            kept.remove(0);
        }
        kept.push((code, block.clone()));
        Ok(block)
    }

    /// Node. Nodes above blocks are INNER if they contain any unit.
    fn node(&self, code: Code) -> Result<Child<Code>> {
        let inner = Child::Inner { representative: Value::ZERO, node: code };
        match self.units().at(code) {
            UnitState::Void => Ok(Child::Void),
            UnitState::Uniform(number) => Ok(Child::Leaf(self.value(number))),
            UnitState::Above => Ok(inner),
            UnitState::Block(number) => {
                let (level, depth) = (self.cells.block_level(), self.header.depth());
                let block = code.ancestor(level);
                let cells = self.kept_block(block, number)?;
                let bounds = code.bounds(depth).within(&block.bounds(depth));
                Ok(node_of(&cells, &bounds, 1 << (depth - level), self.header.form.width(), code))
            }
        }
    }

    /// Draws a box of cells inside the tree's space as [`Source::draw`] does.
    ///
    /// # Errors
    /// If the tree is corrupt there.
    pub(in crate::ops) fn draw_cells(
        &self,
        bounds: &Bounds,
        values: &mut [u8],
        valid: &mut [bool],
    ) -> Result<()> {
        valid.fill(false);
        let (level, depth, form) = (self.cells.block_level(), self.header.depth(), self.header.form);
        let height = depth - level;
        let inside = bounds.intersect(&Bounds::of_extent(self.header.extent));
        if inside.is_empty() {
            return Ok(());
        }
        let blocks = |axis: usize| match axis < form.axes() {
            true => inside.min[axis] >> height..((inside.max[axis] - 1) >> height) + 1,
            false => 0..1,
        };
        for z in blocks(2) {
            for y in blocks(1) {
                for x in blocks(0) {
                    let cell = [x, y, z].map(|cell| cell as u32);
                    let Some(code) = Code::from_cell(form.dimension, level, cell) else { continue };
                    match self.units().at(code) {
                        UnitState::Void | UnitState::Above => {}
                        UnitState::Uniform(number) => {
                            let value = self.value(number);
                            paint((bounds, code.bounds(depth)), form.width(), (values, valid), |_| {
                                Some(value)
                            });
                        }
                        UnitState::Block(number) => {
                            let block = self.kept_block(code, number)?;
                            let width = form.width();
                            paint((bounds, code.bounds(depth)), width, (values, valid), |cell| {
                                let value = || Value::from_bytes(&block.values[cell * width..][..width]);
                                block.present[cell].then(value)
                            });
                        }
                    }
                }
            }
        }
        Ok(())
    }
}

/// Header that a file of a view would have.
fn header_of(view: &View) -> Header {
    let header = view.source().header();
    Header {
        form: view.form(),
        rule: header.rule,
        kind: header.kind,
        codec: Codec::Plain,
        shape: Shape { depth: view.depth(), ..header.shape },
        extent: view.extent(),
    }
}

/// Sets the cells of a block to the values of their components. Compiled for each width of values.
fn fill<const WIDTH: usize>(block: &mut CellBlock, pattern: &Pattern, values: &[Value]) {
    let mut bytes = vec![[0; WIDTH]; values.len()];
    for (bytes, value) in bytes.iter_mut().zip(values) {
        value.write(bytes);
    }
    let values = bytes;
    let (cells, _) = block.values.as_chunks_mut::<WIDTH>();
    pattern.each_run(|run, component| {
        block.present[run.clone()].fill(true);
        cells[run].fill(values[component]);
    });
}

/// Draws the intersection of a box with a block, whose cells are given by their index in its rows.
fn paint(
    (bounds, block): (&Bounds, Bounds),
    width: usize,
    (values, valid): (&mut [u8], &mut [bool]),
    value: impl Fn(usize) -> Option<Value>,
) {
    let both = bounds.intersect(&block);
    let index = |cell: [u64; 3], bounds: &Bounds| {
        let [columns, rows, _] = bounds.size();
        let [x, y, z] = [0, 1, 2].map(|axis| cell[axis] - bounds.min[axis]);
        ((z * rows + y) * columns + x) as usize
    };
    for z in both.min[2]..both.max[2] {
        for y in both.min[1]..both.max[1] {
            for x in both.min[0]..both.max[0] {
                if let Some(value) = value(index([x, y, z], &block)) {
                    let to = index([x, y, z], bounds);
                    valid[to] = true;
                    value.write(&mut values[to * width..(to + 1) * width]);
                }
            }
        }
    }
}

/// Node of some cells in a block with `side` cells along an edge.
fn node_of(block: &CellBlock, bounds: &Bounds, side: u64, width: usize, code: Code) -> Child<Code> {
    let index = |x: u64, y: u64, z: u64| ((z * side + y) * side + x) as usize;
    let value = |cell: usize| block.present[cell].then(|| &block.values[cell * width..][..width]);
    let first = value(index(bounds.min[0], bounds.min[1], bounds.min[2]));
    for z in bounds.min[2]..bounds.max[2] {
        for y in bounds.min[1]..bounds.max[1] {
            for cell in index(bounds.min[0], y, z)..index(bounds.max[0], y, z) {
                let value = value(cell);
                if value != first {
                    let some = value.or(first).map_or(Value::ZERO, Value::from_bytes);
                    return Child::Inner { representative: some, node: code };
                }
            }
        }
    }
    Child::uniform(first.map(Value::from_bytes))
}

impl Source for Regions {
    type Node = Code;

    fn form(&self) -> TreeType {
        self.header.form
    }

    fn depth(&self) -> u8 {
        self.header.depth()
    }

    fn root(&self) -> Result<Child<Code>> {
        self.node(Code::root(self.header.form.dimension))
    }

    fn children(&self, node: &Code, children: &mut Children<Code>) -> Result<()> {
        for (step, child) in children[..self.header.form.children()].iter_mut().enumerate() {
            *child = match node.level() < self.cells.block_level() {
                // (Builders do not need to know whether a block is uniform.)
                true => match self.units().at(node.child(step)) {
                    UnitState::Block(_) => {
                        Child::Inner { representative: Value::ZERO, node: node.child(step) }
                    }
                    _ => self.node(node.child(step))?,
                },
                false => self.node(node.child(step))?,
            };
        }
        Ok(())
    }

    fn cells(&self, node: &Code, _: u8) -> Result<Option<CellBlock>> {
        match self.units().at(*node) {
            UnitState::Block(number) if node.level() == self.cells.block_level() => {
                self.block(*node, number).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn draw(&self, bounds: &Bounds, values: &mut [u8], valid: &mut [bool]) -> Result<bool> {
        self.draw_cells(bounds, values, valid)?;
        Ok(true)
    }

    fn check_unchanged(&self) -> Result<()> {
        self.cells.view.check_unchanged()
    }
}
