//! Batches of single cells.
//!
//! A single cell costs two searches in the segment index and a descent from its segment's root. For
//! many cells the upper levels are traversed once, into a table with an entry per node of some
//! level. An entry has the value of a uniform block, or the number of the node's record. Random
//! cells of solids are nearly always in large uniform blocks.

use zerocopy::IntoBytes;

use super::check_level;
use crate::store::goblin::{Goblin, GoblinNode, Segment};
use crate::store::records::dense::dense_block;
use crate::store::records::{Record, RecordLayout, child_record, with_record_type};
use crate::tree::{Child, Source, no_children};
use spinney_base::array;
use spinney_base::io::batch;
use spinney_base::sort;
use spinney_base::space::{Cell, Code, Dimension};
use spinney_base::value::{Numbers, Value, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{CUT, INNER, VOID};

/// Results of [`Dataset::points`](crate::dataset::Dataset::points).
#[derive(Clone, Debug, Default)]
pub struct PointSamples {
    value_type: Option<ValueType>,
    values: Vec<Option<Value>>,
}

impl PointSamples {
    /// Returns the samples of the `index`-th cell, one per channel; `None` is VOID.
    ///
    /// # Panics
    /// If there are not that many cells.
    #[inline]
    pub fn get(&self, index: usize) -> Option<Numbers> {
        self.value_type.zip(self.values[index]).map(|(value_type, value)| value_type.numbers(value))
    }

    /// Returns the samples of the `index`-th cell as bytes, in channel order; `None` is VOID.
    ///
    /// # Panics
    /// If there are not that many cells.
    #[inline]
    pub fn value(&self, index: usize) -> Option<Value> {
        self.values[index]
    }

    /// Clears all results, and makes space for `cells` values of a type.
    pub(crate) fn start(&mut self, value_type: ValueType, cells: usize) -> &mut [Option<Value>] {
        self.value_type = Some(value_type);
        self.values.clear();
        self.values.resize(cells, None);
        &mut self.values
    }
}

/// Looks up single cells of one level of a file, with a table of the upper levels.
struct Points<'a> {
    tree: &'a Goblin,
    layout: RecordLayout,
    level: u8,
    /// Level of the nodes in the table.
    top: u8,
    /// One entry per node, x fastest, then y, then z.
    table: Vec<Entry>,
    /// Values of uniform entries.
    values: Vec<Option<Value>>,
    /// Segments of all other entries. The second number is how many levels the nodes are below the
    /// roots of their dense blocks; 0 for nodes with records of their own.
    segments: Vec<(Segment<'a>, u8)>,
}

/// A node of the table: its record in a segment, or a value.
#[derive(Clone, Copy)]
struct Entry {
    /// Index in [`Points::segments`], or [`UNIFORM`].
    segment: u32,
    /// Number of the record, or index in [`Points::values`].
    record: u32,
}

/// Marks entries of uniform nodes.
const UNIFORM: u32 = u32::MAX;
/// Maximum number of table entries: 2 MiB, which stay in a processor's cache.
const MAX_NODES: u64 = 1 << 18;
/// Minimum number of requested cells per table entry.
const WORTH: u64 = 8;

impl Goblin {
    /// Writes the values of many cells of a level to `values`. `None` is VOID; so is everything
    /// outside of the tree.
    ///
    /// # Errors
    /// If the level is deeper than the tree, if `values` does not have one slot per cell, or if the
    /// file is corrupt there.
    pub fn values_at(&self, level: u8, cells: &[Cell], values: &mut [Option<Value>]) -> Result<()> {
        if cells.len() != values.len() {
            let found = format!("a buffer of {} values", values.len());
            return Err(Error::invalid("points", found, format!("{} values, one per cell", cells.len())));
        }
        if !self.is_mapped() {
            // Segments that are not mapped stay in memory while they are referenced, so a table of
            // them would be unbounded. In FD order each segment is needed once.
            check_level(level, self.header().depth())?;
            let dimension = self.header().form.dimension;
            return values_one_by_one((dimension, level, true), cells, values, &|code| self.value_at(code));
        }
        let points = self.points_of(level, cells.len() as u64)?;
        with_record_type!(points.layout, R => points.values::<R>(cells, values))
    }

    /// Prepares for about `count` cells of a level, anywhere in the tree of a mapped file. The more
    /// cells, the more of the upper levels are in the table.
    ///
    /// # Errors
    /// If the level is deeper than the tree, or the file is corrupt.
    fn points_of(&self, level: u8, count: u64) -> Result<Points<'_>> {
        check_level(level, self.header().depth())?;
        let dimension = self.header().form.dimension;
        let worth = (count / WORTH).min(MAX_NODES);
        let top = (0..=level).take_while(|top| dimension.cells(*top) <= worth).last().unwrap_or(0);
        let mut points = Points {
            tree: self,
            layout: *self.layout(),
            level,
            top,
            table: Vec::new(),
            values: Vec::new(),
            segments: Vec::new(),
        };
        if top > 0 {
            points.table = vec![Entry { segment: UNIFORM, record: 0 }; dimension.cells(top) as usize];
            points.values.push(None);
            points.fill(Code::root(dimension), &self.root()?)?;
        }
        Ok(points)
    }
}

/// Writes the values of many cells of a level to `values`, with one call of `value_at` per cell.
/// Cells with a result are not queried again in later batches: all of them together may need more
/// bytes of a remote file than the cache holds. `in_order` queries them in FD order.
///
/// # Errors
/// Those of `value_at`.
pub(crate) fn values_one_by_one(
    (dimension, level, in_order): (Dimension, u8, bool),
    cells: &[Cell],
    values: &mut [Option<Value>],
    value_at: &dyn Fn(Code) -> Result<Option<Value>>,
) -> Result<()> {
    let mut is_known = vec![false; cells.len()];
    let code_of = |at: usize| Code::from_cell(dimension, level, cells[at]);
    let mut order: Vec<usize> = (0..cells.len()).collect();
    if in_order {
        sort::by_key(&mut order, |at| code_of(*at).map_or(u64::MAX, Code::bits));
    }
    batch::run_batched(|| {
        let mut is_unread = false;
        for at in &order {
            if is_known[*at] {
                continue;
            }
            if let Some(found) =
                batch::defer_missing(code_of(*at).map_or(Ok(None), value_at), &mut is_unread)?
            {
                (values[*at], is_known[*at]) = (found, true);
            }
        }
        batch::finish_deferred(is_unread)
    })
}

impl Points<'_> {
    /// Writes the values of cells of the level.
    fn values<R: Record>(&self, cells: &[Cell], values: &mut [Option<Value>]) -> Result<()> {
        let mut runs: Vec<(&[R], u8)> = Vec::with_capacity(self.segments.len());
        for (run, below) in &self.segments {
            runs.push((R::of(run.records()), *below));
        }
        let side = 1u32 << self.level;
        for (cell, value) in cells.iter().zip(values) {
            let inside = (0..3).all(|axis| cell[axis] < if axis < R::AXES { side } else { 1 });
            *value = match inside {
                false => None,
                true if self.top == 0 => self.value_from_root(*cell)?,
                true => match self.table[self.entry_index(*cell, self.level - self.top)] {
                    Entry { segment: UNIFORM, record } => self.values[record as usize],
                    entry => self.value_below(&runs, entry, *cell)?,
                },
            };
        }
        Ok(())
    }

    /// Returns the value of a cell below a node of the table.
    #[inline]
    fn value_below<R: Record>(&self, runs: &[(&[R], u8)], entry: Entry, cell: Cell) -> Result<Option<Value>> {
        let (records, below) = runs[entry.segment as usize];
        let [x, y, z] = array::map(cell, |cell| cell as usize);
        let mut at = entry.record as usize;
        for bit in (0..self.level - self.top).rev() {
            // (In quadtrees z is 0.)
            let step = x >> bit & 1 | (y >> bit & 1) << 1 | (z >> bit & 1) << 2;
            let record = records.get(at).ok_or_else(|| self.bad_skip(entry, at))?;
            if record.is_dense() && below + bit > 0 {
                // (The table leads directly to nodes within a block; other nodes have `below ==
                // 0`.)
                let level = below + bit + 1;
                let block = dense_block(records, at).ok_or_else(|| self.bad_skip(entry, at))?;
                // (A block ends at the bottom of its segment; deeper nodes are in other segments.)
                return match block.levels >= level {
                    true => Ok(block.value_at(level, cell)),
                    false => self.value_from_root(cell),
                };
            }
            match record.state(step) {
                VOID => return Ok(None),
                CUT if bit > 0 => return self.value_from_root(cell),
                INNER if bit > 0 => {
                    at = child_record(records, at, step).ok_or_else(|| self.bad_skip(entry, at))?
                }
                _ => return Ok(Some(Value::from_bytes(record.values()[step].as_bytes()))),
            }
        }
        Ok(None)
    }

    #[cold]
    fn bad_skip(&self, entry: Entry, record: usize) -> Error {
        self.tree.bad_skip(&self.segments[entry.segment as usize].0, record)
    }

    /// Returns the value of a cell whose table entry does not lead to it.
    fn value_from_root(&self, cell: Cell) -> Result<Option<Value>> {
        let code = Code::from_cell(self.layout.dimension, self.level, cell);
        code.map_or(Ok(None), |code| self.tree.value_at(code))
    }

    /// Returns the index of the table entry for a cell's ancestor `up` levels above it.
    #[inline]
    fn entry_index(&self, cell: Cell, up: u8) -> usize {
        // (In quadtrees z is 0.)
        let [x, y, z] = array::map(cell, |cell| cell as usize >> up);
        x | y << self.top | z << (2 * self.top)
    }

    /// Fills the entries of all descendants of a node.
    fn fill(&mut self, code: Code, child: &Child<GoblinNode>) -> Result<()> {
        let entry = match child {
            Child::Inner { node, .. } if code.level() < self.top => {
                let mut children = no_children();
                self.tree.children(node, &mut children)?;
                let children = &children[..self.layout.children()];
                return children
                    .iter()
                    .enumerate()
                    .try_for_each(|(i, child)| self.fill(code.child(i), child));
            }
            // If the table's nodes are the cells, nothing below them is needed.
            Child::Inner { node, .. } if self.top < self.level => {
                Entry { segment: self.segment_of(node)?, record: node.place.record }
            }
            child => self.uniform(child.value()),
        };
        self.fill_below(code, entry);
        Ok(())
    }

    /// Returns the index in [`Points::segments`] of a node's segment.
    fn segment_of(&mut self, node: &GoblinNode) -> Result<u32> {
        let (index, below) = (node.segment as usize, node.place.below);
        // In preorder, the nodes of a segment are consecutive.
        let known = self.segments.iter().rposition(|known| (known.0.index(), known.1) == (index, below));
        if known.is_none() {
            self.segments.push((self.tree.segment(index)?, below));
        }
        Ok(known.unwrap_or(self.segments.len() - 1) as u32)
    }

    /// Returns the entry of a uniform block; `None` is VOID.
    fn uniform(&mut self, value: Option<Value>) -> Entry {
        // It is mostly VOID or a recent value.
        let recent = self.values.len().saturating_sub(4)..self.values.len();
        let known = std::iter::once(0).chain(recent.rev()).find(|index| self.values[*index] == value);
        let record = known.unwrap_or_else(|| {
            self.values.push(value);
            self.values.len() - 1
        });
        Entry { segment: UNIFORM, record: record as u32 }
    }

    /// Sets the entries of all nodes of the table below a node.
    fn fill_below(&mut self, code: Code, entry: Entry) {
        let axes = self.layout.dimension.axes();
        let size = 1u32 << (self.top - code.level());
        let extent = |axis: usize| if axis < axes { size } else { 1 };
        let min: [u32; 3] = array::from_fn(|axis| code.cell()[axis] * extent(axis));
        for z in min[2]..min[2] + extent(2) {
            for y in min[1]..min[1] + extent(1) {
                let start = self.entry_index([min[0], y, z], 0);
                self.table[start..start + size as usize].fill(entry);
            }
        }
    }
}
